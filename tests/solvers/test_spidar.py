"""SPIDAR's program."""

import numpy as np
import pytest
from hypothesis import given, settings

from tensionlab import Status, allocate
from tensionlab.solvers import Spidar
from tests.helpers.examples import many
from tests.helpers.problems import Case, cases, one, random_cases


def prices(solver, n, weights):
    return np.where(np.arange(n) < 3, solver.force, solver.torque) * weights


def solve(case, solver):
    return allocate(case.structure, case.wrench, case.limits, solver, case.reference, wrench_weights=case.weights)


def test_one_cable_trades_error_for_tension():
    # (3 - t)² + t² / 1000 is least at t = 3 / 1.001, 3 mN too little.
    found = allocate([[1.0]], [3.0], (0.0, 5.0), "spidar")
    np.testing.assert_allclose(found.tensions, [3 / 1.001], rtol=1e-12)
    assert found.residual == pytest.approx(1e-3 * found.tensions[0], rel=1e-9)
    assert found.status == Status.UNPROVEN


def test_torque_is_worth_less():
    # 0.3 (2 - t)² + t² / 1000, on a component behind the first three.
    W, w = np.zeros((6, 1)), np.zeros(6)
    W[4], w[4] = 1.0, 2.0
    np.testing.assert_allclose(allocate(W, w, (0.0, 5.0), "spidar").tensions, [0.6 / 0.301], rtol=1e-12)
    found = allocate(W[2:5], w[2:5], (0.0, 5.0), "spidar")  # three rows are all force
    np.testing.assert_allclose(found.tensions, [2 / 1.001], rtol=1e-12)


def assert_optimal(case, solver, tensions):
    """Solve for the tensions that are clear of their limits, given the others, and look at all gradients there."""
    q = prices(solver, len(case.wrench), case.weights) / solver.mu
    free = (tensions > case.lower) & (tensions < case.upper)
    t, W = tensions.copy(), case.structure
    F = W[:, free]
    pull = case.reference[free] + F.T @ (q * (case.wrench - W[:, ~free] @ t[~free]))
    t[free] = np.linalg.solve(np.eye(free.sum()) + (F.T * q) @ F, pull)
    np.testing.assert_allclose(tensions, t, rtol=0, atol=1e-8)
    wanted = case.reference + W.T @ (q * (case.wrench - W @ t))  # where the price of this cable alone is least
    rounding = 1e-14 * q.max() * (1 + np.abs(case.wrench).max() + np.abs(W @ t).max())
    assert np.all((wanted <= case.lower + rounding) | (tensions > case.lower) | (case.lower == case.upper))
    assert np.all((wanted >= case.upper - rounding) | (tensions < case.upper) | (case.lower == case.upper))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("solver", [Spidar(), Spidar(mu=1e-5, force=2.0, torque=7.0)], ids=["default", "other"])
def test_the_optimality_conditions_hold(solver, n):
    for m in range(1, 13):
        full = random_cases(100 * n + m, max(n, 2) if n < 4 else 6, m, many(60))
        batch = Case(full.structure[:, :n], full.wrench[:, :n], *full.limits, full.reference, full.weights[:n])
        found = solve(batch, solver)
        for i in range(many(60)):
            assert_optimal(one(batch, i), solver, found.tensions[i])
        assert found.iterations.max() <= 40


@settings(max_examples=many(200))
@given(case=cases())
def test_awkward_problems_are_solved_all_the_same(case):
    found = solve(case, Spidar())
    assert_optimal(case, Spidar(), found.tensions)
    assert found.iterations <= 40
