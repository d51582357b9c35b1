"""Calibration of a module's tension per ampere, friction and zero, with confidence intervals.

A cable that is just being reeled in under a weight w needs the current of ``k (I - I0) = w + f``; one that just
begins to pay out, of ``k (I - I0) = w - f``. Half of the difference is the friction f, so k and the zero I0 are
free of it. With a force sensor in place of the weight, its force takes the place of w, and the hysteresis between
a staircase up and down that of the two directions. See Bartels et al. 2026 for the modules; separating friction by
the direction of motion is standard in identifying robots (Armstrong-Hélouvry et al. 1994, Automatica 30(7)).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensionlab.errors import CalibrationError
from tensionlab.support.arrays import Floats

CONFIDENCE = 0.95  # level of all intervals here


@dataclass(frozen=True)
class Estimate:
    """Number with its 95 % confidence interval; NaN where it is not known."""

    value: float
    lower: float
    upper: float

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return (self.upper - self.lower) / 2.0

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper


def around(value: float, deviation: float, freedom: int) -> Estimate:
    """Return the estimate of a value, its standard deviation and degrees of freedom."""
    width = quantile(freedom) * deviation
    return Estimate(value, value - width, value + width)


def quantile(freedom: int) -> float:
    """Return half an interval in standard deviations (Student's t); NaN without a degree of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1.0 + CONFIDENCE) / 2.0)) if freedom > 0 else math.nan


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Linear least-squares fit."""

    coefficients: Floats  # (p,)
    covariance: Floats  # (p, p) by the residuals; NaN without a degree of freedom
    freedom: int  # number of rows minus coefficients
    residuals: Floats  # (k,)


def fit(rows: Floats, values: Floats) -> LinearFit:
    """Fit ``rows @ coefficients = values`` by least squares; rows (k, p) have full column rank."""
    coefficients = np.asarray(np.linalg.lstsq(rows, values, rcond=None)[0], dtype=np.float64)
    residuals = values - rows @ coefficients
    freedom = len(values) - rows.shape[1]
    variance = float(residuals @ residuals) / freedom if freedom > 0 else math.nan
    covariance = np.asarray(variance * np.linalg.inv(rows.T @ rows), dtype=np.float64)
    return LinearFit(coefficients, covariance, freedom, residuals)


def _ratio(found: LinearFit, top: int, bottom: int) -> Estimate:
    """Return the estimate of the quotient of two coefficients, by the delta method."""
    a, b = found.coefficients[top], found.coefficients[bottom]
    gradient = np.zeros(len(found.coefficients))
    gradient[top] += 1.0 / b
    gradient[bottom] -= a / b**2
    return around(float(a / b), math.sqrt(gradient @ found.covariance @ gradient), found.freedom)


@dataclass(frozen=True)
class Balance:
    """Force at the cable's far end, by a weight or a sensor, and the motor current that balances it."""

    force: float  # N
    current: float  # A
    direction: int  # 1 while the cable is being reeled in, -1 while it pays out


@dataclass(frozen=True)
class GainEstimate:
    """Estimate of a module's tension per ampere."""

    gain: Estimate  # N/A
    friction: Estimate  # N at the cable to set it in motion, cogging included
    zero: Estimate | None  # current in A without a tension; None with a single weight, where it is taken to be 0
    previous_gain: float  # N/A of the module until now
    before: float  # rms error of the tension by the currents and the previous gain, in N, friction not counted
    after: float  # the same by the gain and zero found
    balances: tuple[Balance, ...]


def gain_from_weights(balances: Sequence[Balance], previous_gain: float) -> GainEstimate:
    """Estimate N/A, friction and zero from the currents that weights needed.

    The weights are known better than the currents, so currents are fitted: ``I = w / k ± f / k + I0``. A
    `CalibrationError` refuses too few balances, only one direction, or currents that do not grow with the weight.
    """
    force, current, direction = _columns(balances)
    several = float(np.ptp(force)) > 0.0
    fitted = fit(np.column_stack([force, direction, *([np.ones(len(force))] if several else [])]), current)
    slope = around(fitted.coefficients[0], math.sqrt(fitted.covariance[0, 0]), fitted.freedom)
    if not slope.lower > 0.0:
        raise CalibrationError(
            "the current does not grow with the weight beyond doubt; take weights that differ more"
        )
    zero = around(fitted.coefficients[2], math.sqrt(fitted.covariance[2, 2]), fitted.freedom) if several else None
    gain = Estimate(1.0 / slope.value, 1.0 / slope.upper, 1.0 / slope.lower)
    return _estimate(balances, gain, _ratio(fitted, 1, 0), zero, previous_gain)


def gain_from_sensor(balances: Sequence[Balance], previous_gain: float) -> GainEstimate:
    """Estimate N/A, friction and zero from the forces that a sensor measured at some currents.

    Forces are fitted: ``F = k I - f direction - k I0``. A zero of the sensor itself shows as one of the current.
    Errors as those of `gain_from_weights`.
    """
    force, current, direction = _columns(balances)
    fitted = fit(np.column_stack([current, -direction, -np.ones(len(force))]), force)
    deviations = np.sqrt(np.diag(fitted.covariance))
    gain = around(fitted.coefficients[0], deviations[0], fitted.freedom)
    if not gain.lower > 0.0:
        raise CalibrationError(
            "the force does not grow with the current beyond doubt; do the sensor's file and the record belong "
            "together, and is pulling positive?"
        )
    friction = around(fitted.coefficients[1], deviations[1], fitted.freedom)
    return _estimate(balances, gain, friction, _ratio(fitted, 2, 0), previous_gain)


def _columns(balances: Sequence[Balance]) -> tuple[Floats, Floats, Floats]:
    force, current, direction = np.array(
        [(each.force, each.current, each.direction) for each in balances], dtype=np.float64
    ).T
    if len(balances) < 4 or not np.ptp(direction):
        raise CalibrationError(
            f"{len(balances)} balances in {len(set(direction))} direction(s) are not enough; measure at least "
            "twice in each direction"
        )
    return force, current, direction


def _estimate(
    balances: Sequence[Balance], gain: Estimate, friction: Estimate, zero: Estimate | None, previous_gain: float
) -> GainEstimate:
    force, current, direction = _columns(balances)
    tension = force + friction.value * direction
    modelled = previous_gain * current, gain.value * (current - (zero.value if zero else 0.0))
    before, after = (math.sqrt(float(np.mean((each - tension) ** 2))) for each in modelled)
    return GainEstimate(gain, friction, zero, previous_gain, before, after, tuple(balances))
