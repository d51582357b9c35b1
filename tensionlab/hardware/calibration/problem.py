"""Cable lengths on one side, anchors and poses on the other, and how the one changes with the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.hardware.calibration.poses import Poses
from tensionlab.model import kinematics
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted to what. Shared parameters are the anchors, row by row, and the offsets if there are any."""

    rig: Rig
    lengths: Floats
    known: bool
    offsets: bool

    @property
    def gauge(self) -> int:
        """How many combinations of anchors no length depends on: the rigid motions, at unknown poses."""
        d = self.rig.dimension
        return 0 if self.known else d * (d + 1) // 2

    @property
    def spare(self) -> int:
        """How many of the lengths of one pose are left to speak of the anchors?"""
        return self.rig.m - (0 if self.known else self.rig.n)

    @property
    def size(self) -> int:
        """Number of shared parameters."""
        return self.rig.m * (self.rig.dimension + self.offsets)

    def split(self, shared: Floats) -> tuple[Floats, Floats]:
        """Anchors and offsets."""
        m, d = self.rig.m, self.rig.dimension
        return shared[: m * d].reshape(m, d), shared[m * d :] if self.offsets else np.zeros(m)

    def fitted(self, shared: Floats, poses: Poses) -> Poses:
        """Which poses fit the lengths best, given the rest?"""
        if self.known:
            return poses
        anchors, offsets = self.split(shared)
        count = len(self.lengths)
        turns = KINDS[self.rig.kind].turns
        p, R, _, _ = kinematics.solve_pose(
            np.broadcast_to(anchors, (count, *anchors.shape)),
            self.rig.attachments if turns else None,
            self.lengths - offsets,
            poses.position,
            poses.rotation,
        )
        return Poses(p, R)

    def residuals(self, shared: Floats, poses: Poses) -> Floats:
        """Measured less modelled lengths, (K, m)."""
        anchors, offsets = self.split(shared)
        modelled, _ = kinematics.cables(anchors, poses.position, poses.arms(self.rig))
        return self.lengths - offsets - modelled

    def jacobian(self, shared: Floats, poses: Poses) -> Floats:
        """How do the lengths change with the shared parameters, (K, m, p), but for what the poses take up?"""
        anchors, _ = self.split(shared)
        arms = poses.arms(self.rig)
        _, directions = kinematics.cables(anchors, poses.position, arms)
        count, m, d = directions.shape
        rows = np.zeros((count, m, self.size))
        for j in range(m):
            rows[:, j, j * d : (j + 1) * d] = directions[:, j]
            if self.offsets:
                rows[:, j, m * d + j] = 1.0
        if self.known:
            return rows
        q, _ = np.linalg.qr(np.swapaxes(kinematics.structure_matrix(directions, arms), -1, -2))
        return rows - q @ (np.swapaxes(q, -1, -2) @ rows)

    def misfit(self, shared: Floats, poses: Poses) -> float:
        """How far off is a length that the poses do not explain, in m? Root mean square, for each spare one."""
        error = self.residuals(shared, self.fitted(shared, poses))
        return math.sqrt(float(np.sum(error**2)) / (len(error) * self.spare))
