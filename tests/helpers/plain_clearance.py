"""Distance of cables from moving bodies by bisection: another way than that of the package."""

import numpy as np
from scipy.spatial.transform import Rotation


def matrices(rng, count, dimension, angle=np.pi):
    """Return random rotations by at most an angle, (count, d, d)."""
    turn = rng.uniform(-angle, angle, count)
    if dimension == 2:
        return np.stack([np.cos(turn), -np.sin(turn), np.sin(turn), np.cos(turn)], axis=-1).reshape(count, 2, 2)
    axis = rng.normal(size=(count, 3))
    return Rotation.from_rotvec(turn[:, None] * axis / np.linalg.norm(axis, axis=-1, keepdims=True)).as_matrix()


def within_ball(rng, count, dimension, radius):
    """Return random vectors (count, d), half of them on the surface of the ball."""
    vectors = rng.normal(size=(count, dimension))
    share = np.where(rng.random(count) < 0.5, 1.0, rng.random(count))
    return radius * share[..., None] * vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def from_body(points, body, origin, axes):
    """Return the vectors (N, d) to points from the nearest ones of a body, less its radius, on a moved frame."""
    local = np.einsum("nij,ni->nj", axes, points - origin)
    if body.size is not None:
        nearest = np.clip(local, body.start - body.size / 2, body.start + body.size / 2)
    elif body.end is None:
        nearest = body.start
    else:
        along = body.end - body.start
        nearest = body.start + np.clip((local - body.start) @ along / (along @ along), 0.0, 1.0)[:, None] * along
    return np.einsum("nij,nj->ni", axes, local - nearest)


def search(starts, ends, body, origin, axes):
    """Return distance (N,) and direction (N, d) from a body to the nearest point of a segment.

    The distance from a convex body is convex along the segment: where it falls, the nearest point is ahead.
    """
    along, low, high = ends - starts, np.zeros(len(starts)), np.ones(len(starts))
    for _ in range(30):
        middle = (low + high) / 2
        falls = np.einsum("ni,ni->n", from_body(starts + middle[:, None] * along, body, origin, axes), along) < 0.0
        low, high = np.where(falls, middle, low), np.where(falls, high, middle)
    gaps = from_body(starts + high[:, None] * along, body, origin, axes)
    distance = np.linalg.norm(gaps, axis=1)
    return distance - body.radius, gaps / np.where(distance > 0.0, distance, 1.0)[:, None]
