import numpy as np
import pytest
from scipy.optimize import linprog

from tensionlab.benchmark.force_extent import furthest
from tensionlab.benchmark.random_rigs import structures
from tensionlab.workspace import capacity_margin


def largest_factor(W, w, lower, upper):
    """The largest s with ``W t = s w`` inside the limits, by SciPy's simplex."""
    n, m = W.shape
    gain = np.append(np.zeros(m), -1.0)
    limits = [*zip(lower, upper, strict=True), (0.0, None)]
    found = linprog(gain, A_eq=np.column_stack([W, -w]), b_eq=np.zeros(n), bounds=limits, method="highs-ds")
    assert found.success, found.message
    return found.x[-1]


def test_two_crossed_cables_reach_a_square():
    W, limits = np.repeat(np.eye(2)[None], 2, axis=0), (np.array([1.0, 1.0]), np.array([3.0, 3.0]))
    np.testing.assert_allclose(furthest(W, np.array([[2.0, 2.0], [1.25, 2.0]]), *limits), [1.5, 1.5])


@pytest.mark.parametrize(("n", "m"), [(3, 3), (3, 5), (3, 12), (6, 8)])
def test_furthest_agrees_with_linear_programming(n, m):
    rng = np.random.default_rng(m)
    W = structures(rng, n, m, 20)
    lower, upper = rng.uniform(0.0, 1.0, (20, m)), rng.uniform(2.0, 9.0, (20, m))
    w = np.einsum("bnm,bm->bn", W, rng.uniform(lower, upper))
    expected = [largest_factor(*each) for each in zip(W, w, lower, upper, strict=True)]
    np.testing.assert_allclose(furthest(W, w, lower, upper), expected, rtol=1e-9)


def test_parallel_cables_do_no_harm():
    W = np.array([[1.0, 1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0]])[None]
    w = np.array([[3.0, 1.0, 1.0]])
    np.testing.assert_allclose(furthest(W, w, np.zeros(5), np.full(5, 2.0)), 2.0)


def test_scaled_to_the_furthest_a_wrench_lies_in_a_facet():
    rng = np.random.default_rng(0)
    W, lower, upper = structures(rng, 6, 8, 30), np.full(8, 0.5), np.full(8, 6.0)
    w = W @ rng.uniform(lower, upper)
    edge = furthest(W, w, lower, upper)[:, None] * w
    np.testing.assert_allclose(capacity_margin(W, (lower, upper), edge[:, None]), 0.0, atol=1e-12)
