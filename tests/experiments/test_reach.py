from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import tensionlab as tl
from tensionlab.experiments.random_rigs import structures
from tensionlab.experiments.reach import clearance, facets, furthest

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"


def largest_factor(W, w, lower, upper):
    """The largest s with ``W t = s w`` inside the limits, by SciPy's simplex."""
    n, m = W.shape
    gain = np.append(np.zeros(m), -1.0)
    limits = [*zip(lower, upper, strict=True), (0.0, None)]
    found = linprog(gain, A_eq=np.column_stack([W, -w]), b_eq=np.zeros(n), bounds=limits, method="highs-ds")
    assert found.success, found.message
    return found.x[-1]


@pytest.mark.parametrize(("name", "share"), [("cube-8", 8 / 3), ("tetra-4", 2 / 3)])
def test_at_the_centre_of_a_cube_the_clearance_is_known(name, share):
    rig = tl.load_rig(RIGS / f"{name}.toml")
    structure = rig.structure_matrix(rig.home)[None]
    found = clearance(structure, np.zeros((1, 3)), rig.limits.lower, rig.limits.upper)
    np.testing.assert_allclose(found, (5.0 - 0.5) * np.sqrt(share), rtol=1e-12)


def test_two_crossed_cables_reach_a_square():
    W, lower, upper = np.eye(2)[None], np.array([1.0, 1.0]), np.array([3.0, 3.0])
    wrench = np.array([[2.0, 2.0], [1.25, 2.0], [3.5, 2.0], [0.0, 2.5]])
    square = np.repeat(W, 4, axis=0)
    np.testing.assert_allclose(clearance(square, wrench, lower, upper), [1.0, 0.25, -0.5, -1.0], atol=1e-15)
    np.testing.assert_allclose(furthest(square[:2], wrench[:2], lower, upper), [1.5, 1.5])


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
    np.testing.assert_allclose(clearance(W, edge, lower, upper), 0.0, atol=1e-12)


def test_normals_are_unit_vectors_and_planes_enclose_every_vertex():
    rng = np.random.default_rng(1)
    W, lower, upper = structures(rng, 3, 6, 5), np.full(6, 0.5), np.full(6, 6.0)
    normals, least, most = facets(W, lower, upper)
    assert normals.shape == (5, 15, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0)
    corners = np.where(np.arange(64)[:, None] >> np.arange(6) & 1, upper, lower)
    heights = normals @ W @ corners.T
    np.testing.assert_allclose(heights.min(axis=2), least, atol=1e-12)
    np.testing.assert_allclose(heights.max(axis=2), most, atol=1e-12)
