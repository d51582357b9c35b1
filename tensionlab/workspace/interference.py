"""Distances between cables, and from cables to bodies: `cable_distance`, `body_distance`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.model import pose
from tensionlab.model.bodies import Body, PlacedBody, as_segments, place_bodies
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers


class Clearance(NamedTuple):
    """Minimum distance, and the pair that has it."""

    distance: Floats  # (...) in m; below zero where a cable enters a body, infinite where there is no pair
    pair: Integers  # indices of two modules, or of a module and a body, (..., 2); -1 where there is none


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
    return closest_pair(_cables(rig, position, rotation, frames), cable_pairs(rig))


def cable_pairs(rig: Rig) -> Integers:
    """Return the pairs of cables that share neither attachment nor anchor, (k, 2), the smaller index first."""
    anchors = [(module.frame, *module.anchor) for module in rig.modules]
    attachments = list(map(tuple, rig.attachments))
    pairs = combinations(range(rig.m), 2)
    apart = [(i, j) for i, j in pairs if attachments[i] != attachments[j] and anchors[i] != anchors[j]]
    return np.array(apart, dtype=np.int64).reshape(-1, 2)


def body_distance(
    rig: Rig,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
    bodies: Sequence[Body] | None = None,
) -> Clearance:
    """Return the minimum distance from a cable to a body, such as the user's head or torso.

    It is the distance to the surface less the body's sway, not less its margin, and zero or below only where a
    cable can touch or enter the body. The pair are the indices of a module and of a body. What the cables hold is
    close to them by design: end the forearm of a user short of the attachments.

    Parameters
    ----------
    position, rotation, frames
        As in `Rig.structure_matrix`; a body on a frame without modules is at rest unless its pose is given.
    bodies : sequence of Body, optional
        In place of `Rig.bodies`. RigError or ShapeError as of `Rig` and `Rig.structure_matrix`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> head = tl.Body("head", [0.0, 1.2, -0.3], radius=0.12)
    >>> distance, (module, body) = tl.workspace.body_distance(rig, rig.home, bodies=[head])
    >>> f"{distance:.2f} m from {rig.modules[module].name}"
    '0.18 m from top'
    """
    distances = body_distances(rig, position, rotation, frames, bodies)
    *shape, m, count = distances.shape
    return _closest(distances.reshape(*shape, m * count), np.indices((m, count)).reshape(2, -1).T)


def body_distances(
    rig: Rig,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
    bodies: Sequence[Body] | None = None,
) -> Floats:
    """Return the distance of every cable to every body, (..., m, bodies), in m; see `body_distance`."""
    if bodies is not None:
        rig = with_bodies(rig, bodies)
    cables = _cables(rig, position, rotation, frames)
    turn = rig.home_matrix if rotation is None else pose.rotations(rotation, rig.dimension, "rotation")
    place = pose.points(position, rig.dimension, "position")
    placed = place_bodies(rig.bodies, place, turn, rig.at_rest | dict(frames or {}))
    return distances_to_placed(cables, rig.bodies, placed)


def with_bodies(rig: Rig, bodies: Sequence[Body]) -> Rig:
    """Return the same rig with other bodies, and without the poses of frames that then carry nothing."""
    carrying = {*rig.frames, *(body.frame for body in bodies)}
    rest = tuple(pose_at_rest for pose_at_rest in rig.rest if pose_at_rest.name in carrying)
    return replace(rig, bodies=tuple(bodies), rest=rest)


def distances_to_placed(cables: Floats, bodies: Sequence[Body], placed: Sequence[PlacedBody]) -> Floats:
    """Return the distance (..., m, bodies) of cables (..., m, 2, d) to bodies in the world: `body_distance`."""
    segments, shape = as_segments(cables, bodies, placed)
    reaches = np.array([body.radius + body.sway for body in bodies])
    return np.asarray(_native.segment_distances(*segments).reshape(shape) - reaches)


def _cables(rig: Rig, position: ArrayLike, rotation: ArrayLike | None, frames: Frames | None) -> Floats:
    """Return the ends of the straight part of every cable in the world, (..., m, 2, d)."""
    cables = rig.cables(position, rotation, frames)
    vectors = cables.straight[..., None] * cables.directions
    ends = pose.points(position, rig.dimension, "position")[..., None, :]
    ends = np.broadcast_to(ends if cables.arms is None else ends + cables.arms, vectors.shape)
    return np.stack([ends + vectors, ends], axis=-2)


def closest_pair(cables: Floats, pairs: Integers) -> Clearance:
    """Return the minimum distance over pairs (k, 2) of cables (..., m, 2, d)."""
    *shape, m, _, d = cables.shape
    flat = np.zeros((int(np.prod(shape)), m, 2, 3))
    flat[..., :d] = cables.reshape(-1, m, 2, d)
    distances = _native.segment_distances(flat, pairs, None, None) if len(pairs) else np.empty(0)
    return _closest(distances.reshape(*shape, len(pairs)), pairs)


def _closest(distances: Floats, pairs: Integers) -> Clearance:
    """Return the smallest of the distances (..., k), and its pair."""
    if not len(pairs):
        shape = distances.shape[:-1]
        return Clearance(np.full(shape, np.inf), np.full((*shape, 2), -1))
    return Clearance(distances.min(axis=-1), pairs[distances.argmin(axis=-1)])
