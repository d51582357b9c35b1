"""Bounds of the direction of a cable over a swivelling pulley, in balls around its attachment."""

import numpy as np
import pytest

from benchmarks.tangents import Places, direction, gradient
from tensionlab import _native
from tests.helpers.examples import many

DIGITS = 1e-9  # of bounds and of numbers that are compared with them
ROUNDING = 9e-13  # of directions, 4096 units, which every proof has to spare


def random_places(rng, d, count):
    """Return attachments all round pulleys, from the rim to afar, and distances (k,) to the rim or the axis."""
    radius, angle = 10 ** rng.uniform(-3, 0, count), rng.uniform(0, 2 * np.pi, count)
    straight = radius * 10 ** rng.uniform(-2, 3, count)
    rho = radius * (1 - np.cos(angle)) + straight * np.sin(angle)
    z = radius * np.sin(angle) + straight * np.cos(angle)
    near = rng.random(count) < 0.1  # the axis, beyond the pulley and where cables come along
    rho, z = np.where(near, radius * 10 ** rng.uniform(-4, -1, count), rho), np.where(near, z + radius, z)
    rim = np.hypot(rho - radius, z)
    used = (rho > 1e-6 * radius) & (rim > radius * (1 + 1e-6))
    axis, across = rng.normal(size=(2, count, d))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    across -= (across * axis).sum(axis=1, keepdims=True) * axis
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    places = Places(rho[:, None] * across + z[:, None] * axis, radius, axis)
    return Places(*(each[used] for each in places)), np.minimum(rho, rim - radius)[used]


def bends(places, moved):
    """Return what the kernel has of each: direction, gradient, whether the bounds hold, and both bounds."""
    d = places.points.shape[1]
    found = _native.pulley_bends(
        *map(np.ascontiguousarray, (-places.points, places.radii, places.axes)), np.ascontiguousarray(moved)
    )
    u, slope, rest = np.split(found, [d, d + d * d], axis=1)
    return u, slope.reshape(-1, d, d), rest[:, 0] > 0, rest[:, 1], rest[:, 2]


def moves_in(rng, places, moved):
    """Yield moves (k, d) within balls: anywhere, on the border, to the axis and the rim, and away from them."""
    points, radii, axes = places
    outward = points - (points * axes).sum(axis=1, keepdims=True) * axes
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    to_rim = radii[:, None] * outward - points
    for way in (outward, to_rim, direction(places).astype(float), axes):
        unit = way / np.linalg.norm(way, axis=1, keepdims=True)
        yield from (moved[:, None] * unit, -moved[:, None] * unit)
    for far in (1.0, 1.0, 1.0, 1.0, 0.5, 0.1, 0.01):
        way = rng.normal(size=points.shape)
        yield far * moved[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)


@pytest.mark.parametrize("d", [2, 3])
def test_directions_and_gradients_are_those_of_tangents(d):
    places, room = random_places(np.random.default_rng([1, d]), d, many(20_000))
    u, slope, smooth, _, _ = bends(places, 1e-3 * room)
    found = gradient(places, 1e-3 * room.astype(np.longdouble))
    size = np.linalg.norm(found, axis=(1, 2)).astype(float)
    assert smooth.mean() > 0.7
    assert np.abs(u - direction(places))[smooth].max() < DIGITS
    assert (np.abs(slope + found).max(axis=(1, 2)) / size)[smooth].max() < 1e-7  # u falls as the attachment moves


@pytest.mark.parametrize("d", [2, 3])
def test_no_direction_in_a_ball_leaves_its_bounds(d):
    rng = np.random.default_rng([2, d])
    places, room = random_places(rng, d, many(50_000))
    moved = room * 10 ** rng.uniform(-4, 0.1, len(room))
    u, slope, smooth, steepest, second = bends(places, moved)
    assert smooth.mean() > 0.5
    assert not smooth[moved >= room].any()  # where it may pass the axis or the rim
    places, u, slope = Places(*(each[smooth] for each in places)), u[smooth], slope[smooth]
    moved, steepest, second = moved[smooth], steepest[smooth], second[smooth]
    used = {"change": np.zeros(len(u)), "rest": np.zeros(len(u)), "gradient": np.zeros(len(u))}
    for move in moves_in(rng, places, 0.999 * moved):
        length = np.linalg.norm(move, axis=1)
        change = (direction(places.moved(move)) - direction(places)).astype(float)
        rest = np.linalg.norm(change + np.einsum("kij,kj->ki", slope, move), axis=1)
        there = bends(places.moved(move), np.zeros(len(move)))[1]
        assert (np.linalg.norm(there, 2, axis=(1, 2)) <= steepest * (1 + DIGITS)).all()
        turned = np.linalg.norm(there - slope, 2, axis=(1, 2)) * length
        for name, found, bound in (
            ("change", np.linalg.norm(change, axis=1), steepest * length),
            ("rest", rest, second * length**2 / 2),
            ("gradient", turned, second * length**2),
        ):
            used[name] = np.maximum(used[name], (found - ROUNDING) / bound)
    small = (steepest * moved < 0.05) & (second * moved**2 > 1e-8)
    for shares in used.values():
        assert shares.max() <= 1 + DIGITS
        assert np.median(shares[small]) > 0.3  # nor are they far away
