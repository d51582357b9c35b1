"""Statistics of measured forces: alignment of the sensor, deviations, gains and biases of cables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tensionlab.errors import ShapeError
from tensionlab.hardware.calibration.gain import Estimate, LinearFit, around, fit
from tensionlab.model.kinematics import fit_rotation
from tensionlab.support.arrays import Floats
from tensionlab.support.provenance import data_frame

if TYPE_CHECKING:
    import pandas

MAX_ANGLE_DEG = 45.0  # every vector of the publication was within
RESAMPLES, TAILS = 2000, (0.025, 0.975)


def fit_yaw(desired: Floats, measured: Floats) -> Floats:
    """Return the turn about the vertical that fits best, as published: a tilt of the sensor stays.

    The angle is atan2(sum(q_z p_x - q_x p_z), sum(q_x p_x + q_z p_z)), with q the measured forces (K, 3), upright
    already, and p the desired ones. The rotation (3, 3) is that of measured forces.
    """
    p, q = desired, measured
    sine = np.sum(q[:, 2] * p[:, 0] - q[:, 0] * p[:, 2])
    cosine = np.sum(q[:, 0] * p[:, 0] + q[:, 2] * p[:, 2])
    size = np.hypot(sine, cosine)
    if size == 0.0:
        return np.eye(3)
    s, c = sine / size, cosine / size
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_angle(rotation: Floats) -> float:
    """Return the angle of a rotation (3, 3), in degrees."""
    return float(np.degrees(2.0 * np.arcsin(min(np.linalg.norm(rotation - np.eye(3)) / np.sqrt(8.0), 1.0))))


# The publication's, and the one that finds tilt as well.
ALIGNMENTS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "paper": fit_yaw,
    "kabsch": lambda desired, measured: fit_rotation(measured, desired),
}


class Deviations(NamedTuple):
    """Deviations of K measured forces, (K,) each, in N but for the angle."""

    angle: Floats  # between measured and desired force, in degrees; NaN for a measured force of zero
    magnitude: Floats  # of the measured force
    magnitude_error: Floats  # its absolute difference to that of the desired force
    vector: Floats  # length of the error vector


def deviations(desired: Floats, measured: Floats) -> Deviations:
    """Return the deviations of measured forces, (..., K, 3) in N, from desired ones, none of which is zero."""
    size, wanted = np.linalg.norm(measured, axis=-1), np.linalg.norm(desired, axis=-1)
    across = np.linalg.norm(np.cross(desired, measured), axis=-1)
    along = np.sum(desired * measured, axis=-1)
    angle = np.where(size > 0.0, np.degrees(np.arctan2(across, along)), np.nan)
    return Deviations(angle, size, np.abs(size - wanted), np.linalg.norm(measured - desired, axis=-1))


def score(desired: Floats, measured: Floats, seed: int = 0) -> pandas.DataFrame:
    """Return the statistics of measured forces (K, 3) in N; raise `ShapeError` if there is none.

    A row for each field of `Deviations`, and "within", the forces in % whose angle is at most 45 degrees. Columns
    are ``mean`` and ``weighted``, the ends of their 95 % intervals (``mean_lower`` and so on), and ``maximum``.
    Weights are sin(theta), theta from the vertical: over a grid of latitudes and longitudes this is the mean over
    the sphere, while the plain one counts the poles too much.

    In the bootstrap, whole vectors are drawn again with replacement, 2000 times (Efron 1979, Annals of Statistics
    7(1); percentiles). It shows how much the choice of vectors matters, on this rig.
    """
    if not len(desired):
        raise ShapeError("no forces were measured; there is nothing to compare")
    errors = deviations(desired, measured)
    values = np.array([*errors, 100.0 * (errors.angle <= MAX_ANGLE_DEG)])
    drawn = np.random.default_rng(seed).integers(0, len(desired), (RESAMPLES, len(desired)))
    sines = np.linalg.norm(desired[:, [0, 2]], axis=-1) / np.linalg.norm(desired, axis=-1)
    table: dict[str, Floats] = {}
    for name, weights in (("mean", np.ones(len(desired))), ("weighted", sines)):
        with np.errstate(invalid="ignore"):  # all forces may be along the vertical: NaN
            table[name] = (values * weights).sum(axis=-1) / weights.sum()
            means = (values[:, drawn] * weights[drawn]).sum(axis=-1) / weights[drawn].sum(axis=-1)
        table[f"{name}_lower"], table[f"{name}_upper"] = np.quantile(means, TAILS, axis=-1)
    return data_frame(table | {"maximum": values.max(axis=-1)}, [*Deviations._fields, "within"])


@dataclass(frozen=True, eq=False)
class CableEstimates:
    """Gain and bias of each cable, with 95 % confidence."""

    gains: tuple[Estimate, ...]  # true tension per commanded one
    # In N, the smallest that explain the offset: of four cables on a point, three combinations can be measured.
    biases: tuple[Estimate, ...]


def estimate_cables(structure: Floats, tensions: Floats, forces: Floats) -> CableEstimates:
    """Estimate gain and bias of each cable, if positions are right.

    From commanded tensions (K, m) and measured forces (K, 3), in N, in the axes of the structure matrix (3, m).
    """
    regression = fit_cables(structure, tensions, forces)
    m = structure.shape[1]
    inverse = np.linalg.pinv(structure)
    values = np.concatenate([regression.coefficients[:m], inverse @ regression.coefficients[m:]])
    variances = [np.diag(regression.covariance)[:m], np.diag(inverse @ regression.covariance[m:, m:] @ inverse.T)]
    spreads = np.sqrt(np.concatenate(variances))
    estimates = [around(float(v), float(s), regression.freedom) for v, s in zip(values, spreads, strict=True)]
    return CableEstimates(tuple(estimates[:m]), tuple(estimates[m:]))


def fit_cables(structure: Floats, tensions: Floats, forces: Floats) -> LinearFit:
    """Fit the gains (m,) of the cables, and then the offset (3,) that their biases make."""
    count, m = tensions.shape
    columns = [tensions[:, None, :] * structure, np.broadcast_to(np.eye(3), (count, 3, 3))]
    return fit(np.concatenate(columns, axis=2).reshape(-1, m + 3), forces.ravel())
