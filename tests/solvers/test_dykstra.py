"""Dykstra's projections: the limit, the iterates, and when they stop."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from tensionlab.solvers.base import RANK_TOLERANCE
from tensionlab.solvers.least_squares import Dykstra
from tensionlab.solvers.programs import times
from tests.helpers.batch import problem, random_problem


def optimality_gap(W, t, lower, upper, reference):
    """How far t is from clip(reference + W' l) for the best l: zero exactly at the optimum for W t."""
    m, n = len(t), len(W)
    rows, bounds = [], []
    for i in range(m):
        if t[i] > lower[i]:  # reference + W' l >= t - gap
            rows.append(np.append(-W[:, i], -1.0))
            bounds.append(reference[i] - t[i])
        if t[i] < upper[i]:
            rows.append(np.append(W[:, i], -1.0))
            bounds.append(t[i] - reference[i])
    if not rows:
        return 0.0
    return linprog(np.eye(n + 1)[-1], rows, bounds, bounds=[(None, None)] * n + [(0, None)]).fun


def inverses(W):
    """The pseudo-inverses by which the method projects."""
    return np.linalg.pinv(W, rcond=RANK_TOLERANCE)


def iterates(given, count):
    """The method in NumPy, as its authors state it: project onto either set, correct, and go round."""
    inverse, x = inverses(given.structure), given.reference
    correction = np.zeros_like(x)
    for _ in range(count):
        y = x - times(inverse, times(given.structure, x) - given.wrench)
        x = np.clip(y + correction, given.lower, given.upper)
        correction = y + correction - x
    return x


def may_stop(given, z, tolerance=1e-9):
    """Is z near enough to the equilibrium space, or proved to be as near as the limits allow?"""
    inverse = inverses(given.structure)
    step = times(inverse, given.wrench - times(given.structure, z))  # leads to the equilibrium space
    accepted = tolerance * np.maximum(1, np.linalg.norm(given.wrench, axis=1))
    beyond = np.maximum(step * (given.lower - z), step * (given.upper - z)).sum(axis=1)
    missing = np.linalg.norm(times(given.structure, step), axis=1)
    return (missing <= accepted) | (beyond <= accepted * np.linalg.norm(step, axis=1))


@pytest.mark.parametrize("m", [1, 3, 8, 9])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_agrees_with_its_statement_in_numpy(n, m):
    given = random_problem(n, m)
    for count in (1, 2, 7, 16, 100):
        answer = Dykstra(tolerance=0.0, iteration_limit=count).solve(given)
        np.testing.assert_allclose(answer.tensions, iterates(given, count), rtol=0, atol=1e-10)


@pytest.mark.parametrize("size", [1.0, 1e-3])  # a wrench below 1 N counts as 1 N
@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 8), (6, 8)])
def test_stops_by_its_rule_and_not_long_after(n, m, size):
    drawn = random_problem(n, m)
    scaled = {name: size * getattr(drawn, name) for name in ("wrench", "lower", "upper", "reference")}
    given = replace(drawn, **scaled)
    answer = Dykstra().solve(given)
    done = answer.iterations < Dykstra().iteration_limit
    assert done.sum() >= len(given) - 1
    assert may_stop(given, answer.tensions, 1.001e-9)[done].all()
    for count in np.unique(answer.iterations):
        rows = answer.iterations == count
        if 8 < count < 2000:
            assert not may_stop(given, iterates(given, count - 8), 0.999e-9)[rows].any()


@pytest.mark.parametrize("reach", [1.0, 3.0])
def test_every_iterate_is_the_optimum_for_its_own_wrench(reach):
    rng = np.random.default_rng(3)
    W = rng.normal(size=(3, 6))
    lower, upper, reference = np.full(6, 0.5), np.full(6, 6.0), rng.uniform(0, 3, 6)
    given = problem(W, reach * (W @ rng.uniform(0.5, 6.0, 6)), lower, upper, reference=reference)
    for limit in range(1, 40):
        z = Dykstra(iteration_limit=limit).solve(given).tensions[0]
        assert ((z >= lower) & (z <= upper)).all()
        assert optimality_gap(W, z, lower, upper, reference) < 1e-9


def test_out_of_reach_the_tensions_closest_to_equilibrium():
    answer = Dykstra().solve(problem([[1, -0.6, -0.6], [0, 0.8, -0.8]], [12, 6], 1.0, 10.0))
    np.testing.assert_allclose(answer.tensions, [[10, 575 / 122, 1]], atol=1e-6)


def test_of_equally_near_tensions_the_closest_to_the_reference():
    # Both cables render the same; what is out of reach is the second component.
    given = problem([[1, 1, 0], [0, 0, 1]], [4, 9], 0.0, [5, 5, 5], reference=[3, 2, 0])
    np.testing.assert_allclose(Dykstra().solve(given).tensions, [[2.5, 1.5, 5]], atol=1e-8)


def test_leaves_out_of_account_what_no_tension_can_render():
    given = problem([[1, -1], [0, 0]], [1, 7], 1.0, 5.0)
    answer = Dykstra().solve(given)
    np.testing.assert_allclose(answer.tensions, [[2, 1]], atol=1e-8)
    assert answer.iterations[0] < 1000
    zero = Dykstra().solve(problem(np.zeros((2, 2)), [1, 7], 1.0, 5.0))
    np.testing.assert_array_equal(zero.tensions, [[1, 1]])
