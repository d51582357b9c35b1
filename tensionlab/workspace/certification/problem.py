"""Statement to prove for cells of positions: a rig at some rotations, and its requirement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.model import kinematics, pose
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement, as_requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, check_size
from tensionlab.workspace.certification.clearance import ClearanceProblem

# Required in place of wrenches: that some tensions above zero balance each other, whatever the limits.
WRENCH_CLOSURE = "wrench-closure"

MAX_ANGLE_RAD = 0.5  # largest angle about a rotation; beyond, the bounds are of no use

Required = Requirement | ArrayLike | tuple[ArrayLike, float] | Literal["wrench-closure"] | None


class Verdicts(NamedTuple):
    """Verdicts about cells, 1 inside, -1 outside, 0 neither, and the shares (k, 2) of each that are so surely."""

    verdict: NDArray[np.int8]
    shares: Floats


@dataclass(frozen=True, eq=False)
class CellProblem:
    """Rig at some rotations (k), all of which count, and what is required of it.

    Anchors and arms (k, m, d) are in world axes, in m; limits (m,) in N; wrenches (k, w, n), whose torques are
    divided by the length, and all within the radius of them. Each rotation stands for all within the angle, in
    rad, of it; the torque of a weight turns by up to the slack. ``closure``: wrench closure counts in their place.
    With ``clearance``, cables must keep a distance as well.
    """

    anchors: Floats
    arms: Floats
    lower: Floats
    upper: Floats
    wrenches: Floats
    radius: float
    slack: float
    angle: float
    length: float
    closure: bool
    clearance: ClearanceProblem | None = None

    def prove(self, centres: Floats, half_edges: Floats, shares: bool) -> Verdicts:
        """Return what is proved of cells with these centres (k, d) and half edges (d,), in m.

        The shares are 0 and 1 alone unless they are wanted.
        """
        if self.clearance is None:
            return self._prove_wrenches(centres, half_edges, shares)
        clear = self.clearance.decide(self.anchors, self.arms, self.angle, centres, half_edges)
        verdict, found = clear.copy(), _whole(clear)
        free = clear >= 0
        verdict[free], found[free] = self._prove_wrenches(centres[free], half_edges, shares)
        unclear = (clear == 0) & (verdict >= 0)
        verdict[unclear], found[unclear, 0] = 0, 0.0
        return Verdicts(verdict, found)

    def _prove_wrenches(self, centres: Floats, half_edges: Floats, shares: bool) -> Verdicts:
        verdict, found = _native.certify_cells(
            self.anchors,
            self.arms,
            self.lower,
            self.upper,
            self.wrenches,
            self.radius,
            self.slack,
            self.angle,
            self.length,
            self.closure,
            np.ascontiguousarray(centres),
            half_edges,
            shares,
        )
        return Verdicts(verdict, _whole(verdict) if found is None else found)


def cell_problem(
    rig: Rig,
    required: Required,
    rotations: ArrayLike | None,
    angle: float,
    frames: Frames | None,
    clearance: ClearanceProblem | None,
) -> CellProblem:
    """Return what has to be proved; InputError, ShapeError or RigError names the argument that does not suit.

    ``rotations`` is one or several, as in `Rig.structure_matrix`; None is the identity.
    """
    d, n, m = rig.dimension, rig.n, rig.m
    check_size(n, m)
    if not (np.isfinite(angle) and 0 <= angle <= MAX_ANGLE_RAD):
        raise InputError(f"angle is {angle}; give an angle in rad, 0 to {MAX_ANGLE_RAD}")
    if n == d and (rotations is not None or angle):
        raise InputError(f'rig "{rig.name}" is a {rig.kind} rig and cannot turn; leave rotations and angle out')
    if rig.pulleys is not None:
        raise InputError(
            f'rig "{rig.name}" has pulleys, and these proofs hold for fixed anchors; sweep it instead'
        )
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    if anchors.ndim > 2:
        raise InputError("frames: give one pose for each body frame; it is the same all over the region")
    given, matrices = _rotations(rotations, d)
    arms = kinematics.rotate(matrices, rig.attachments) if n > d else np.zeros((1, m, d))
    shape = (len(arms), m, d)
    lower, upper, radius, slack, length = rig.limits.lower, rig.limits.upper, 0.0, 0.0, 1.0
    closure = isinstance(required, str)
    if isinstance(required, str):
        if required != WRENCH_CLOSURE:
            raise InputError(f'required is {required!r:.40}; give wrenches, a Requirement, or "{WRENCH_CLOSURE}"')
        lower, upper = np.zeros(m), np.ones(m)
        wrenches = np.zeros((len(arms), 1, n))
        length = rig.characteristic_length
    else:
        wanted = rig.required if required is None else as_requirement(required)
        wanted.check_rig(rig)
        length = wanted.length_for(rig) if n > d else 1.0
        corners = wanted.at(rig, given) / np.where(np.arange(n) < d, 1.0, length)
        wrenches = np.broadcast_to(corners, (len(arms), *corners.shape[-2:]))
        radius, slack = wanted.ball, _turning_torque(rig, wanted, angle) / length
    free = int((lower < upper).sum())
    if free < n:
        raise InputError(
            f'rig "{rig.name}" has {n} wrench components and {free} cables whose tension can change; give it '
            f"{n} or more"
        )
    return CellProblem(
        np.ascontiguousarray(np.broadcast_to(anchors, shape)),
        np.ascontiguousarray(arms),
        np.ascontiguousarray(lower),
        np.ascontiguousarray(upper),
        np.ascontiguousarray(wrenches),
        float(radius),
        float(slack),
        float(angle),
        float(length),
        closure,
        clearance,
    )


def _rotations(rotations: ArrayLike | None, dimension: int) -> tuple[ArrayLike | None, Floats]:
    """Return the rotations in a row as they were given, and as matrices (k, d, d)."""
    if rotations is None:
        return None, np.eye(dimension)[None]
    given = np.asarray(rotations)
    if given.ndim == (0 if dimension == 2 else 2):
        given = given[None]
    matrices = pose.rotations(given, dimension, "rotations")
    if matrices.ndim != 3 or not len(matrices):
        raise InputError(f"rotations has shape {matrices.shape}; give one, or several in a row")
    return given, matrices


def _whole(verdict: NDArray[np.int8]) -> Floats:
    """Return the shares, (k, 2), of cells that are inside or outside as a whole, or neither."""
    return np.asarray(np.stack([verdict > 0, verdict < 0], axis=1), dtype=np.float64)


def _turning_torque(rig: Rig, required: Requirement, angle: float) -> float:
    """Return by how much the torque of the weight may differ within an angle of a rotation, in N·m."""
    if not (required.gravity and angle and rig.platform is not None and rig.platform.com is not None):
        return 0.0
    weight = float(np.linalg.norm(rig.gravity()[: rig.dimension]))
    return 2 * math.sin(angle / 2) * weight * float(np.linalg.norm(rig.platform.com))
