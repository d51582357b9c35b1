import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.protocol.codes import Limit, State
from tensionlab.hardware.runner import guard
from tensionlab.hardware.runner.guard import Derating, GuardedAllocator, Release, release_of
from tensionlab.solvers.base import Status

LIMITS = tl.TensionLimits(np.full(4, 0.5), np.full(4, 6.0))
ALL = np.ones(4, dtype=bool)
NAMES = list("abcd")


@pytest.fixture
def structure():
    rig = tl.load_rig("bartels2026-validation")
    return rig.structure_matrix(rig.home)


def test_a_proved_answer_is_taken_and_another_replaced_by_the_optimum(structure):
    allocation, replaced = GuardedAllocator("newton")(structure, np.array([0.0, 0.0, 1.0]), ALL, LIMITS)
    assert not replaced
    assert allocation.status == Status.EXACT
    wrench, lazy = np.array([1.0, 2.0, 1.0]), tl.solvers.Dykstra(iteration_limit=2)
    assert tl.allocate(structure, wrench, LIMITS, solver=lazy).status == Status.UNPROVEN
    allocation, replaced = GuardedAllocator(lazy)(structure, wrench, ALL, LIMITS)
    assert replaced
    np.testing.assert_allclose(allocation.tensions, tl.allocate(structure, wrench, LIMITS).tensions)


def test_out_of_reach_the_exact_solver_keeps_to_the_policy(structure):
    wrench = np.array([0.0, -50.0, 1.0])
    for policy in ("force", "tension", "direction"):
        allocation, _ = GuardedAllocator("newton", policy)(structure, wrench, ALL, LIMITS)
        expected = tl.allocate(structure, wrench, LIMITS, policy=policy)
        np.testing.assert_allclose(allocation.tensions, expected.tensions, atol=1e-9)
    # A solver that promises no best substitute: the exact solver's own policy.
    allocation, replaced = GuardedAllocator("pseudoinverse")(structure, wrench, ALL, LIMITS)
    assert replaced
    assert allocation.status == Status.NEAREST


def test_each_set_of_modules_and_limits_has_its_answers_and_few_are_kept_prepared(structure, monkeypatch):
    monkeypatch.setattr(guard, "MAX_PREPARED", 3)
    guarded, wrench = GuardedAllocator("newton"), np.array([0.0, 5.0, 0.0])
    part = np.array([True, False, True, True])
    for upper in (6.0, 5.0, 6.0, 4.0, 6.0):
        limits = tl.TensionLimits(np.full(4, 0.5), np.full(4, upper))
        for taking_part in (ALL, part):
            allocation, _ = guarded(structure, wrench, taking_part, limits)
            expected = tl.allocate(structure, wrench, limits.only(taking_part))
            np.testing.assert_allclose(allocation.tensions, expected.tensions, atol=1e-12)
            assert (allocation.tensions[~taking_part] == 0.0).all()
    assert 0 < len(guarded._prepared) <= 3


# Hot windings: the rig's limits are 0.5 to 6 N.


def test_until_a_winding_is_warm_the_limits_are_the_rigs_own():
    warm = Derating(LIMITS, NAMES)
    warm.update(np.full(4, np.nan))
    warm.update(np.array([6.13, 6.6, np.nan, 12.0]))  # 0.98 of it is 6.007
    assert warm.limits is LIMITS
    assert warm.lowest == {}


@pytest.mark.parametrize("bearable", [6.1, 4.0, 3.0, 0.6])
def test_the_limit_is_a_little_less_than_what_a_module_says_that_it_bears(bearable):
    warm = Derating(LIMITS, NAMES)
    warm.update(np.array([np.nan, bearable, 7.0, 7.0]))
    np.testing.assert_array_equal(warm.limits.lower, LIMITS.lower)
    np.testing.assert_array_equal(warm.limits.upper[[0, 2, 3]], 6.0)
    assert 0.98 * bearable - 0.05 < warm.limits.upper[1] <= 0.98 * bearable
    assert warm.limits.upper[1] / 0.05 == pytest.approx(round(warm.limits.upper[1] / 0.05)), "whole steps"
    assert warm.lowest == {"b": warm.limits.upper[1]}
    before = warm.limits
    warm.update(np.full(4, np.nan))
    assert warm.limits is before, "what is not known anew stays as it was"


