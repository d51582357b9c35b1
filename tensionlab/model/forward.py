"""Which pose do measured cable lengths belong to?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats, Integers
from tensionlab.model import kinematics, pose

STEP_TOLERANCE = 1e-13
"""A pose is found when the next step would change the lengths by less than this share of the longest."""

ITERATION_LIMIT = 100
FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e10
RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A pose found from cable lengths, and how well it explains them.

    Attributes
    ----------
    position : (..., d) array
        Of the reference point, in m.
    rotation : (..., 3, 3) array, (...) array or None
        Orientation: a matrix in space, an angle in (-pi, pi] in the plane, None for a point.
    residual : (...) array
        Root mean square of the length errors, in m. Large means that no pose near the guess has these
        lengths.
    iterations : (...) array
        Steps tried.
    """

    position: Floats
    rotation: Floats | None
    residual: Floats
    iterations: Integers


def estimate(
    anchors: Floats, attachments: Floats | None, lengths: Floats, position: Floats, rotation: Floats | None
) -> PoseEstimate:
    """Which poses near the guesses have these cable lengths? Broadcasts, then calls `solve`.

    Parameters
    ----------
    anchors : (..., m, d) array
    attachments : (m, d) array or None
        In platform axes; None for a point.
    lengths : (..., m) array
    position : (..., d) array
        Guesses.
    rotation : (..., d, d) array or None
        Guesses; None for the identity.
    """
    m, d = anchors.shape[-2:]
    turn = np.eye(d) if rotation is None else rotation
    shapes = {"lengths": lengths.shape[:-1], "position": position.shape[:-1], "rotation": turn.shape[:-2]}
    batch = pose.common_shape({**shapes, "frames": anchors.shape[:-2]})
    p, R, residual, iterations = solve(
        np.broadcast_to(anchors, (*batch, m, d)).reshape(-1, m, d),
        attachments,
        np.broadcast_to(lengths, (*batch, m)).reshape(-1, m),
        np.broadcast_to(position, (*batch, d)).reshape(-1, d),
        None if attachments is None else np.broadcast_to(turn, (*batch, d, d)).reshape(-1, d, d),
    )
    if R is None:
        found = None
    elif d == 2:
        found = np.arctan2(R[:, 1, 0], R[:, 0, 0]).reshape(batch)
    else:
        found = R.reshape(*batch, d, d)
    return PoseEstimate(p.reshape(*batch, d), found, residual.reshape(batch), iterations.reshape(batch))


def solve(
    anchors: Floats, attachments: Floats | None, lengths: Floats, position: Floats, rotation: Floats | None
) -> tuple[Floats, Floats | None, Floats, Integers]:
    """Which poses near the guesses have these cable lengths, in the least-squares sense?

    Levenberg-Marquardt (Marquardt 1963) on the twist: the derivative of the lengths is ``J = -W'`` in closed
    form, the damping is scaled by the diagonal of ``J'J`` so that metres and radians need no common unit,
    and a step turns the platform by the exponential map. A pose that has been found leaves the batch.

    Parameters
    ----------
    anchors : (B, m, d) array
    attachments : (m, d) array or None
        In platform axes; None for a point.
    lengths : (B, m) array
    position : (B, d) array
        Guesses.
    rotation : (B, d, d) array or None
        Guesses; None for a point.

    Returns
    -------
    position, rotation, residual, iterations
        As in `PoseEstimate`, with rotations as (B, d, d) matrices.
    """
    position = position.copy()
    rotation = None if rotation is None else rotation.copy()
    batch, d = position.shape
    residual = np.zeros(batch)
    iterations: NDArray[np.int64] = np.zeros(batch, dtype=np.int64)
    damping = np.full(batch, FIRST_DAMPING)
    active = np.arange(batch)

    while active.size:
        A, L, p = anchors[active], lengths[active], position[active]
        R = None if rotation is None else rotation[active]
        error, W = _errors(A, attachments, L, p, R)
        cost = np.mean(error**2, axis=-1)
        residual[active] = np.sqrt(cost)

        # The lengths fall short by `error` and change by J twist = -W' twist, so J'J = WW' and J'error = -W
        # error.
        normal = W @ np.swapaxes(W, -1, -2)
        diagonal = np.einsum("...ii->...i", normal)
        scale = diagonal + RIDGE * diagonal.max(axis=-1, keepdims=True)
        damped = normal + (damping[active, None] * scale)[..., None] * np.eye(W.shape[-2])
        step = -np.linalg.solve(damped, W @ error[..., None])[..., 0]
        predicted = np.sqrt(np.mean(np.einsum("...nm,...n->...m", W, step) ** 2, axis=-1))

        trial_p, trial_R = p + step[:, :d], None if R is None else _turn(R, step[:, d:])
        trial_cost = np.mean(_errors(A, attachments, L, trial_p, trial_R)[0] ** 2, axis=-1)
        better = trial_cost < cost
        position[active[better]] = trial_p[better]
        if rotation is not None and trial_R is not None:
            rotation[active[better]] = trial_R[better]
        residual[active[better]] = np.sqrt(trial_cost[better])
        damping[active] = np.where(better, np.maximum(damping[active] / 30, 1e-15), damping[active] * 10)
        iterations[active] += 1

        found = predicted <= STEP_TOLERANCE * L.max(axis=-1)
        stopped = (damping[active] > LARGEST_DAMPING) | (iterations[active] >= ITERATION_LIMIT)
        active = active[~(found | stopped)]

    return position, rotation, residual, iterations


def _errors(A: Floats, b: Floats | None, L: Floats, p: Floats, R: Floats | None) -> tuple[Floats, Floats]:
    """Measured minus modelled lengths, and the structure matrices."""
    arms = None if b is None or R is None else kinematics.rotate(R, b)
    lengths, directions = kinematics.cables(A, p, arms)
    return L - lengths, kinematics.structure_matrix(directions, arms)


def _turn(R: Floats, angle: Floats) -> Floats:
    """Rotate orientations by small turns in world axes."""
    turn = kinematics.exponential(angle) if angle.shape[-1] == 3 else kinematics.planar_rotation(angle[..., 0])
    return turn @ R
