"""Allocation along time: known answers, and agreement with a conic solver on random paths."""

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.path_allocation import LOWER, UPPER, by_clarabel, random_path, refine
from tests.stress import cases

TUG_OF_WAR = [[1.0, -1.0]]
SHAPES = [(1, 2), (2, 3), (2, 4), (3, 4), (3, 6), (3, 8), (6, 7), (6, 8)]


@pytest.mark.parametrize("seed", range(cases(25)))
def test_the_path_is_that_of_a_conic_solver_or_ends_where_that_finds_none(seed):
    rng = np.random.default_rng(seed)
    components, cables = SHAPES[rng.integers(len(SHAPES))]
    share = rng.choice([0.3, 0.6, 0.8, 1.0, 2.0])
    problem = random_path(components, cables, int(rng.integers(2, 80)), share, seed)
    found = problem.allocate()
    assert found.status in (tl.Status.EXACT, tl.Status.NEAREST)
    count = len(problem.wrench) if found.blocked is None else found.blocked
    part, until = found.tensions[:count], problem.until(count)
    assert np.isnan(found.tensions[count:]).all()
    assert ((part >= LOWER) & (part <= UPPER)).all()
    assert abs(np.diff(part, axis=0)).max(initial=0.0) <= problem.change + 1e-8
    np.testing.assert_allclose(np.einsum("knm,km->kn", until.structure, part), until.wrench, atol=1e-8)
    if count > 1:
        best = refine(until, by_clarabel(until, tolerance=1e-12))
        np.testing.assert_allclose(part, best, atol=max(1e-6, found.distance))
    if found.blocked:
        assert by_clarabel(problem.until(count + 1), tolerance=1e-12) is None


def test_cables_are_pulled_before_they_are_needed():
    found = tl.allocate_path(TUG_OF_WAR, [[0.0], [0.0], [3.0]], (1.0, 5.0), rate_limits=20.0, dt=0.1)
    np.testing.assert_allclose(found.tensions, [[1.0, 1.0], [2.0, 2.0], [4.0, 1.0]], atol=1e-6)
    assert found.distance < 1e-4


def test_without_hurry_each_sample_is_allocated_for_itself():
    rig = tl.load_rig("ipanema-1")
    turn = np.linspace(0.0, 6.0, 50)[:, None]
    structure = rig.structure_matrix(rig.home + 0.3 * np.hstack([np.cos(turn), np.sin(turn), 0.0 * turn]))
    wrench = np.hstack([150.0 * np.cos(turn), 0.0 * turn, 200.0 + 0.0 * turn, *[0.0 * turn] * 3])
    alone = tl.allocate(structure, wrench, rig.limits)
    found = tl.allocate_path(structure, wrench, rig.limits, 1e6, 1e-3)
    np.testing.assert_allclose(found.tensions, alone.tensions, atol=1e-5)


@pytest.mark.parametrize(
    ("wrench", "blocked"),
    [([[0.0], [3.0], [9.0]], 2), ([[9.0], [0.0], [0.0]], 0), ([[4.0], [-4.0]], 1), ([[4.0], [0.0], [-4.0]], None)],
)
def test_the_first_sample_that_cannot_be_rendered_is_named(wrench, blocked):
    found = tl.allocate_path(TUG_OF_WAR, wrench, (1.0, 5.0), 30.0, 0.1)
    assert found.blocked == blocked
    assert found.status == (tl.Status.EXACT if blocked is None else tl.Status.NEAREST)
    assert np.isfinite(found.tensions[:blocked]).all()


def test_wrenches_that_a_flat_rig_cannot_exert_end_the_path():
    flat = [[1.0, -1.0, 0.5], [0.0, 0.0, 0.0]]
    found = tl.allocate_path(flat, [[0.5, 0.0], [0.6, 0.0], [0.6, 0.1]], (1.0, 5.0), 40.0, 0.1)
    assert found.blocked == 2
    assert repr(found) == "<PathAllocation of 3 samples: sample 2 cannot be rendered after those before it>"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate_limits": 0.0}, "above zero"),
        ({"dt": np.inf}, "above zero"),
        ({"rate_limits": [1.0, 2.0, 3.0]}, "rate_limits has shape"),
        ({"reference": [1.0, 2.0, 3.0]}, "reference has shape"),
        ({"wrench": [0.0]}, "wrench"),
        ({"wrench": [[0.0, 1.0]]}, "give .K, n, m. or"),
        ({"structure": [TUG_OF_WAR, TUG_OF_WAR]}, "give .K, n, m. or"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    given = {"structure": TUG_OF_WAR, "wrench": [[0.0]], "limits": (1.0, 5.0), "rate_limits": 1.0, "dt": 0.1}
    with pytest.raises(ValueError, match=message):
        tl.allocate_path(**(given | change))


@pytest.mark.parametrize("cables", [4, 6, 8])
def test_a_control_loop_keeps_to_limits_and_rates_and_renders_what_is_in_reach(cables):
    problem = random_path(3, cables, 40, 0.7, seed=cables)
    allocate = tl.RateLimitedAllocator((LOWER, UPPER), problem.change / 0.01, 0.01, problem.reference)
    before = None
    for structure, wrench in zip(problem.structure, problem.wrench, strict=True):
        found = allocate(structure, wrench)
        assert found.exact or found.infeasible
        assert ((found.tensions >= LOWER) & (found.tensions <= UPPER)).all()
        if before is not None:
            reach = np.maximum(LOWER, before - problem.change), np.minimum(UPPER, before + problem.change)
            assert abs(found.tensions - before).max() <= problem.change + 1e-9
            assert found.exact == tl.allocate(structure, wrench, reach).exact
        before = found.tensions


def test_a_control_loop_makes_ready_for_a_wrench_that_grows():
    allocate = tl.RateLimitedAllocator((1.0, 5.0), rate_limits=20.0, dt=0.1)
    assert [allocate(TUG_OF_WAR, [pull]).exact for pull in (-2.0, 0.0, 2.0, 4.0)] == [True] * 4
