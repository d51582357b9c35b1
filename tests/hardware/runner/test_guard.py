import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import tensionlab as tl
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.protocol.codes import Limit, State
from tensionlab.hardware.runner import guard
from tensionlab.hardware.runner.guard import (
    Derating,
    GuardedAllocator,
    Release,
    ReleasedModules,
    next_tensions,
)
from tensionlab.solvers.base import Status

LIMITS = tl.TensionLimits(np.full(4, 0.5), np.full(4, 6.0))
WIDE = tl.TensionLimits(np.full(5, 0.5), np.full(5, 6.0))
ALL = np.ones(4, dtype=bool)
NAMES = list("abcd")
TENSIONS = arrays(np.float64, 5, elements=st.floats(0.5, 6.0))


@pytest.fixture
def structure():
    rig = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
    return rig.structure_matrix(rig.home)


@given(TENSIONS, TENSIONS, st.floats(0.01, 3.0))
def test_no_tension_changes_by_more_than_it_may_and_all_go_the_same_share(before, wanted, most):
    after = next_tensions(before, wanted, np.ones(5, dtype=bool), WIDE, most, "abcde").tensions
    assert np.abs(after - before).max() <= most * (1 + 1e-12)
    share = (after - before) @ (wanted - before)
    np.testing.assert_allclose(
        (after - before) * ((wanted - before) @ (wanted - before)), share * (wanted - before)
    )
    if np.abs(wanted - before).max() <= most:
        np.testing.assert_array_equal(after, wanted)


def test_the_tension_with_the_longest_way_goes_as_far_as_it_may_towards_what_is_wanted():
    before, wanted = np.array([1.0, 2.0, 3.0]), np.array([1.4, 1.2, 3.0])
    limits, free = tl.TensionLimits(np.full(3, 0.5), np.full(3, 6.0)), np.ones(3, dtype=bool)
    after = next_tensions(before, wanted, free, limits, 0.2, "abc")
    np.testing.assert_allclose(after.tensions, [1.1, 1.8, 3.0])
    assert after.slew_limited
    np.testing.assert_array_equal(after.commanded, after.tensions)
    after = next_tensions(before, before, free, limits, 0.2, "abc")
    np.testing.assert_array_equal(after.tensions, before)
    assert not after.slew_limited


def test_modules_that_are_not_free_stay_where_they_are_and_are_not_commanded():
    before, chosen = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.4, 0.0, np.nan, 3.8])
    free = np.array([True, False, False, True])
    after = next_tensions(before, chosen, free, LIMITS, 0.2, NAMES)
    np.testing.assert_allclose(after.tensions, [1.2, 2.0, 3.0, 3.9])
    np.testing.assert_allclose(after.commanded, [1.2, np.nan, np.nan, 3.9])
    after = next_tensions(before, chosen, free, LIMITS, 1.0, NAMES)
    np.testing.assert_allclose(after.tensions, [1.4, 2.0, 3.0, 3.8])


@pytest.mark.parametrize("value", [0.49, 6.01, np.nan, np.inf, -np.inf])
def test_tensions_outside_the_limits_are_refused(value):
    tensions = np.array([1.0, 2.0, value, 3.0])
    with pytest.raises(HardwareError) as caught:
        next_tensions(np.ones(4), tensions, ALL, LIMITS, 9.0, NAMES)
    assert str(caught.value) == f'module "c" would be sent {value:g} N; its limits are 0.5 to 6 N'
    next_tensions(np.ones(4), tensions, np.array([True, True, False, True]), LIMITS, 9.0, NAMES)


def test_tensions_on_the_limits_are_within_them():
    ends = np.array([0.5, 6.0, 0.5, 6.0])
    np.testing.assert_array_equal(next_tensions(np.ones(4), ends, ALL, LIMITS, 9.0, NAMES).tensions, ends)


def test_a_proved_answer_stands(structure):
    allocation, replaced = GuardedAllocator("newton")(structure, np.array([0.0, 0.0, 1.0]), ALL, LIMITS)
    assert not replaced
    assert allocation.status == Status.EXACT


def test_one_that_stops_too_early_is_replaced_by_the_optimum(structure):
    wrench = np.array([1.0, 2.0, 1.0])
    lazy = tl.solvers.Dykstra(iteration_limit=2)
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
    # One that promises no best substitute: the exact solver's own policy.
    allocation, replaced = GuardedAllocator("pseudoinverse")(structure, wrench, ALL, LIMITS)
    assert replaced
    assert allocation.status == Status.NEAREST


def test_modules_that_do_not_take_part_pull_nothing(structure):
    part = np.array([True, False, True, True])
    allocation, _ = GuardedAllocator("newton")(structure, np.array([0.1, -0.2, 0.0]), part, LIMITS)
    assert allocation.tensions[1] == 0.0
    assert (allocation.tensions[part] >= 0.5).all()


