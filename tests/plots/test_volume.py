import numpy as np
import pytest

from tensionlab.plots.volume import level_surface

AXIS = np.linspace(-1.2, 1.2, 31)


def area(triangles):
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.linalg.norm(np.cross(first, second), axis=1).sum() / 2


def edges(triangles):
    """How often does each edge occur? Corners are told apart to a millionth."""
    corners = np.round(triangles * 1e6).astype(np.int64)
    pairs = np.concatenate([corners[:, [i, j]] for i, j in ((0, 1), (1, 2), (2, 0))])
    first, second = pairs[:, 0], pairs[:, 1]
    swap = [tuple(a) > tuple(b) for a, b in zip(first, second, strict=True)]
    pairs[swap] = pairs[swap][:, ::-1]
    return np.unique(pairs.reshape(-1, 6), axis=0, return_counts=True)[1]


def test_a_ball_has_the_area_of_its_sphere_and_no_holes():
    x, y, z = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")
    triangles = level_surface(1.0 - np.sqrt(x**2 + y**2 + z**2), (AXIS, AXIS, AXIS), 0.0)
    assert area(triangles) == pytest.approx(4 * np.pi, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(triangles, axis=2), 1.0, atol=0.01)


def test_what_reaches_the_border_is_closed_there():
    ones = np.ones((3, 4, 5))
    axes = (np.linspace(0.0, 1.0, 3), np.linspace(0.0, 2.0, 4), np.linspace(0.0, 3.0, 5))
    assert area(level_surface(ones, axes, 0.0)) == pytest.approx(2 * (2 + 3 + 6), rel=1e-6)


def test_inside_the_grid_every_edge_is_shared_by_two_triangles():
    values = np.full((9, 9, 9), -1.0)
    values[1:-1, 1:-1, 1:-1] = np.random.default_rng(0).uniform(-1.0, 1.0, size=(7, 7, 7))
    axis = np.arange(9.0)
    triangles = level_surface(values, (axis, axis, axis), 0.0)
    assert (edges(triangles) == 2).all()


def test_no_value_is_below_the_level():
    values = np.full((4, 4, 4), np.nan)
    axis = np.arange(4.0)
    assert len(level_surface(values, (axis, axis, axis), 0.0)) == 0
    values[1, 1, 1] = 2.0
    assert len(level_surface(values, (axis, axis, axis), 0.0)) > 0
