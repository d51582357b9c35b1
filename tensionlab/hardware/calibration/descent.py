"""Which anchors and poses fit measured lengths best? Levenberg-Marquardt, and a way out of wrong branches."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.hardware.calibration.poses import Poses
from tensionlab.hardware.calibration.problem import Problem

ITERATION_LIMIT = 200
FIRST_DAMPING = 1e-3
STEP_TOLERANCE = 1e-10
"""Anchors are found when the next step would be shorter than this share of the longest cable."""
RESTARTS = 3
"""How often poses are sought again from those of their neighbours."""
BETTER = 0.999
"""Least gain in squared residuals to go on with that."""
TRIMMED = 0.7
"""Share of the poses that anchors are fitted to at first then."""
NEIGHBOURS = 4
"""How many neighbours each tries."""


def best_fit(problem: Problem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Which shared parameters and poses, near these, explain the lengths best in the least-squares sense?"""
    shared, poses = _descend(problem, shared, problem.fitted(shared, poses))
    if not problem.known:
        for _ in range(RESTARTS):
            trial, trial_poses = _restarted(problem, shared, poses)
            before, after = problem.residuals(shared, poses), problem.residuals(trial, trial_poses)
            if float(np.sum(after**2)) > BETTER * float(np.sum(before**2)):
                break
            shared, poses = trial, trial_poses
    return shared, poses


def _descend(problem: Problem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Levenberg-Marquardt in the shared parameters."""
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


def _restarted(problem: Problem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Is there a better answer when the poses that fit worst do not bend the anchors at first?

    Forward kinematics has many answers, and a pose on a wrong branch pulls all anchors with it.
    """
    error = np.sum(problem.residuals(shared, poses) ** 2, axis=1)
    best = np.argsort(error)[: max(round(TRIMMED * len(error)), 2)]
    part = replace(problem, lengths=problem.lengths[best])
    trial, _ = _descend(part, shared, poses.take(best))
    return _descend(problem, trial, _unflipped(problem, trial, problem.fitted(trial, poses)))


def _unflipped(problem: Problem, shared: Floats, poses: Poses) -> Poses:
    """Which poses fit better if each is sought anew, from neighbours that fit well?

    Forward kinematics has many answers; one on a wrong branch bends all anchors.
    """
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
