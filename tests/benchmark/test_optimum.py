"""The optimum is proved without the solver that found it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from tensionlab.benchmark.optimality_proof import distance_bound
from tensionlab.benchmark.optimum import error_above_least, optimum
from tensionlab.solvers.base import POLICIES, Problem
from tests.support.batch import problem
from tests.support.problems import Case, batches, random_cases

PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])
NEAREST = {"tension": (10, 575 / 122, 1), "force": (10, 3.88, 1), "direction": (10, 5, 1)}


def as_problem(case: Case, nearest: str = "force") -> Problem:
    """A batch of the tests with reference 0, as the benchmark asks for."""
    zero, ones = np.zeros_like(case.lower), np.ones(case.wrench.shape[-1])
    return Problem(case.structure, case.wrench, case.lower, case.upper, zero, ones, nearest)


@pytest.mark.parametrize(("n", "m"), [(2, 2), (3, 3), (3, 5), (3, 12), (6, 8)])
@pytest.mark.parametrize("nearest", POLICIES)
def test_ordinary_optima_are_verified(n, m, nearest):
    found = optimum(as_problem(random_cases(n + m, n, m, 60), nearest))
    assert found.verified.mean() > 0.95
    assert 0 < found.reachable.mean() < 1


def test_near_a_singular_rig_the_optimum_is_better_than_its_wrench_shows():
    # Two cables 1e-7 apart, of which only the difference renders the second component.
    tilt = 1e-7
    W = np.array([[1.0, np.cos(tilt)], [0.0, np.sin(tilt)]])
    t = np.array([2.0, 3.0])
    asked = problem(W, W @ t, [0.0, 0.0], [5.0, 5.0])
    found = optimum(asked)
    np.testing.assert_allclose(found.tensions, [t], atol=1e-7)
    assert np.linalg.norm(W @ found.tensions[0] - W @ t) < 1e-15


@given(batches())
def test_the_bound_is_never_below_the_distance(case):
    asked = as_problem(case)
    best = optimum(asked)
    rng = np.random.default_rng(0)
    start = rng.uniform(asked.lower, asked.upper)
    same = replace(asked, wrench=np.einsum("bnm,bm->bn", asked.structure, start))
    other = optimum(same)
    distance = np.linalg.norm(start - other.tensions, axis=1)
    assert (distance_bound(same, start)[other.verified] >= distance[other.verified] - 1e-6).all()
    assert np.isfinite(best.tensions).all()


@pytest.mark.parametrize("nearest", POLICIES)
def test_each_policy_has_its_own_least_error(nearest):
    asked = problem(PLANAR, [12, 6], [1] * 3, [10] * 3, nearest)
    best = optimum(asked)
    assert best.verified.all()
    np.testing.assert_allclose(best.tensions, [NEAREST[nearest]], atol=1e-6)
    above = {name: error_above_least(asked, best, np.array([t]))[0] for name, t in NEAREST.items()}
    assert above.pop(nearest) == pytest.approx(0.0, abs=1e-6)
    assert min(above.values()) > 1e-3


def test_by_force_the_error_above_the_least_is_a_difference_of_norms():
    asked = problem(PLANAR, [12, 6], [1] * 3, [10] * 3, "force")
    least = np.linalg.norm([12, 6] - PLANAR @ NEAREST["force"])
    for t in (NEAREST["direction"], (1, 1, 1)):
        above = error_above_least(asked, optimum(asked), np.array([t], dtype=float))
        assert above[0] == pytest.approx(np.linalg.norm([12, 6] - PLANAR @ t) - least)


def test_within_reach_the_error_is_what_is_missing():
    asked = problem([[1, 1]], [4], [0, 0], [5, 5], "tension")
    assert error_above_least(asked, optimum(asked), np.array([[1.0, 2.5]]))[0] == pytest.approx(0.5)
