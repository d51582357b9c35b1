"""How sure is a number that was found by least squares?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats

CONFIDENCE = 0.95
"""Of all intervals here."""


@dataclass(frozen=True)
class Estimate:
    """A number, and the interval that holds the true one with 95 % confidence; NaN where nothing can be said."""

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
    """Which interval belongs to an estimate, its standard deviation and so many degrees of freedom?"""
    width = quantile(freedom) * deviation
    return Estimate(value, value - width, value + width)


def quantile(freedom: int) -> float:
    """How many standard deviations is half an interval? Student's t; NaN without a degree of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1.0 + CONFIDENCE) / 2.0)) if freedom > 0 else math.nan


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Coefficients of a linear least-squares fit.

    Attributes
    ----------
    coefficients : (p,) array
    covariance : (p, p) array
        Estimated from the residuals; NaN without a degree of freedom.
    freedom : int
        Rows less coefficients.
    residuals : (k,) array
    """

    coefficients: Floats
    covariance: Floats
    freedom: int
    residuals: Floats


def fit(rows: Floats, values: Floats) -> LinearFit:
    """Which coefficients explain the values best: ``rows @ coefficients = values``?

    Parameters
    ----------
    rows : (k, p) array
        Of full column rank.
    values : (k,) array
    """
    coefficients = np.asarray(np.linalg.lstsq(rows, values, rcond=None)[0], dtype=np.float64)
    residuals = values - rows @ coefficients
    freedom = len(values) - rows.shape[1]
    variance = float(residuals @ residuals) / freedom if freedom > 0 else math.nan
    covariance = np.asarray(variance * np.linalg.inv(rows.T @ rows), dtype=np.float64)
    return LinearFit(coefficients, covariance, freedom, residuals)


def ratio(found: LinearFit, top: int, bottom: int) -> Estimate:
    """How sure is the quotient of two coefficients? By its first derivatives (delta method)."""
    a, b = found.coefficients[top], found.coefficients[bottom]
    gradient = np.zeros(len(found.coefficients))
    gradient[top] += 1.0 / b
    gradient[bottom] -= a / b**2
    return around(float(a / b), math.sqrt(gradient @ found.covariance @ gradient), found.freedom)
