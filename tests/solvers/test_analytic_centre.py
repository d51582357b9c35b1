"""The analytic centre."""

import numpy as np
import pytest

from tensionlab import Status, allocate
from tests.helpers.examples import many
from tests.helpers.problems import Case, edge_of_workspace, random_cases

LIMITS = (0.5, 6.0)


def centre(structure, wrench, limits=LIMITS, weights=None):
    return allocate(structure, wrench, limits, "analytic-centre", wrench_weights=weights)


def inside(seed, n, m, count):
    """A batch of wrenches that tensions between 5 % and 95 % of their ranges render."""
    rng = np.random.default_rng(seed)
    batch = random_cases(seed, n, m, count)
    part = rng.uniform(0.05, 0.95, (count, m))
    tensions = batch.lower + part * (batch.upper - batch.lower)
    wrench = np.einsum("bnm,bm->bn", batch.structure, tensions)
    return Case(batch.structure, wrench, batch.lower, batch.upper, batch.reference, batch.weights)


def test_a_tug_of_war_is_as_far_from_the_upper_limit_as_from_the_lower():
    # t1 - t2 = 2: the distances 5 - t1 and t2 - 1, and so all of them, are equal at (4, 2).
    found = centre([[1.0, -1.0]], [2.0], (1.0, 5.0))
    assert found.status == Status.EXACT
    np.testing.assert_allclose(found.tensions, [4.0, 2.0], atol=1e-9)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_the_optimality_conditions_hold(n):
    # The slopes of the logarithms are W'y for some y: they have no part in the null space of W.
    for m in range(n, 13):
        batch = inside(100 * n + m, n, m, many(500))
        found = centre(batch.structure, batch.wrench, batch.limits)
        assert (found.status == Status.EXACT).all()
        below, above = found.tensions - batch.lower, batch.upper - found.tensions
        slopes = 1 / above - 1 / below
        null = np.eye(m) - np.linalg.pinv(batch.structure) @ batch.structure
        curvature = (1 / above**2 + 1 / below**2).min(axis=1)
        missing = np.linalg.norm(np.einsum("bij,bj->bi", null, slopes), axis=1) / curvature
        assert missing.max() < 1e-8
        assert found.iterations.max() <= 15


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 4), (3, 8), (6, 8)])
def test_it_covers_the_workspace_to_its_edge(n, m):
    W, edge, normal = edge_of_workspace(m, n, m, many(200), LIMITS)
    largest = 2.75 * np.linalg.norm(W, axis=1).max(axis=1)
    for distance, error in ((1e-4, 1e-9), (1e-5, 1e-8), (1e-6, 1e-7), (0.0, 5e-7)):
        found = centre(W, edge - distance * largest[:, None] * normal)
        assert np.all(found.residual <= error * largest)
    assert np.all(found.status[np.linalg.norm(edge, axis=1) > 5.0] == Status.EXACT)
    assert np.all(centre(W, edge + 1e-4 * normal).status == Status.UNPROVEN)
