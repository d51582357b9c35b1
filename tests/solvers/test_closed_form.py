"""Pott's improved closed form."""

import numpy as np
import pytest

from tensionlab.solvers.base import RANK_TOLERANCE
from tensionlab.solvers.closed_form import ImprovedClosedForm, Pseudoinverse
from tensionlab.solvers.programs import times
from tests.helpers.batch import problem, random_problem


def reachable_problem(n, m, count=300):
    """Random rigs, each with a wrench that its cables can render."""
    rng = np.random.default_rng(10 * n + m)
    W = rng.normal(size=(count, n, m))
    W /= np.linalg.norm(W, axis=1, keepdims=True)
    return problem(W, times(W, rng.uniform(0.5, 6.0, (count, m))), 0.5, 6.0)


def rendered(problem, answer, tolerance=1e-9):
    """Which wrenches are rendered exactly."""
    return np.linalg.norm(times(problem.structure, answer.tensions) - problem.wrench, axis=1) < tolerance


def fixed_one_by_one(W, w, lower, upper):
    """The method in NumPy for one problem: its tensions and how many cables it fixed."""
    t = (lower + upper) / 2
    free = lower < upper
    budget = free.sum() - np.linalg.matrix_rank(W * free, rtol=RANK_TOLERANCE)
    for fixed in range(len(t) + 1):
        start = np.where(free, (lower + upper) / 2, t)
        found = start + np.linalg.pinv(W * free, rcond=RANK_TOLERANCE) @ (w - W @ start)
        t = np.clip(found, lower, upper)
        if np.abs(found - t).max() <= 1e-12 * upper.max() or fixed >= budget:
            return t, fixed
        free[np.abs(found - t).argmax()] = False
    raise AssertionError("more cables fixed than there are")


@pytest.mark.parametrize("m", [1, 3, 8, 9])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_agrees_with_its_statement_in_numpy(n, m):
    given = random_problem(n, m)
    answer = ImprovedClosedForm().solve(given)
    for i in range(len(given)):
        t, fixed = fixed_one_by_one(given.structure[i], given.wrench[i], given.lower[i], given.upper[i])
        np.testing.assert_allclose(answer.tensions[i], t, rtol=0, atol=1e-9)
        assert answer.iterations[i] == fixed


def test_an_overstretched_cable_is_fixed_and_the_other_takes_over():
    # From the middle (2, 5.5) both cables would take 2.25 N more: 4.25 N is too much for the first.
    given = problem([[1, 1]], [12], [1, 1], [3, 10])
    answer = ImprovedClosedForm().solve(given)
    np.testing.assert_allclose(answer.tensions, [[3, 9]])
    assert answer.iterations[0] == 1
    assert not rendered(given, Pseudoinverse("middle").solve(given))[0]


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 6), (3, 8), (6, 8), (6, 12)])
def test_covers_more_than_the_plain_closed_form_in_at_most_redundancy_steps(n, m):
    given = reachable_problem(n, m)
    answer = ImprovedClosedForm().solve(given)
    exact, plain = rendered(given, answer), rendered(given, Pseudoinverse("middle").solve(given))
    assert not (plain & ~exact).any()
    assert exact.sum() > plain.sum()
    assert answer.iterations.max() <= m - n
    assert ((answer.tensions >= given.lower) & (answer.tensions <= given.upper)).all()


def test_a_limit_reached_but_for_rounding_costs_no_step():
    rng = np.random.default_rng(5)
    W, centre = rng.normal(size=(50, 3, 6)), rng.uniform(1.0, 3.0, (50, 6))
    change = times(np.swapaxes(W, 1, 2), rng.normal(size=(50, 3)))  # of least norm for what it renders
    given = problem(W, times(W, centre + change), centre - np.abs(change), centre + np.abs(change))
    answer = ImprovedClosedForm().solve(given)
    np.testing.assert_allclose(answer.tensions, centre + change)
    assert not answer.iterations.any()
