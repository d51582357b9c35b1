import numpy as np
import pytest

from tensionlab.benchmark.random_rigs import near_singular, structures, unit


def test_directions_have_length_1_and_no_preference():
    vectors = unit(np.random.default_rng(0), 100, 200, 3)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1.0)
    np.testing.assert_allclose(np.einsum("abi,abj->ij", vectors, vectors) / 20000, np.eye(3) / 3, atol=0.01)


@pytest.mark.parametrize(("n", "m"), [(3, 5), (6, 8)])
def test_every_column_is_a_cable(n, m):
    matrices = structures(np.random.default_rng(0), n, m, 50)
    assert matrices.shape == (50, n, m)
    np.testing.assert_allclose(np.linalg.norm(matrices[:, :3], axis=1), 1.0)
    if n == 6:  # the torque of a force is perpendicular to it
        np.testing.assert_allclose(np.sum(matrices[:, :3] * matrices[:, 3:], axis=1), 0.0, atol=1e-14)


@pytest.mark.parametrize(("n", "m"), [(3, 3), (3, 4), (3, 12), (6, 6), (6, 8)])
def test_near_singular_rigs_have_the_condition_asked_for(n, m):
    condition = np.geomspace(1e2, 1e7, 200)
    matrices = near_singular(np.random.default_rng(0), n, m, condition)
    np.testing.assert_allclose(np.linalg.cond(matrices), condition, rtol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(matrices[:, :3], axis=1), 1.0)
