"""Surfaces around the part of a grid above a level."""

import numpy as np
import pytest

from tensionlab.support.surfaces import level_surface


def content(surface):
    """The volume inside a surface whose triangles face outwards."""
    a, b, c = np.moveaxis(surface[0][surface[1]], 1, 0)
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def test_a_ball_has_its_radius_and_volume():
    axis = np.linspace(-1.5, 1.5, 40)
    values = 1.0 - np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis)), axis=0)
    surface = level_surface(values, (axis, axis, axis), 0.25)
    assert np.linalg.norm(surface[0], axis=1) == pytest.approx(0.75, abs=2e-3)
    assert content(surface) == pytest.approx(4 / 3 * np.pi * 0.75**3, rel=0.01)
    assert level_surface(values, (axis, axis, axis), 0.9) is not None
    assert level_surface(values, (axis, axis, axis), 1.0) is None


def test_it_closes_at_the_border():
    axes = tuple(np.linspace(low, low + size, 2 + size) for low, size in ((0.0, 1), (1.0, 2), (-1.0, 3)))
    surface = level_surface(np.ones((3, 4, 5)), axes, 0.0)
    assert content(surface) == pytest.approx(1 * 2 * 3, rel=1e-5)


def test_a_level_is_where_the_surface_is_and_may_be_negative():
    axis = np.linspace(0.0, 1.0, 11)
    values = np.broadcast_to(-axis[:, None, None], (11, 11, 11))  # above -0.25 where x is below 0.25
    surface = level_surface(values, (axis, axis, axis), -0.25)
    assert content(surface) == pytest.approx(0.25, rel=1e-3)
    assert level_surface(values, (axis, axis, axis), 0.0) is None


def test_no_value_is_below_the_level_and_an_infinite_one_above():
    values, axis = np.full((4, 4, 4), np.nan), np.arange(4.0)
    assert level_surface(values, (axis, axis, axis), 0.0) is None
    for value in (2.0, np.inf):
        values[1, 1, 1] = value
        assert content(level_surface(values, (axis, axis, axis), 0.0)) > 0.0
