"""Pott's improved closed form."""

import numpy as np
import pytest

from tensionlab.solvers.closed_form import ClosedForm
from tensionlab.solvers.contract import Problem
from tensionlab.solvers.pseudoinverse import Pseudoinverse


def problem(W, w, lower, upper):
    """A batch from arrays with or without a leading axis."""
    lower, upper = np.atleast_2d(np.asarray(lower, float)), np.atleast_2d(np.asarray(upper, float))
    W, w = np.asarray(W, float).reshape(len(lower), -1, lower.shape[1]), np.asarray(w, float)
    return Problem(W, w.reshape(len(lower), -1), lower, upper, np.zeros_like(lower), np.ones(W.shape[1]), None)


def random_problem(n, m, count=300):
    """Random rigs, each with a wrench that its cables can render."""
    rng = np.random.default_rng(10 * n + m)
    W = rng.normal(size=(count, n, m))
    W /= np.linalg.norm(W, axis=1, keepdims=True)
    lower, upper = np.full((count, m), 0.5), np.full((count, m), 6.0)
    w = (W @ rng.uniform(lower, upper)[..., None])[..., 0]
    return problem(W, w, lower, upper)


def rendered(problem, answer, tolerance=1e-9):
    """Which wrenches are rendered exactly."""
    wrench = (problem.structure @ answer.tensions[..., None])[..., 0]
    return np.linalg.norm(wrench - problem.wrench, axis=1) < tolerance


def test_an_overstretched_cable_is_fixed_and_the_other_takes_over():
    # From the middle (2, 5.5) both cables would take 2.25 N more: 4.25 N is too much for the first.
    given = problem([[1, 1]], [12], [1, 1], [3, 10])
    answer = ClosedForm().solve(given)
    np.testing.assert_allclose(answer.tensions, [[3, 9]])
    assert answer.iterations[0] == 1
    assert not rendered(given, Pseudoinverse("middle").solve(given))[0]


def test_equals_the_plain_closed_form_where_no_limit_is_met():
    given = random_problem(3, 8)
    answer, plain = ClosedForm().solve(given), Pseudoinverse("middle").solve(given)
    untouched = answer.iterations == 0
    assert 0 < untouched.sum() < len(given)
    np.testing.assert_allclose(answer.tensions[untouched], plain.tensions[untouched], atol=1e-12)


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 6), (3, 8), (6, 8), (6, 12)])
def test_covers_more_than_the_plain_closed_form_in_at_most_redundancy_steps(n, m):
    given = random_problem(n, m)
    answer = ClosedForm().solve(given)
    exact, plain = rendered(given, answer), rendered(given, Pseudoinverse("middle").solve(given))
    assert not (plain & ~exact).any()
    assert exact.sum() > plain.sum()
    assert answer.iterations.max() <= m - n
    assert ((answer.tensions >= given.lower) & (answer.tensions <= given.upper)).all()


def test_a_batch_gives_what_each_problem_gives_alone():
    given = random_problem(3, 6, count=40)
    together = ClosedForm().solve(given)
    for i in range(len(given)):
        alone = problem(given.structure[i], given.wrench[i], given.lower[i], given.upper[i])
        np.testing.assert_allclose(ClosedForm().solve(alone).tensions[0], together.tensions[i], atol=1e-12)


def test_cables_without_play_cost_no_step():
    # Without the first, two cables render one component, which leaves one step.
    given = problem([[1, 1, 1]], [14], [2, 1, 1], [2, 3, 10])
    answer = ClosedForm().solve(given)
    np.testing.assert_allclose(answer.tensions, [[2, 3, 9]])
    assert answer.iterations[0] == 1


def test_rank_deficient_rigs_have_a_step_more():
    # The second component is beyond all cables; the first is rendered all the same.
    given = problem([[1, 1], [0, 0]], [12, 0], [1, 1], [3, 10])
    np.testing.assert_allclose(ClosedForm().solve(given).tensions, [[3, 9]])


def test_a_wrench_far_out_of_reach_ends_at_the_limits():
    given = problem([[1, 1]], [99], [1, 1], [3, 10])
    answer = ClosedForm().solve(given)
    np.testing.assert_allclose(answer.tensions, [[3, 10]])
    assert answer.iterations[0] == 1
