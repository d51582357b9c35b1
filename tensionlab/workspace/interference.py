"""Distances between cables, and from cables to bodies: `cable_distance`, `body_distance`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.model import pose
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers, common_axes


class Capsule(NamedTuple):
    """Body: all points within a radius, in m, of a segment; a sphere, such as a head, has no ``end``.

    The ends, (..., d), are in the world, in m; leading axes broadcast with the poses, so that a body can move.

    Examples
    --------
    >>> import tensionlab as tl
    >>> torso = tl.workspace.Capsule([0.0, 0.9, -0.3], [0.0, 1.4, -0.3], radius=0.2)
    >>> head = tl.workspace.Capsule([0.0, 1.6, -0.3], radius=0.12)
    """

    start: ArrayLike
    end: ArrayLike | None = None
    radius: float = 0.0


class Clearance(NamedTuple):
    """Minimum distance (...), in m, and the pair (..., 2) that has it.

    Below zero where a cable enters a body, infinite where there is no pair to measure. The pair are indices of two
    modules, or of a module and a body; -1 where there is none.
    """

    distance: Floats
    pair: Integers


def cable_distance(
    rig: Rig, position: ArrayLike, rotation: ArrayLike | None = None, frames: Frames | None = None
) -> Clearance:
    """Return the minimum distance between two cables, and their indices.

    Cables that share an attachment, or an anchor, touch there by design, and two straight cables through one point
    meet nowhere else: such pairs are left out. A point rig has no others, and its distance is infinite. Cables are
    lines without thickness: compare the distance with their diameter.

    Source: Lumelsky, "On fast computation of distance between line segments", 1985; Perreault, Cardou, Gosselin
    and Otis, "Geometric determination of the interference-free constant-orientation workspace of parallel
    cable-driven mechanisms", 2010.

    Poses and errors are as in `Rig.structure_matrix`; leading axes broadcast.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("ipanema-1")
    >>> distance, pair = tl.workspace.cable_distance(rig, rig.home)
    >>> f"{distance:.3f} m"
    '0.120 m'
    """
    return closest(_cables(rig, position, rotation, frames), cable_pairs(rig), np.zeros(rig.m))


def cable_pairs(rig: Rig) -> Integers:
    """Return the pairs of cables that share neither attachment nor anchor, (k, 2), the smaller index first."""
    anchors = [(module.frame, *module.anchor) for module in rig.modules]
    attachments = list(map(tuple, rig.attachments))
    pairs = combinations(range(rig.m), 2)
    apart = [(i, j) for i, j in pairs if attachments[i] != attachments[j] and anchors[i] != anchors[j]]
    return np.array(apart, dtype=np.int64).reshape(-1, 2)


def body_distance(
    rig: Rig,
    bodies: Sequence[Capsule],
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
) -> Clearance:
    """Return the minimum distance from a cable to a body, such as the user's head or torso.

    What the cables hold is close to them by design: end the forearm of a user short of the attachments. The pair
    are the indices of a module and of a body. ShapeError or InputError for bodies of other coordinates, negative
    radii, or too many of them. Other parameters, errors and source as in `cable_distance`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> head = tl.workspace.Capsule([0.0, 1.2, -0.3], radius=0.12)
    >>> distance, (module, body) = tl.workspace.body_distance(rig, [head], rig.home)
    >>> f"{distance:.2f} m from {rig.modules[module].name}"
    '0.18 m from top'
    """
    cables = _cables(rig, position, rotation, frames)
    segments, radii = body_segments(bodies, rig.dimension)
    shapes = {"cables": cables.shape[:-3]} | {f"body {i}": s.shape[:-3] for i, s in enumerate(segments)}
    shape = common_axes(shapes)
    everything = [np.broadcast_to(s, (*shape, *s.shape[-3:])) for s in (cables, *segments)]
    found = closest(np.concatenate(everything, axis=-3), body_pairs(rig, bodies), np.array([0.0] * rig.m + radii))
    return found._replace(pair=np.where(found.pair < 0, -1, found.pair - [0, rig.m]))


def _cables(rig: Rig, position: ArrayLike, rotation: ArrayLike | None, frames: Frames | None) -> Floats:
    """Return the ends of the straight part of every cable in the world, (..., m, 2, d)."""
    cables = rig.cables(position, rotation, frames)
    vectors = cables.straight[..., None] * cables.directions
    ends = pose.points(position, rig.dimension, "position")[..., None, :]
    ends = np.broadcast_to(ends if cables.arms is None else ends + cables.arms, vectors.shape)
    return np.stack([ends + vectors, ends], axis=-2)


def body_pairs(rig: Rig, bodies: Sequence[Capsule]) -> Integers:
    """Return the pairs of every cable with every body, (k, 2); bodies are numbered after the cables."""
    pairs = [(i, rig.m + j) for i in range(rig.m) for j in range(len(bodies))]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def body_segments(bodies: Sequence[Capsule], dimension: int) -> tuple[list[Floats], list[float]]:
    """Return the segment of each body, (..., 1, 2, d), and its radius, in m; see `body_distance` for errors."""
    segments, radii = [], []
    for index, body in enumerate(bodies):
        start = pose.points(body.start, dimension, f"start of body {index}")
        end = start if body.end is None else pose.points(body.end, dimension, f"end of body {index}")
        if not (np.isfinite(body.radius) and body.radius >= 0):
            raise InputError(f"radius of body {index} is {body.radius}; give a radius in m, 0 or more")
        segments.append(np.stack(np.broadcast_arrays(start, end), axis=-2)[..., None, :, :])
        radii.append(float(body.radius))
    return segments, radii


def closest(segments: Floats, pairs: Integers, radii: NDArray[np.float64]) -> Clearance:
    """Return the minimum distance over pairs of segments, (..., S, 2, d), less the radii of both."""
    *shape, count, _, d = segments.shape
    if count > _native.MAX_SEGMENTS:
        raise InputError(f"{count} cables and bodies; at most {_native.MAX_SEGMENTS} can be measured at once")
    flat = np.zeros((int(np.prod(shape)), count, 2, 3))
    flat[..., :d] = segments.reshape(-1, count, 2, d)
    distance, index = _native.closest_pair(flat, pairs, radii)
    which = np.concatenate([pairs, [[-1, -1]]])[index]  # index -1, where there is no pair, is the last row
    return Clearance(distance.reshape(shape), which.reshape(*shape, 2))
