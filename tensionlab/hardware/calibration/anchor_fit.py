"""Fit of anchors and poses to cable lengths."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.model import kinematics
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers

TILT_RAD = 0.3  # how far advised poses are turned about each axis, in rad


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the platform.

    `position` (K, d) is of the reference point, in m; `rotation` (K, d, d) is platform to world, None for a point.
    """

    position: Floats
    rotation: Floats | None

    @classmethod
    def at(cls, rig: Rig, position: Floats, rotation: Floats | None = None) -> Poses:
        """Return poses of a rig; not turned if no rotation is given."""
        if not KINDS[rig.kind].has_orientation:
            return cls(position, None)
        if rotation is None:
            rotation = np.tile(np.eye(rig.dimension), (len(position), 1, 1))
        return cls(position, rotation)

    def arms(self, rig: Rig) -> Floats | None:
        """Return vectors from reference point to attachments, in world axes, (K, m, d); None for a point."""
        return None if self.rotation is None else kinematics.rotate(self.rotation, rig.attachments)

    def take(self, index: Integers) -> Poses:
        """Return some of the poses."""
        return Poses(self.position[index], None if self.rotation is None else self.rotation[index])

    def replaced(self, where: NDArray[np.bool_], other: Poses) -> Poses:
        """Return these poses with others in place of some; ``where`` is (K,)."""
        position = np.where(where[:, None], other.position, self.position)
        if self.rotation is None or other.rotation is None:
            return Poses(position, None)
        return Poses(position, np.where(where[:, None, None], other.rotation, self.rotation))


def advice(problem: AnchorProblem, shared: Floats, weak: Floats) -> str:
    """Return the poses, as words, at which lengths would best show an unseen motion of the anchors.

    Tried are the corners and middles of a box somewhat smaller than the anchors', not turned and turned.
    """
    rig = problem.rig
    low, high = rig.anchors.min(axis=0), rig.anchors.max(axis=0)
    room = np.maximum(high - low, 0.5 * float((high - low).max()))
    steps = itertools.product((-0.35, 0.0, 0.35), repeat=rig.dimension)
    places = (low + high) / 2.0 + room * np.array(list(steps))
    turns = [np.zeros(rig.n - rig.dimension)]
    if rig.n > rig.dimension:
        turns += [sign * TILT_RAD * axis for axis in np.eye(rig.n - rig.dimension) for sign in (1.0, -1.0)]
    position = np.repeat(places, len(turns), axis=0)
    angles = np.tile(np.array(turns), (len(places), 1))
    poses = Poses.at(rig, position, None if rig.n == rig.dimension else rotations(angles))
    seen = np.linalg.norm(problem.jacobian(shared, poses) @ weak, axis=-1)
    best = np.argsort(-seen)[:3]
    return ", ".join(_words(position[k], angles[k]) for k in best)


def rotations(angles: Floats) -> Floats:
    """Return rotations by an axis times an angle (K, 3), or by angles in the plane (K, 1), in rad."""
    if angles.shape[-1] == 3:
        return kinematics.exponential(angles)
    return kinematics.planar_rotation(angles[..., 0])


def _words(position: Floats, angles: Floats) -> str:
    place = "(" + ", ".join(f"{value:.2g}" for value in position) + ") m"
    if not np.any(angles):
        return place
    return f"{place} turned by (" + ", ".join(f"{value:.1g}" for value in angles) + ") rad"


@dataclass(frozen=True, eq=False)
class AnchorProblem:
    """Lengths to be fitted, by shared parameters (anchors row by row, and offsets if there are any) and poses."""

    rig: Rig
    lengths: Floats
    known: bool
    offsets: bool

    @property
    def gauge(self) -> int:
        """Number of combinations of anchors that no length depends on: rigid motions, at unknown poses."""
        d = self.rig.dimension
        return 0 if self.known else d * (d + 1) // 2

    @property
    def spare(self) -> int:
        """Number of lengths of one pose that remain to determine anchors."""
        return self.rig.m - (0 if self.known else self.rig.n)

    @property
    def size(self) -> int:
        """Number of shared parameters."""
        return self.rig.m * (self.rig.dimension + self.offsets)

    def split(self, shared: Floats) -> tuple[Floats, Floats]:
        """Return anchors and offsets."""
        m, d = self.rig.m, self.rig.dimension
        return shared[: m * d].reshape(m, d), shared[m * d :] if self.offsets else np.zeros(m)

    def fitted(self, shared: Floats, poses: Poses) -> Poses:
        """Return the poses that fit the lengths best, given the rest."""
        if self.known:
            return poses
        anchors, offsets = self.split(shared)
        count = len(self.lengths)
        turns = KINDS[self.rig.kind].has_orientation
        p, R, _, _ = kinematics.solve_pose(
            np.broadcast_to(anchors, (count, *anchors.shape)),
            self.rig.attachments if turns else None,
            self.lengths - offsets,
            poses.position,
            poses.rotation,
            self.rig.pulleys,
        )
        return Poses(p, R)

    def residuals(self, shared: Floats, poses: Poses) -> Floats:
        """Return measured less modelled lengths, (K, m)."""
        anchors, offsets = self.split(shared)
        modelled, _ = kinematics.cables(anchors, poses.position, poses.arms(self.rig), self.rig.pulleys)
        return self.lengths - offsets - modelled

    def jacobian(self, shared: Floats, poses: Poses) -> Floats:
        """Return the derivatives of the lengths by shared parameters, (K, m, p), less what the poses take up."""
        anchors, _ = self.split(shared)
        arms = poses.arms(self.rig)
        _, directions = kinematics.cables(anchors, poses.position, arms, self.rig.pulleys)
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
        """Return the root mean square error of the lengths that poses do not explain, in m."""
        error = self.residuals(shared, self.fitted(shared, poses))
        return math.sqrt(float(np.sum(error**2)) / (len(error) * self.spare))