def test_other_modules_or_limits_are_another_allocation_and_few_are_kept(structure, monkeypatch):
    monkeypatch.setattr(guard, "MAX_PREPARED", 2)
    guarded, wrench = GuardedAllocator("newton"), np.array([0.0, 5.0, 0.0])
    for upper in (6.0, 5.0, 4.0, 6.0, 4.0):
        limits = tl.TensionLimits(np.full(4, 0.5), np.full(4, upper))
        for part in (ALL, np.array([True, False, True, True])):
            allocation, _ = guarded(structure, wrench, part, limits)
            expected = tl.allocate(structure, wrench, limits.only(part))
            np.testing.assert_allclose(allocation.tensions, expected.tensions, atol=1e-12)
            assert 0 < len(guarded._prepared) <= 2
    kept = dict(guarded._prepared)
    guarded(structure, wrench, part, limits)
    assert guarded._prepared == kept, "the same ones are not prepared again"


def test_limits_that_come_and_go_are_prepared_once(structure, monkeypatch):
    guarded, prepared = GuardedAllocator("newton"), []
    monkeypatch.setattr(
        guard, "Allocator", lambda *words, **more: prepared.append(words) or tl.Allocator(*words, **more)
    )
    for upper in (6.0, 5.0) * 3:
        guarded(structure, np.array([0.0, 5.0, 0.0]), ALL, tl.TensionLimits(np.full(4, 0.5), np.full(4, upper)))
    assert len(prepared) == 4, "the chosen solver's and the exact one's"


# Hot windings: the rig's limits are 0.5 to 6 N, and windings stand 3 N for ever but the last, which stands 10.


def derating():
    return Derating(LIMITS, np.array([3.0, 3.0, 3.0, 10.0]), NAMES)


def test_until_a_winding_is_warm_the_limits_are_the_rigs_own():
    hot = derating()
    assert hot.update(np.full(4, np.nan)) == []
    assert hot.update(np.array([0.59, 0.0, np.nan, 0.99])) == []  # 1 - ((6 / 2.94)^2 - 1) / 8 = 0.604
    assert hot.limits is LIMITS
    assert hot.lowest == {}


@pytest.mark.parametrize("thermal", [0.62, 0.7, 0.85, 1.0, 1.7])
def test_the_limit_falls_with_the_square_root_of_what_is_left_to_the_continuous_tension(thermal):
    hot = derating()
    hot.update(np.array([np.nan, thermal, 0.0, thermal]))
    stands = 0.98 * 3.0 * np.sqrt(1.0 + 8.0 * (1.0 - min(thermal, 1.0)))
    np.testing.assert_array_equal(hot.limits.lower, LIMITS.lower)
    np.testing.assert_array_equal(hot.limits.upper[[0, 2, 3]], 6.0)
    assert stands - 0.05 < hot.limits.upper[1] <= stands
    assert hot.limits.upper[1] / 0.05 == pytest.approx(round(hot.limits.upper[1] / 0.05)), "whole steps"
    assert hot.lowest == {"b": hot.limits.upper[1]}


def test_a_limit_is_never_below_the_taut_minimum():
    hot = Derating(LIMITS, np.full(4, 0.3), NAMES)
    hot.update(np.ones(4))
    np.testing.assert_array_equal(hot.limits.upper, LIMITS.lower)


def test_what_is_not_known_anew_stays_as_it_was():
    hot = derating()
    hot.update(np.array([0.9, 0.0, 0.0, 0.0]))
    before = hot.limits
    assert hot.update(np.full(4, np.nan)) == []
    assert hot.limits is before


def test_an_event_is_half_a_newton_or_the_limit_that_is_whole_again():
    hot = derating()
    assert hot.update(np.array([0.64, 0.0, 0.0, 0.0])) == []  # 5.75 N
    assert hot.limits.upper[0] == pytest.approx(5.75)
    assert hot.update(np.array([0.69, 0.0, 0.0, 0.0])) == [
        (0, "pulls with up to 5.45 N in place of 6 N, to keep its winding from getting too hot")
    ]
    assert hot.update(np.array([0.72, 0.0, 0.0, 0.0])) == []  # 5.25 N: less than half a newton since
    assert hot.update(np.array([0.66, 0.0, 0.0, 0.0])) == []
    assert hot.update(np.array([0.3, 0.0, 0.0, 0.0])) == [
        (0, "pulls with up to 6 N again: its winding has cooled")
    ]
    np.testing.assert_array_equal(hot.limits.upper, 6.0)
    assert hot.update(np.array([0.2, 0.0, 0.0, 0.0])) == []
    assert hot.lowest == {"a": pytest.approx(5.25)}


