"""Distance fields tell distances; a proxy stays on the surface, slides, and is never pulled through."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensionlab.haptics.effects import Box, Shape, Sphere
from tests.helpers.motions import at, follow

FIELDS = [Sphere(), Box(), Box(centre=(0.01, 0.0, 0.0), size=(0.1, 0.2, 0.3))]
COORDINATES = st.tuples(*[st.floats(-0.3, 0.3)] * 3).map(np.array)


@pytest.mark.parametrize("field", FIELDS, ids=repr)
@given(position=COORDINATES)
def test_a_field_is_the_distance_to_its_nearest_point(field, position):
    distance, out = field(position)
    assert np.linalg.norm(out) == pytest.approx(1.0) or distance == 0.0
    nearest = position - distance * out
    assert field(nearest)[0] == pytest.approx(0.0, abs=1e-9)


def test_known_distances():
    assert Box()(np.array([[0.0, 0.0, 0.15], [0.2, 0.2, 0.0], [0.0, 0.09, 0.0]]))[0] == pytest.approx(
        [0.05, np.sqrt(2) * 0.1, -0.01]
    )
    assert Box()(np.array([0.0, 0.09, 0.0]))[1].tolist() == [0.0, 1.0, 0.0]
    for off, distance in ((1e-4, np.sqrt(2) * 1e-4), (-1e-4, -1e-4)):
        assert Box()(np.array([0.1 + off, 0.1 + off, 0.0]))[0] == pytest.approx(distance)
    assert Sphere()(np.array([1e-4, 0.0, 0.0]))[1].tolist() == [1.0, 0.0, 0.0]


def test_the_proxy_slides_around_a_ball_to_where_the_hand_is_nearest():
    angle = np.linspace(0.0, np.pi / 2, 200)
    path = 0.09 * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1)
    force = follow(Shape(), path, 0.01)
    assert np.linalg.norm(force, axis=-1) == pytest.approx(4.0, rel=1e-3)
    assert force[-1] == pytest.approx([0.0, 0.0, 4.0], abs=0.01)


def test_a_hand_that_is_pushed_through_a_thin_plate_is_drawn_back():
    plate = Shape(Box(size=(1.0, 1.0, 0.002)))
    z = np.linspace(0.01, -0.02, 31)
    for path in (z, [0.01, -0.02]):  # slowly, or in one step
        force = follow(plate, np.stack([0.0 * np.array(path), 0.0 * np.array(path), path], axis=-1), 0.01)
        assert force[-1] == pytest.approx([0.0, 0.0, 400.0 * 0.021], rel=1e-3)


def test_a_hand_that_goes_around_the_plate_is_free():
    plate = Shape(Box(size=(0.1, 0.1, 0.002)))
    path = [[0.0, 0.0, 0.01], [0.1, 0.0, 0.01], [0.1, 0.0, -0.01], [0.0, 0.0, -0.01]]
    assert not follow(plate, np.repeat(path, 2, axis=0), 0.01).any()


def test_pressed_into_a_corner_between_two_walls_both_push():
    def corner(p):
        x, z = p[..., 0], p[..., 2]
        return np.minimum(x, z), np.where((x < z)[..., None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])

    path = np.linspace([0.02, 0.0, 0.03], [-0.01, 0.0, -0.02], 60)
    force = follow(Shape(corner), path, 0.01)[-1]
    assert force == pytest.approx([4.0, 0.0, 8.0], rel=1e-3, abs=1e-6)


@given(start=COORDINATES, end=COORDINATES)
def test_the_proxy_is_never_inside(start, end):
    path = np.linspace(start, end, 25)
    memory = None
    for position in path:
        memory = Shape(Box()).render(at(*position), memory).memory
        assert Box()(memory.position)[0] >= -1e-5 or memory.position == pytest.approx(position)


@pytest.mark.parametrize("speed", [0.02, 0.3, 1.5])
def test_a_hand_that_skims_a_flat_surface_is_not_held_back(speed):
    """The proxy stays above it: it once was left behind by centimetres, and then drew with 10 N."""
    x = np.arange(0.0, min(0.1, 2.0 * speed), speed * 0.001)
    depths = np.array([1e-6, 1e-5, 1e-4])
    dips = -np.sin(40 * np.pi * x / 0.1)[:, None] * depths
    along = np.broadcast_to(x[:, None], dips.shape)
    slab = Shape(Box(centre=(0.0, 0.0, -0.05), size=(1.0, 1.0, 0.1)))
    force = follow(slab, np.stack([along, 0 * along, dips], axis=-1), 0.001)
    assert np.abs(force[..., 0]).max() < 1e-3
    assert force[..., 2].min() >= 0.0
    assert force[..., 2].max(axis=0) == pytest.approx(400.0 * depths, rel=0.1, abs=4e-4)
