"""How far are measured forces from those that were asked for?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tensionlab.arrays import Floats, Integers
from tensionlab.errors import ShapeError

WITHIN = 45.0
"""Degrees; every vector of the publication was within."""
RESAMPLES, CONFIDENCE = 2000, 0.95


class Interval(NamedTuple):
    """A number and its 95 % bootstrap interval."""

    value: float
    lower: float
    upper: float


class Deviations(NamedTuple):
    """What is wrong with each of K measured forces?

    Attributes
    ----------
    angle : (K,) array
        Between measured and desired force, in degrees; NaN for a measured force of zero.
    magnitude : (K,) array
        Of the measured force, in N.
    magnitude_error : (K,) array
        How far that is from the desired one, either way, in N.
    vector : (K,) array
        Length of the difference of the two forces, in N.
    """

    angle: Floats
    magnitude: Floats
    magnitude_error: Floats
    vector: Floats


@dataclass(frozen=True)
class Summary:
    """One of the four over all forces.

    Attributes
    ----------
    mean : Interval
        Plain.
    weighted : Interval
        Mean with weights sin(theta), theta from the vertical: over a grid of latitudes and longitudes it is the
        mean over the sphere, while the plain one counts the poles too much.
    largest : float
    """

    mean: Interval
    weighted: Interval
    largest: float


@dataclass(frozen=True)
class Score:
    """All statistics of a validation; of the fields of `Deviations`, and the share of angles up to 45 degrees."""

    angle: Summary
    magnitude: Summary
    magnitude_error: Summary
    vector: Summary
    within: float


def deviations(desired: Floats, measured: Floats) -> Deviations:
    """What is wrong with each measured force?

    Parameters
    ----------
    desired, measured : (..., K, 3) arrays
        In N; no desired force is zero.
    """
    size, wanted = np.linalg.norm(measured, axis=-1), np.linalg.norm(desired, axis=-1)
    across = np.linalg.norm(np.cross(desired, measured), axis=-1)
    along = np.sum(desired * measured, axis=-1)
    angle = np.where(size > 0.0, np.degrees(np.arctan2(across, along)), np.nan)
    return Deviations(angle, size, np.abs(size - wanted), np.linalg.norm(measured - desired, axis=-1))


def score(desired: Floats, measured: Floats, seed: int = 0) -> Score:
    """How good are measured forces?

    Parameters
    ----------
    desired, measured : (K, 3) arrays
        In N.
    seed : int
        Of the bootstrap: whole vectors are drawn again with replacement, 2000 times (Efron 1979, Annals of
        Statistics 7(1); percentiles). It tells how much the choice of vectors matters, on this rig.

    Raises
    ------
    ShapeError
        If there is no vector.
    """
    if not len(desired):
        raise ShapeError("no forces were measured; there is nothing to compare")
    found = deviations(desired, measured)
    weights = np.linalg.norm(desired[:, [0, 2]], axis=-1) / np.linalg.norm(desired, axis=-1)
    drawn = np.random.default_rng(seed).integers(0, len(desired), (RESAMPLES, len(desired)))
    angle, magnitude, magnitude_error, vector = (_summary(column, weights, drawn) for column in found)
    return Score(angle, magnitude, magnitude_error, vector, float(np.mean(found.angle <= WITHIN)))


def _summary(column: Floats, weights: Floats, drawn: Integers) -> Summary:
    ones = np.ones_like(weights)
    mean = _bootstrap(lambda rows: _mean(column[rows], ones[rows]), drawn)
    weighted = _bootstrap(lambda rows: _mean(column[rows], weights[rows]), drawn)
    return Summary(mean, weighted, float(np.max(column)))


def _bootstrap(
    statistic: Callable[[Integers], Floats],
    drawn: Integers,
) -> Interval:
    value = float(statistic(np.arange(drawn.shape[1])))
    tails = (0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0)
    lower, upper = np.quantile(statistic(drawn), tails).tolist()
    return Interval(value, lower, upper)


def _mean(values: Floats, weights: Floats) -> Floats:
    """Weighted mean over the last axis; NaN where all weights are zero."""
    total = weights.sum(axis=-1)
    return np.where(total > 0.0, (values * weights).sum(axis=-1) / np.where(total > 0.0, total, 1.0), np.nan)
