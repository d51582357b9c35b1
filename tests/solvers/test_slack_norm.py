"""The p-norm with slack."""

import numpy as np
import pytest

from tensionlab import Status, allocate
from tensionlab.errors import InputError
from tensionlab.solvers import SlackNorm
from tests.helpers.examples import many
from tests.helpers.problems import edge_of_workspace, random_cases

LIMITS = (0.5, 6.0)
# A price of slack that is round enough for slack to show everywhere.
ROUND = SlackNorm(p=3.0, c1=0.05, c2=0.2, kappa=40.0, epsilon=1e-4, gamma=0.5)


def unit_and_half(structure, lower, upper, weights):
    """The unit of slack for each problem, and half the ranges."""
    half = (upper - lower) / 2
    columns = np.sqrt(weights)[:, None] * structure * half[..., None, :]
    return np.linalg.norm(columns, axis=-2).max(axis=-1), half


def cable_slope(solver, tensions, lower, upper, reference):
    """How the price of each tension rises, times half its range."""
    half = (upper - lower) / 2
    change = (tensions - reference) / half
    slope = solver.p * np.abs(change) ** (solver.p - 1) * np.sign(change)
    return slope - solver.c1 * half / (tensions - lower) + solver.c2 * half / (upper - tensions)


def slack_slope(solver, slack):
    return solver.kappa * (slack / np.sqrt(slack**2 + solver.epsilon) + 2 * solver.gamma * slack)


def test_out_of_reach_a_cable_keeps_the_distance_at_which_wrench_is_worth_as_much():
    # x from -1 to 1 between the limits: 2 x + c / (1 - x) - c / (1 + x) = kappa (1 + 2 gamma s), s = (12 - t) / 2.
    found = allocate([[1.0]], [12.0], (1.0, 5.0), SlackNorm(gamma=0.5), "middle")
    x, s = (found.tensions[0] - 3.0) / 2.0, (12.0 - found.tensions[0]) / 2.0
    assert found.status == Status.UNPROVEN
    assert 1 - x == pytest.approx(0.1 / (3500.0 * (1 + s)), rel=1e-3)


@pytest.mark.parametrize("n", [2, 3, 6])
@pytest.mark.parametrize(
    "solver", [SlackNorm(), ROUND, SlackNorm(p=2.5, kappa=1e4)], ids=["default", "round", "p"]
)
def test_the_optimality_conditions_hold(solver, n):
    # One multiplier y explains all tensions, W_i'y being the slope of their prices, and it is that of the slack.
    for m in range(n, 13):
        batch = random_cases(100 * n + m, n, m, many(300))
        found = allocate(
            batch.structure, batch.wrench, batch.limits, solver, batch.reference, wrench_weights=batch.weights
        )
        unit, half = unit_and_half(batch.structure, batch.lower, batch.upper, batch.weights)
        root = np.sqrt(batch.weights) / unit[:, None]
        columns = root[..., None] * batch.structure * half[:, None, :]
        slack = root * (batch.wrench - found.wrench)
        slopes = cable_slope(solver, found.tensions, batch.lower, batch.upper, batch.reference)
        x = (found.tensions - batch.lower) / half - 1
        stiff = solver.c1 / (1 + x) ** 2 + solver.c2 / (1 - x) ** 2
        y = slack_slope(solver, slack)
        # Slack below rounding says nothing about its slope; where it says something, so do all cables.
        known = (np.abs(slack) > 1e-6).all(axis=1)
        missing = np.abs(np.einsum("bnm,bn->bm", columns, y) - slopes) / stiff
        noise = 1e-13 * solver.kappa / np.sqrt(solver.epsilon)
        assert np.all(missing[known] < 1e-6 + noise / stiff[known])
        fitted = np.linalg.pinv(np.swapaxes(columns, 1, 2) / stiff[..., None])
        y = np.einsum("bnm,bm->bn", fitted, slopes / stiff)
        assert np.all(np.abs(np.einsum("bnm,bn->bm", columns, y) - slopes) / stiff < 1e-6)
        assert found.iterations.max() <= 60


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 4), (3, 8), (6, 8), (6, 12)])
def test_inside_the_workspace_the_slack_is_below_tolerance(n, m):
    W, edge, normal = edge_of_workspace(m, n, m, many(300), LIMITS)
    unit = 2.75 * np.linalg.norm(W, axis=1).max(axis=1)
    for reference in ("lower", "middle"):
        near = allocate(W, edge - 1e-3 * unit[:, None] * normal, LIMITS, "slack", reference)
        at = allocate(W, edge, LIMITS, "slack", reference)
        assert np.all(near.status == Status.EXACT)
        assert np.all(near.residual <= 1e-6 * unit)
        assert np.median(near.residual / unit) <= 1e-7
        assert np.all(at.status == Status.UNPROVEN)
        assert np.median(at.residual / unit) <= 5e-4


@pytest.mark.parametrize(("settings", "wanted"), [({"p": 1.9}, "2 or more"), ({"c1": 0.0}, "positive")])
def test_a_refusal_says_which_values_make_sense(settings, wanted):
    with pytest.raises(InputError, match=wanted):
        SlackNorm(**settings)
