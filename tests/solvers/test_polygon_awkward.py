"""The polygon where rounding matters: the edge of the workspace, parallel lines, limits of all sizes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tensionlab as tl
from tensionlab.solvers.base import RANK_TOLERANCE
from tensionlab.support.arrays import Floats
from tests.helpers.examples import many
from tests.helpers.oracle import UnsureError, solve
from tests.helpers.problems import cases, exact_tensions, random_cases

every_goal = pytest.mark.parametrize("goal", ["polygon:centroid", "polygon:1-norm", "polygon:2-norm"])


# --- Drawn to be awkward -----------------------------------------------------------------------------------


def awkward(kind: str, seed: int, n: int, m: int, count: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Structures, wrenches and limits of problems with an answer, at the edge or on many limits."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(count, n, m))
    if kind == "parallel cables":
        W[:, :, -1] = W[:, :, 0] * rng.choice([1, -2, 1 + 1e-9, 1 + 1e-13], (count, 1))
    elif kind == "nearly singular":
        W[:, -1] = W[:, 0] + 10.0 ** rng.integers(-7, 0, (count, 1)) * W[:, -1]
    elif kind == "nearly integers":
        W = rng.integers(-2, 3, (count, n, m)) / 2
        W += rng.choice([0, 1e-12, 1e-10, 1e-7], (count, 1, 1)) * rng.normal(size=W.shape)
    lower = rng.choice([0, 0.5, 1, -1], (count, m))
    upper = lower + rng.choice([0, 1, 5.5, 1e-9], (count, m), p=[0.15, 0.4, 0.4, 0.05])
    if seed % 2:
        t = lower + (upper - lower) * rng.choice([0, 0, 1, 0.5, 0.3], (count, m))
    else:
        gain = np.einsum("bn,bnm->bm", rng.integers(-1, 2, (count, n)), W)
        anything = rng.uniform(lower, upper)
        t = np.where(gain > 1e-12, upper, np.where(gain < -1e-12, lower, anything))
    return W, np.einsum("bnm,bm->bn", W, t), lower, upper


@pytest.mark.parametrize("kind", ["any", "parallel cables", "nearly singular", "nearly integers"])
@pytest.mark.parametrize(("n", "m"), [(2, 3), (2, 4), (3, 4), (3, 5), (6, 8)])
def test_rounding_hides_no_answer(kind: str, n: int, m: int) -> None:
    for seed in range(4):
        W, w, lower, upper = awkward(kind, seed, n, m, many(2000))
        for goal in ("polygon:centroid", "polygon:1-norm", "polygon:2-norm"):
            found = tl.allocate(W, w, (lower, upper), goal)
            served = found.status != tl.Status.FAILED
            assert served.mean() > 0.5
            assert np.all(found.status[served] == tl.Status.EXACT)


def test_a_sliver_is_not_left_by_rounding() -> None:
    # Two cables have 1e-9 N of play, and the others are parallel to them but for 1e-10.
    W = [
        [1.4233809528669456e-10, 1.0000000000140652, 0.49999999986709603, 1.0000000001191587],
        [0.500000000090366, 1.8454775102232279e-10, 0.4999999999912238, 0.9999999998260347],
    ]
    w, limits = [5.669956925512372, 6.169956925229624], ([1.0, 0.0, 1.0, 0.0], [1.000000001, 1e-9, 6.5, 5.5])
    exact_tensions(W, w, limits, "polygon:centroid")


@every_goal
@settings(max_examples=many(150))
@given(data=st.data())
def test_an_answer_wherever_there_is_one(goal: str, data: st.DataObject) -> None:
    # Parallel lines, absent cables, cables without play, limits that only touch, nearly singular matrices.
    n = data.draw(st.sampled_from([2, 3, 6]))
    case = data.draw(cases(n, data.draw(st.integers(1, n + 2))))
    loose = case.structure[:, case.lower < case.upper]
    found = tl.allocate(case.structure, case.wrench, case.limits, goal, case.reference)
    try:
        truth = solve(case, "force")
    except UnsureError:
        return
    if loose.shape[1] - np.linalg.matrix_rank(loose, rtol=RANK_TOLERANCE) > 2:
        assert found.status == tl.Status.FAILED
        return
    assert (found.status == tl.Status.EXACT) == truth.reachable
    if truth.reachable and goal == "polygon:2-norm":
        np.testing.assert_allclose(found.tensions, truth.tensions, rtol=0, atol=1e-6)


# --- The edge of the workspace -----------------------------------------------------------------------------


@every_goal
@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 5), (6, 8)])
def test_exact_at_the_edge_of_the_workspace_and_not_beyond(n: int, m: int, goal: str) -> None:
    rng = np.random.default_rng(n)
    count = many(300)
    W, d = random_cases(n, n, m, count).structure, rng.normal(size=(count, n))
    t = np.where(np.einsum("bn,bnm->bm", d, W) > 0, 6.0, 0.5)  # the only tensions that go so far along d
    edge = np.einsum("bnm,bm->bn", W, t)
    np.testing.assert_allclose(exact_tensions(W, edge, (0.5, 6.0), goal), t, rtol=0, atol=1e-6)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    for beyond in (1e-3, 10.0):
        found = tl.allocate(W, edge + beyond * d, (0.5, 6.0), goal)
        assert np.all(found.status == tl.Status.UNPROVEN)
        # A little out of reach the answer is still close by.
        assert beyond > 1 or np.median(found.residual) < 10 * beyond


def test_a_polygon_that_is_an_edge() -> None:
    # Three cables in a plane pull against each other by (1, 1, 1), two lift with all they have.
    half = np.sqrt(0.75)
    W = np.array([[1, -0.5, -0.5, 0, 0], [0, half, -half, 0, 0], [0, 0, 0, 1, 1]])
    w, limits = W @ [1, 2, 3, 4, 4], (np.ones(5), 4 * np.ones(5))
    for goal, answer in (("centroid", [1.5, 2.5, 3.5, 4, 4]), ("1-norm", [1, 2, 3, 4, 4])):
        np.testing.assert_allclose(exact_tensions(W, w, limits, f"polygon:{goal}"), answer, rtol=0, atol=1e-12)
    closest = exact_tensions(W, w, limits, "polygon:2-norm", [1.2, 2.2, 3.2, 9, 9])
    np.testing.assert_allclose(closest, [1.2, 2.2, 3.2, 4, 4], rtol=0, atol=1e-12)
