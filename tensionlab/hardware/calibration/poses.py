"""Poses at which lengths were measured, and those at which they had better be."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats, Integers
from tensionlab.model import kinematics
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig

if TYPE_CHECKING:
    from tensionlab.hardware.calibration.problem import Problem

TILT = 0.3
"""How far advised poses are turned about each axis, in rad."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Where the platform was.

    Attributes
    ----------
    position : (K, d) array
        Of the reference point, in m.
    rotation : (K, d, d) array or None
        Platform to world; None for a point.
    """

    position: Floats
    rotation: Floats | None

    @classmethod
    def at(cls, rig: Rig, position: Floats, rotation: Floats | None = None) -> Poses:
        """Poses of a rig; not turned if no rotation is given."""
        if not KINDS[rig.kind].turns:
            return cls(position, None)
        if rotation is None:
            rotation = np.tile(np.eye(rig.dimension), (len(position), 1, 1))
        return cls(position, rotation)

    def arms(self, rig: Rig) -> Floats | None:
        """From the reference point to the attachments, in world axes, (K, m, d); None for a point."""
        return None if self.rotation is None else kinematics.rotate(self.rotation, rig.attachments)

    def take(self, index: Integers) -> Poses:
        """Some of them."""
        return Poses(self.position[index], None if self.rotation is None else self.rotation[index])

    def replaced(self, where: NDArray[np.bool_], other: Poses) -> Poses:
        """These, with others where they are to be replaced; ``where`` is (K,)."""
        position = np.where(where[:, None], other.position, self.position)
        if self.rotation is None or other.rotation is None:
            return Poses(position, None)
        return Poses(position, np.where(where[:, None, None], other.rotation, self.rotation))


def advice(problem: Problem, shared: Floats, weak: Floats) -> str:
    """At which poses would a motion of the anchors that went unseen be seen best? As words.

    Tried are the corners and middles of a box somewhat smaller than the anchors', not turned and turned.
    """
    rig = problem.rig
    low, high = rig.anchors.min(axis=0), rig.anchors.max(axis=0)
    room = np.maximum(high - low, 0.5 * float((high - low).max()))
    steps = itertools.product((-0.35, 0.0, 0.35), repeat=rig.dimension)
    places = (low + high) / 2.0 + room * np.array(list(steps))
    turns = [np.zeros(rig.n - rig.dimension)]
    if rig.n > rig.dimension:
        turns += [sign * TILT * axis for axis in np.eye(rig.n - rig.dimension) for sign in (1.0, -1.0)]
    position = np.repeat(places, len(turns), axis=0)
    angles = np.tile(np.array(turns), (len(places), 1))
    poses = Poses.at(rig, position, None if rig.n == rig.dimension else rotations(angles))
    seen = np.linalg.norm(problem.jacobian(shared, poses) @ weak, axis=-1)
    best = np.argsort(-seen)[:3]
    return ", ".join(_words(position[k], angles[k]) for k in best)


def rotations(angles: Floats) -> Floats:
    """Which matrices are turns by an axis times an angle (K, 3), or by angles in the plane (K, 1), in rad?"""
    if angles.shape[-1] == 3:
        return kinematics.exponential(angles)
    return kinematics.planar_rotation(angles[..., 0])


def _words(position: Floats, angles: Floats) -> str:
    place = "(" + ", ".join(f"{value:.2g}" for value in position) + ") m"
    if not np.any(angles):
        return place
    return f"{place} turned by (" + ", ".join(f"{value:.1g}" for value in angles) + ") rad"
