import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import tensionlab as tl
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.guard import GuardedAllocator, limit_slew, require_within
from tensionlab.solvers.base import Status

LIMITS = tl.TensionLimits(np.full(4, 0.5), np.full(4, 6.0))
ALL = np.ones(4, dtype=bool)
NAMES = list("abcd")
TENSIONS = arrays(np.float64, 5, elements=st.floats(0.5, 6.0))


@pytest.fixture
def structure():
    rig = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
    return rig.structure_matrix(rig.home)


@given(TENSIONS, TENSIONS, st.floats(0.01, 3.0))
def test_no_tension_changes_by_more_than_it_may_and_all_go_the_same_share(before, wanted, most):
    after = limit_slew(before, wanted, most)
    assert np.abs(after - before).max() <= most * (1 + 1e-12)
    share = (after - before) @ (wanted - before)
    np.testing.assert_allclose(
        (after - before) * ((wanted - before) @ (wanted - before)), share * (wanted - before)
    )
    if np.abs(wanted - before).max() <= most:
        np.testing.assert_array_equal(after, wanted)


@pytest.mark.parametrize("value", [0.49, 6.01, np.nan, np.inf, -np.inf])
def test_tensions_outside_the_limits_are_refused(value):
    tensions = np.array([1.0, 2.0, value, 3.0])
    with pytest.raises(HardwareError, match='module "c" would be sent'):
        require_within(tensions, LIMITS, ALL, NAMES)
    require_within(tensions, LIMITS, np.array([True, True, False, True]), NAMES)


def test_a_proved_answer_stands(structure):
    allocation, replaced = GuardedAllocator("newton")(structure, np.array([0.0, 0.0, 1.0]), ALL, LIMITS)
    assert not replaced
    assert allocation.status == Status.EXACT


def test_one_that_stops_too_early_is_replaced_by_the_optimum(structure):
    wrench = np.array([1.0, 2.0, 1.0])
    lazy = tl.Dykstra(iteration_limit=2)
    assert tl.allocate(structure, wrench, LIMITS, solver=lazy).status == Status.ITERATION_LIMIT
    allocation, replaced = GuardedAllocator(lazy)(structure, wrench, ALL, LIMITS)
    assert replaced
    np.testing.assert_allclose(allocation.tensions, tl.allocate(structure, wrench, LIMITS).tensions)


def test_out_of_reach_the_exact_solver_keeps_to_the_policy(structure):
    wrench = np.array([0.0, -50.0, 1.0])
    for policy in ("force", "tension", "direction"):
        allocation, _ = GuardedAllocator("newton", policy)(structure, wrench, ALL, LIMITS)
        expected = tl.allocate(structure, wrench, LIMITS, nearest=policy)
        np.testing.assert_allclose(allocation.tensions, expected.tensions, atol=1e-9)
    # One that promises no best substitute: the exact solver's own policy.
    allocation, replaced = GuardedAllocator("pseudoinverse")(structure, wrench, ALL, LIMITS)
    assert replaced
    assert allocation.status == Status.NEAREST


def test_modules_that_do_not_take_part_pull_nothing(structure):
    part = np.array([True, False, True, True])
    allocation, _ = GuardedAllocator("newton")(structure, np.array([0.1, -0.2, 0.0]), part, LIMITS)
    assert allocation.tensions[1] == 0.0
    assert (allocation.tensions[part] >= 0.5).all()