def test_half_a_newton_is_enough_for_an_event():
    hot = derating()
    assert len(hot.update(np.array([0.6843, 0.0, 0.0, 0.0]))) == 1
    assert hot.limits.upper[0] == 5.5


def test_a_limit_that_is_whole_again_is_told_however_little_it_was_lowered():
    hot = derating()
    hot.update(np.array([0.69, 0.0, 0.0, 0.0]))
    hot.update(np.array([0.61, 0.0, 0.0, 0.0]))
    assert hot.limits.upper[0] == pytest.approx(5.95)
    assert [index for index, _ in hot.update(np.array([0.5, 0.0, 0.0, 0.0]))] == [0]


def test_a_spent_winding_that_cannot_hold_the_lower_limit_is_refused():
    hot = Derating(LIMITS, np.array([3.0, 0.3, 0.5, 3.0]), NAMES)
    hot.require_holding(0, 1.0)
    hot.require_holding(1, 0.99)
    hot.require_holding(1, np.nan)
    hot.require_holding(2, 1.0)
    with pytest.raises(ModuleFault, match=r'module "b" is too hot: it bears 0\.30 N') as caught:
        hot.require_holding(1, 1.0)
    assert (caught.value.module, caught.value.code) == ("b", Limit.THERMAL)


# Lost modules: what they still pull, by the course of a firmware that times out, or that is stopped


@pytest.mark.parametrize(
    ("after", "tension"),
    [
        (-1.0, 4.0),
        (0.0, 4.0),
        (0.1, 3.0),
        (0.34, 0.6),
        (0.35, 0.5),
        (2.0, 0.5),
        (2.01, 0.4),
        (2.05, 0.0),
        (9.0, 0.0),
    ],
)
def test_a_module_that_times_out_ramps_down_stays_taut_for_2_s_and_lets_go(after, tension):
    assert Release(4.0, 7.0, 10.0, 0.5).pull(7.0 + after) == pytest.approx(tension)


@pytest.mark.parametrize(("after", "tension"), [(0.0, 4.0), (0.0005, 3.995), (0.1, 3.0), (0.4, 0.0), (3.0, 0.0)])
def test_a_module_that_is_stopped_ramps_down_to_nothing(after, tension):
    assert Release(4.0, 7.0, 10.0).pull(7.0 + after) == pytest.approx(tension)


def test_a_module_that_pulls_less_than_its_taut_minimum_is_not_pulled_taut_by_a_timeout():
    release = Release(0.3, 7.0, 10.0, 0.5)
    assert [release.pull(7.0 + after) for after in (0.0, 1.0, 2.0, 2.1)] == [0.3, 0.3, 0.3, 0.0]


TTL = 0.25
SILENT, CLOSED, FAULT = LinkTimeout("silent"), LinkError("closed"), ModuleFault("fault", "c", State.FAULT)


@pytest.mark.parametrize(
    ("error", "heard", "state", "course"),
    [
        (FAULT, 10.0, State.FAULT, [0.0, 0.0, 0.0, 0.0]),
        (FAULT, 10.0, State.ESTOP, [0.0, 0.0, 0.0, 0.0]),
        (FAULT, 10.0, State.RUNNING, [4.0, 2.0, 0.0, 0.0]),  # it is told to stop
        (FAULT, 10.0, State.TIMEOUT, [4.0, 2.0, 0.5, 0.0]),
        (CLOSED, 10.0, State.RUNNING, [4.0, 2.0, 0.5, 0.0]),
        (CLOSED, 9.5, State.RUNNING, [4.0, 2.0, 0.5, 0.0]),  # silent, and closed only now
        (SILENT, 9.75, State.RUNNING, [4.0, 2.0, 0.0, 0.0]),  # late, but heard: it is told to stop
        (SILENT, 9.65, State.RUNNING, [3.0, 1.0, 0.5, 0.0]),  # its last set-point died at 9.9
        (SILENT, 9.65, None, [3.0, 1.0, 0.5, 0.0]),
    ],
)
def test_what_a_lost_module_pulls_depends_on_why_it_is_lost(error, heard, state, course):
    lost = ReleasedModules(LIMITS.lower, [60.0, 60.0, 10.0, 60.0], TTL)
    lost.add(2, 4.0, heard, 10.0, state, error)
    pulls = np.array([lost.pulls(10.0 + after) for after in (0.0, 0.2, 1.0, 3.0)])
    np.testing.assert_allclose(pulls[:, 2], course, atol=1e-12)
    assert not pulls[:, [0, 1, 3]].any()


def test_a_module_whose_driver_is_off_pulls_nothing_in_a_run_that_has_just_begun():
    lost = ReleasedModules(LIMITS.lower, [60.0] * 4, TTL)
    lost.add(2, 4.0, 0.01, 0.02, State.FAULT, FAULT)
    assert not lost.pulls(0.02).any()
