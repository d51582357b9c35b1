"""How good are the answers of a solver? Measures that are the same wherever solvers are compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab.allocation import Allocation
from tensionlab.arrays import Floats, Integers, angles
from tensionlab.solvers.base import Nearest, Status


@dataclass(frozen=True)
class Score:
    """How good are the answers of one solver with one policy? NaN where nothing was measured.

    Attributes
    ----------
    solver, nearest : str
        Name of the solver, and its policy where the force is out of reach; None if it honours no policy.
    exact, nearest_count, iteration_limit, failed : int
        How many vectors ended with which proved status.
    residual_mean, residual_max : float
        Norm of desired minus rendered wrench, over all vectors that did not fail, in N.
    angle_mean_deg, angle_max_deg : float
        Angle between desired and rendered force; vectors that render no force at all have none.
    tension_sq_mean : float
        Mean of the squared tensions, over modules and vectors, in N².
    """

    solver: str
    nearest: Nearest | None
    exact: int
    nearest_count: int
    iteration_limit: int
    failed: int
    residual_mean: float
    residual_max: float
    angle_mean_deg: float
    angle_max_deg: float
    tension_sq_mean: float


def score(solver: str, nearest: Nearest | None, wrenches: Floats, found: Allocation, dimension: int) -> Score:
    """How good are a solver's answers?

    Parameters
    ----------
    solver, nearest
        Whose answers they are.
    wrenches : (K, n) array
        What was asked for.
    found : Allocation
        The answers, K of them.
    dimension : int
        The first so many components of a wrench are the force.
    """
    angle = angles(wrenches[:, :dimension], found.wrench[:, :dimension])
    return Score(
        solver=solver,
        nearest=nearest,
        exact=int(np.sum(found.status == Status.EXACT)),
        nearest_count=int(np.sum(found.status == Status.NEAREST)),
        iteration_limit=int(np.sum(found.status == Status.ITERATION_LIMIT)),
        failed=int(np.sum(found.status == Status.FAILED)),
        residual_mean=finite(np.mean, found.residual),
        residual_max=finite(np.max, found.residual),
        angle_mean_deg=finite(np.mean, angle),
        angle_max_deg=finite(np.max, angle),
        tension_sq_mean=finite(np.mean, found.tensions**2),
    )


def finite(measure: Callable[[Any], Any], values: Floats | Integers) -> float:
    """Mean or largest of the entries that are numbers; NaN where there is none."""
    values = values[np.isfinite(values)]
    return float(measure(values)) if values.size else np.nan
