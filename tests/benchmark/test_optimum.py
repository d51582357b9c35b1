"""The optimum is proved without the solver that found it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import tensionlab as tl
from tensionlab.benchmark.optimum import distance_bound, excess_error, optimum
from tensionlab.solvers.base import POLICIES, Problem
from tests.helpers.batch import problem, random_problem
from tests.helpers.problems import Case, batches, random_cases

PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])
NEAREST = {"tension": (10, 575 / 122, 1), "force": (10, 3.88, 1), "direction": (10, 5, 1)}


def as_problem(case: Case, policy: str = "force") -> Problem:
    """A batch of the tests with reference 0, as the benchmark asks for."""
    zero, ones = np.zeros_like(case.lower), np.ones(case.wrench.shape[-1])
    return Problem(case.structure, case.wrench, case.lower, case.upper, zero, ones, policy)


@pytest.mark.parametrize(("n", "m"), [(2, 2), (3, 3), (3, 5), (3, 12), (6, 8)])
@pytest.mark.parametrize("policy", POLICIES)
def test_ordinary_optima_are_verified(n, m, policy):
    found = optimum(as_problem(random_cases(n + m, n, m, 60), policy))
    assert found.verified.mean() > 0.95
    assert 0 < found.reachable.mean() < 1


def test_near_a_singular_rig_the_optimum_is_better_than_its_wrench_shows():
    # Two cables 1e-7 apart, of which only the difference renders the second component.
    tilt = 1e-7
    W = np.array([[1.0, np.cos(tilt)], [0.0, np.sin(tilt)]])
    t = np.array([2.0, 3.0])
    desired = problem(W, W @ t, [0.0, 0.0], [5.0, 5.0])
    found = optimum(desired)
    np.testing.assert_allclose(found.tensions, [t], atol=1e-7)
    assert np.linalg.norm(W @ found.tensions[0] - W @ t) < 1e-15


@given(batches())
def test_the_bound_is_never_below_the_distance(case):
    desired = as_problem(case)
    best = optimum(desired)
    rng = np.random.default_rng(0)
    start = rng.uniform(desired.lower, desired.upper)
    same = replace(desired, wrench=np.einsum("bnm,bm->bn", desired.structure, start))
    other = optimum(same)
    distance = np.linalg.norm(start - other.tensions, axis=1)
    assert (distance_bound(same, start)[other.verified] >= distance[other.verified] - 1e-6).all()
    assert np.isfinite(best.tensions).all()


@pytest.mark.parametrize("policy", POLICIES)
def test_each_policy_has_its_own_least_error(policy):
    desired = problem(PLANAR, [12, 6], [1] * 3, [10] * 3, policy)
    best = optimum(desired)
    assert best.verified.all()
    np.testing.assert_allclose(best.tensions, [NEAREST[policy]], atol=1e-6)
    above = {name: excess_error(desired, best, np.array([t]))[0] for name, t in NEAREST.items()}
    assert above.pop(policy) == pytest.approx(0.0, abs=1e-6)
    assert min(above.values()) > 1e-3


def test_by_force_the_error_above_the_least_is_a_difference_of_norms():
    desired = problem(PLANAR, [12, 6], [1] * 3, [10] * 3, "force")
    least = np.linalg.norm([12, 6] - PLANAR @ NEAREST["force"])
    for t in (NEAREST["direction"], (1, 1, 1)):
        above = excess_error(desired, optimum(desired), np.array([t], dtype=float))
        assert above[0] == pytest.approx(np.linalg.norm([12, 6] - PLANAR @ t) - least)


def test_multipliers_prove_an_answer_known_by_hand_and_no_other():
    # The sum of two cables is 4 N: 2 N each. (3, 1) renders the same and is √2 away.
    two = problem([[1, 1]], [[4], [4]], [0, 0], [5, 5])
    bound = distance_bound(two, np.array([[2.0, 2.0], [3.0, 1.0]]))
    assert bound[0] < 1e-12
    assert bound[1] >= np.sqrt(2)


def test_multipliers_are_found_where_few_cables_are_off_their_limits():
    # All at a limit, opposed, parallel, fixed, pulling nothing: every kind has multipliers.
    W = np.array([[1.0, -1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    t = np.array([[5.0, 1.0, 5.0, 1.0]])
    one = problem(W, W @ t[0], [1, 1, 5, 1], [5, 5, 5, 5])
    assert distance_bound(one, t)[0] < 1e-9


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 8), (6, 9)])
def test_the_exact_solver_is_proved_for_any_reference_and_what_is_moved_from_it_is_not(n, m):
    drawn = random_problem(n, m, 200)
    found = tl.allocate(drawn.structure, drawn.wrench, (drawn.lower, drawn.upper), reference=drawn.reference)
    bound = distance_bound(drawn, found.tensions, found.separation)
    assert (bound < 1e-6).all()
    # Without the separating directions it takes longer, and proves the same.
    assert (distance_bound(drawn, found.tensions) < 1e-6).all()
    other = replace(drawn, reference=drawn.reference + np.linspace(0.5, 3.0, m))
    moved = tl.allocate(drawn.structure, found.wrench, (drawn.lower, drawn.upper), reference=other.reference)
    distance = np.linalg.norm(moved.tensions - found.tensions, axis=1)
    assert (distance_bound(other, found.tensions) >= distance - 1e-6).all()
    assert distance.max() > 0.1