def test_a_limit_is_never_below_the_minimum_tension():
    warm = Derating(LIMITS, NAMES)
    warm.update(np.zeros(4))
    np.testing.assert_array_equal(warm.limits.upper, LIMITS.lower)


def test_the_lowest_limit_is_kept_after_the_winding_has_cooled():
    warm = Derating(LIMITS, NAMES)
    for bearable, upper in ((5.9, 5.75), (5.4, 5.25), (5.8, 5.65), (7.0, 6.0), (5.65, 5.5)):
        warm.update(np.array([bearable, 7.0, 7.0, 7.0]))
        assert warm.limits.upper[0] == pytest.approx(upper)
    assert warm.lowest == {"a": pytest.approx(5.25)}


def test_a_module_that_cannot_hold_the_lower_limit_is_refused():
    hot = Derating(LIMITS, NAMES)
    hot.require_holding(0, 3.0)
    hot.require_holding(1, np.nan)
    hot.require_holding(2, 0.5)
    with pytest.raises(ModuleFault, match=r'module "b" is too hot: it bears 0\.30 N') as caught:
        hot.require_holding(1, 0.3)
    assert (caught.value.module, caught.value.code) == ("b", Limit.THERMAL)


# Lost modules: what they still pull, by the course of a firmware that times out, or that is stopped


@pytest.mark.parametrize(
    ("release", "course"),
    [
        # Times out: ramps down, holds the cable taut for 2 s, and releases it.
        (
            Release(4.0, 7.0, 10.0, 0.5),
            {-1.0: 4.0, 0.0: 4.0, 0.1: 3.0, 0.34: 0.6, 0.35: 0.5, 2.0: 0.5, 2.01: 0.4, 9: 0},
        ),
        # Is stopped: ramps down to nothing.
        (Release(4.0, 7.0, 10.0), {0.0: 4.0, 0.0005: 3.995, 0.1: 3.0, 0.4: 0.0, 3.0: 0.0}),
        # Pulls less than its minimum tension: a timeout does not raise it.
        (Release(0.3, 7.0, 10.0, 0.5), {0.0: 0.3, 1.0: 0.3, 2.0: 0.3, 2.1: 0.0}),
    ],
)
def test_a_release_has_the_course_of_the_firmware(release, course):
    assert {after: release.pull(7.0 + after) for after in course} == pytest.approx(course, abs=1e-12)


TTL = 0.25
SILENT, CLOSED, FAULT = LinkTimeout("silent"), LinkError("closed"), ModuleFault("fault", "c", State.FAULT)


@pytest.mark.parametrize(
    ("error", "heard", "state", "course"),
    [
        (FAULT, 10.0, State.FAULT, [0.0, 0.0, 0.0, 0.0]),
        (FAULT, 10.0, State.ESTOP, [0.0, 0.0, 0.0, 0.0]),
        (FAULT, 10.0, State.RUNNING, [4.0, 2.0, 0.0, 0.0]),  # it hears the stop
        (FAULT, 10.0, State.TIMEOUT, [4.0, 2.0, 0.5, 0.0]),
        (CLOSED, 10.0, State.RUNNING, [4.0, 2.0, 0.5, 0.0]),
        (CLOSED, 9.5, State.RUNNING, [4.0, 2.0, 0.5, 0.0]),  # silent, and closed only now
        (SILENT, 9.75, State.RUNNING, [4.0, 2.0, 0.0, 0.0]),  # late, but heard: it is told to stop
        (SILENT, 9.65, State.RUNNING, [3.0, 1.0, 0.5, 0.0]),  # its last set-point died at 9.9
        (SILENT, 9.65, None, [3.0, 1.0, 0.5, 0.0]),
    ],
)
def test_what_a_lost_module_pulls_depends_on_why_it_is_lost(error, heard, state, course):
    release = release_of(error, state, 4.0, 0.5, 10.0, now=10.0, expired=heard + TTL)
    pulls = [release.pull(10.0 + after) for after in (0.0, 0.2, 1.0, 3.0)]
    assert pulls == pytest.approx(course, abs=1e-12)
