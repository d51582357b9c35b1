"""A proof that tensions are the best: a bound on their distance to the optimum, from any multipliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.solvers.base import Problem
from tensionlab.solvers.linear import times

Flags = NDArray[np.bool_]

AT_LIMIT = 1e-10
"""A tension this close to a limit is at it, as a share of the largest limit."""
ENOUGH = 1e-7
"""A bound of this share of the largest limit needs no better multipliers."""
REACHES = (1e1, 1e3, 1e5)
"""Lengths of the separating direction that are tried in the multipliers, times the largest limit."""


def distance_bound(problem: Problem, tensions: Floats, separation: Floats | None = None) -> Floats:
    """How far can tensions be, at most, from those closest to the reference that render the same wrench?

    For any multipliers y, tensions t are the optimum of a reference near t0: the one that is moved by
    ``e = t - t0 - W'y`` between the limits, by the negative part of that at lower limits, and by the positive part
    at upper ones, because t then meets the optimality conditions. Both optima are projections onto the same convex
    set, which bring points no further apart (Moreau, 1965): ``|e|`` bounds the distance.

    Parameters
    ----------
    problem : Problem
        B problems; their wrenches don't matter.
    tensions : (B, m) array
        Inside their limits, in N.
    separation : (B, n) array, optional
        Directions that separate the wrenches asked for, which the multipliers of unreachable ones tend to. They
        save time.

    Returns
    -------
    (B,) array
        In N; infinite where no multipliers were found.
    """
    transposed = np.swapaxes(problem.structure, 1, 2)
    low, high = sides(problem, tensions)
    free = ~(low | high)
    change = tensions - problem.reference
    inverse = np.asarray(np.linalg.pinv(transposed * free[:, :, None]), dtype=np.float64)
    multipliers = times(inverse, change * free)
    bound = _bound(problem, tensions, multipliers)
    enough = ENOUGH * np.maximum(1.0, size(problem))
    if separation is not None:
        # The part that the free cables would feel is rounding.
        along = separation - times(inverse, times(transposed, separation) * free)
        for reach in REACHES:
            further = multipliers + reach * np.maximum(1.0, size(problem))[:, None] * along
            bound = np.minimum(bound, _bound(problem, tensions, further))
    # With few cables off their limits, many multipliers serve those, and most of them not the others.
    for row in np.flatnonzero(bound > enough):
        found = _multipliers(problem.structure[row], change[row], low[row], high[row])
        one = _moved(change[row] - problem.structure[row].T @ found, low[row], high[row])
        bound[row] = min(bound[row], float(np.linalg.norm(one)))
    return bound


def sides(problem: Problem, tensions: Floats) -> tuple[Flags, Flags]:
    """Which tensions are at their lower and at their upper limits, (B, m) each?"""
    close = AT_LIMIT * np.maximum(1.0, size(problem))[:, None]
    return tensions - problem.lower <= close, problem.upper - tensions <= close


def size(problem: Problem) -> Floats:
    """What is the largest limit of each problem, (B,)?"""
    return np.asarray(np.maximum(np.abs(problem.lower), np.abs(problem.upper)).max(axis=1, initial=0.0))


def _bound(problem: Problem, tensions: Floats, multipliers: Floats) -> Floats:
    pull = times(np.swapaxes(problem.structure, 1, 2), multipliers)
    moved = _moved(tensions - problem.reference - pull, *sides(problem, tensions))
    return np.asarray(np.linalg.norm(moved, axis=-1))


def _moved(off: Floats, low: Flags, high: Flags) -> Floats:
    """By how much the reference must move: not at all where a limit holds the tension."""
    held = (low & (off > 0)) | (high & (off < 0)) | (low & high)
    return np.where(held, 0.0, off)


def _multipliers(structure: Floats, change: Floats, low: Flags, high: Flags) -> Floats:
    """Which y satisfy ``W'y = change`` between the limits, ``<=`` at lower ones and ``>=`` at upper ones."""
    from scipy.optimize import nnls

    use = ~(low & high)
    slack = np.diag(low.astype(float) - high)[:, low ^ high]
    matrix = np.hstack([structure.T, -structure.T, slack])[use]
    count = len(structure)
    if not matrix.size:
        return np.zeros(count)
    try:
        found, _ = nnls(matrix, change[use], maxiter=50 * matrix.shape[1])
    except RuntimeError:  # too many iterations: then there is no proof
        return np.full(count, np.nan)
    return np.asarray(found[:count] - found[count : 2 * count])