ITERATION_LIMIT = 200
FIRST_DAMPING = 1e-3
# Anchors are found when the next step would be shorter than this share of the longest cable.
STEP_TOLERANCE = 1e-10
RESTARTS = 3  # how often poses are sought again from those of their neighbours
BETTER = 0.999  # least gain in squared residuals to go on with that
TRIMMED = 0.7  # share of the poses that anchors are fitted to at first then
NEIGHBOURS = 4  # how many neighbours each tries


def best_fit(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Return the shared parameters and poses, near these, that fit the lengths best by least squares."""
    shared, poses = _descend(problem, shared, problem.fitted(shared, poses))
    if not problem.known:
        for _ in range(RESTARTS):
            trial, trial_poses = _restarted(problem, shared, poses)
            before, after = problem.residuals(shared, poses), problem.residuals(trial, trial_poses)
            if float(np.sum(after**2)) > BETTER * float(np.sum(before**2)):
                break
            shared, poses = trial, trial_poses
    return shared, poses


def _descend(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Minimise over the shared parameters by Levenberg-Marquardt."""
    error = problem.residuals(shared, poses)
    damping, longest = FIRST_DAMPING, float(problem.lengths.max())
    for _ in range(ITERATION_LIMIT):
        rows = problem.jacobian(shared, poses).reshape(-1, problem.size)
        # Rigid motions change nothing: with the damping as a ridge, steps leave them alone.
        ridge = math.sqrt(damping * float(np.mean(rows**2)) * len(rows)) * np.eye(problem.size)
        step = np.linalg.lstsq(
            np.vstack([rows, ridge]), np.append(error.ravel(), np.zeros(problem.size)), rcond=None
        )[0]
        trial = shared + step
        trial_poses = problem.fitted(trial, poses)
        trial_error = problem.residuals(trial, trial_poses)
        better = float(np.sum(trial_error**2)) < float(np.sum(error**2))
        if better:
            shared, poses, error = trial, trial_poses, trial_error
        damping = max(damping / 10.0, 1e-14) if better else damping * 10.0
        if float(np.abs(step).max()) <= STEP_TOLERANCE * longest or damping > 1e8:
            break
    return shared, poses


def _restarted(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Fit again, first without the poses that fit worst.

    Forward kinematics has many answers, and a pose on a wrong branch pulls all anchors with it.
    """
    error = np.sum(problem.residuals(shared, poses) ** 2, axis=1)
    best = np.argsort(error)[: max(round(TRIMMED * len(error)), 2)]
    part = replace(problem, lengths=problem.lengths[best])
    trial, _ = _descend(part, shared, poses.take(best))
    return _descend(problem, trial, _unflipped(problem, trial, problem.fitted(trial, poses)))


def _unflipped(problem: AnchorProblem, shared: Floats, poses: Poses) -> Poses:
    """Solve each pose again from neighbours that fit well, and return the better ones."""
    error = np.sum(problem.residuals(shared, poses) ** 2, axis=1)
    good = np.argsort(error)[: max(len(error) // 2, 1)]
    apart = np.linalg.norm(problem.lengths[:, None] - problem.lengths[None, good], axis=-1)
    nearest = good[np.argsort(apart, axis=1)[:, :NEIGHBOURS]]
    for start in (poses.take(column) for column in nearest.T):
        trial = problem.fitted(shared, start)
        trial_error = np.sum(problem.residuals(shared, trial) ** 2, axis=1)
        better = trial_error < error
        poses, error = poses.replaced(better, trial), np.where(better, trial_error, error)
    return poses
