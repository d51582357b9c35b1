"""The optimum with which answers are compared: found through the exact solver, and proved here without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.solvers.base import Problem, Status
from tensionlab.solvers.least_squares import Newton
from tensionlab.solvers.programs import times, whitener
from tensionlab.support.arrays import Floats
from tensionlab.verification import verify

Flags = NDArray[np.bool_]

# An optimum is verified if it is no further than this from the tensions of least `|t|²` that render its wrench, as
# a share of the largest limit, and so near to those that would render the wrench without rounding.
VERIFIED_BOUND = 1e-7
AT_LIMIT = 1e-10  # a tension this close to a limit is at it, as a share of the largest limit
ENOUGH = 1e-7  # a bound of this share of the largest limit needs no better multipliers
# Lengths of the separating direction that are tried in the multipliers, times the largest limit.
SEPARATION_SIZES = (1e1, 1e3, 1e5)


@dataclass(frozen=True)
class Optimum:
    """The best tensions for B problems."""

    tensions: Floats  # (B, m)
    wrench: Floats  # that they render, (B, n)
    reachable: Flags  # whether that is the desired one, (B,)
    verified: Flags  # whether that is proved, and that these are the smallest tensions that render it, (B,)


def optimum(problem: Problem) -> Optimum:
    """Return the best tensions under the policy of the problem, and whether that is proved.

    The exact solver finds which cables are at their limits. Where the wrench is feasible, the others then
    follow from the equations, which are solved once more: cables nearly in a plane turn an error of 1e-11 N in
    the wrench, which no status notices, into one of 1e-4 N in the tensions.
    """
    answer = verify(problem, Newton().solve(problem))
    reachable = answer.status == Status.EXACT
    tensions, sensitivity = _polished(problem, answer.tensions, reachable)
    wrench = times(problem.structure, tensions)
    missing = np.linalg.norm(problem.wrench - wrench, axis=1)
    bound = np.where(reachable, missing * sensitivity, 0.0) + distance_bound(problem, tensions)
    known = reachable | (answer.status == Status.NEAREST)
    verified = known & (bound <= VERIFIED_BOUND * np.maximum(1.0, largest_limit(problem)))
    return Optimum(tensions, wrench, reachable, verified)


def _polished(problem: Problem, tensions: Floats, reachable: Flags) -> tuple[Floats, Floats]:
    """Solve the equations of the tensions again, and return by how much they change with the wrench, (B,) in N/N.

    Cables off their limits change by the least that renders the wrench; none does where that would break a limit,
    or where the wrench is infeasible.
    """
    low, high = at_limits(problem, tensions)
    loose = problem.structure * ~(low | high)[:, None, :]
    inverse = np.asarray(np.linalg.pinv(loose), dtype=np.float64)
    better = tensions + times(inverse, problem.wrench - times(problem.structure, tensions))
    kept = reachable & ((problem.lower <= better) & (better <= problem.upper)).all(axis=1)
    return np.where(kept[:, None], better, tensions), np.linalg.norm(inverse, ord=2, axis=(1, 2))


def excess_error(problem: Problem, best: Optimum, tensions: Floats) -> Floats:
    """Return how much larger than possible, (B,) in N, the error is that the problems' policy minimises.

    Below 0 never by more than rounding. Where the wrench is feasible, the norm of what is missing; else the
    policy's error minus the minimum: the norm of what is missing ("force"), the distance to the equilibrium space
    ("tension"), or the distance to the longest wrench in the direction ("direction"). The tensions are inside
    their limits.
    """
    rendered = times(problem.structure, tensions)
    if problem.policy == "direction":
        return np.asarray(np.linalg.norm(rendered - best.wrench, axis=1))
    missing, smallest = problem.wrench - rendered, problem.wrench - best.wrench
    if problem.policy == "tension":
        root = np.where(best.reachable[:, None, None], np.eye(missing.shape[1]), whitener(problem.structure))
        missing, smallest = times(root, missing), times(root, smallest)
    excess = np.linalg.norm(missing, axis=1) - np.where(best.reachable, 0.0, np.linalg.norm(smallest, axis=1))
    return np.asarray(excess)


def deviations(problem: Problem, best: Optimum, raw: Floats) -> dict[str, Floats]:
    """Return how far raw tensions (B, m) are from solving each problem, (B,) each, in N; NaN where a tension is.

    ``violation`` of the limits; of the tensions clipped to them, ``error`` as in `excess_error` and ``gap``, the
    largest difference to the optimum, NaN too where that is not verified.
    """
    outside = np.maximum(problem.lower - raw, raw - problem.upper).max(axis=1)
    tensions = np.clip(raw, problem.lower, problem.upper)
    return {
        "violation": np.maximum(outside, 0.0),
        "error": np.maximum(excess_error(problem, best, tensions), 0.0),
        "gap": np.where(best.verified, np.abs(tensions - best.tensions).max(axis=1), np.nan),
    }


def distance_bound(problem: Problem, tensions: Floats, separation: Floats | None = None) -> Floats:
    """Return an upper bound, (B,) in N, of the distance from tensions to the optimum of the same wrench.

    The optimum are the tensions closest to the reference. For any multipliers y, tensions t are the optimum of a
    reference near t0: the one that is moved by ``e = t - t0 - W'y`` between the limits, by the negative part of
    that at lower limits, and by the positive part at upper ones, because t then meets the optimality conditions.
    Both optima are projections onto the same convex set, which bring points no further apart (Moreau, 1965):
    ``|e|`` bounds the distance; it is infinite where no multipliers were found. The problems' wrenches don't
    matter. Directions (B, n) that separate them, to which the multipliers of infeasible ones tend, save time.
    """
    transposed = np.swapaxes(problem.structure, 1, 2)
    low, high = at_limits(problem, tensions)
    free = ~(low | high)
    change = tensions - problem.reference
    scale = np.maximum(1.0, largest_limit(problem))
    inverse = np.asarray(np.linalg.pinv(transposed * free[:, :, None]), dtype=np.float64)
    multipliers = times(inverse, change * free)
    bound = _bound(problem, tensions, multipliers)
    if separation is not None:
        # The part that acts on the free cables is rounding.
        along = separation - times(inverse, times(transposed, separation) * free)
        for size in SEPARATION_SIZES:
            bound = np.minimum(bound, _bound(problem, tensions, multipliers + size * scale[:, None] * along))
    # With few cables off their limits, many multipliers serve those, and most of them not the others.
    for row in np.flatnonzero(bound > ENOUGH * scale):
        row_multipliers = _multipliers(problem.structure[row], change[row], low[row], high[row])
        one = _moved(change[row] - problem.structure[row].T @ row_multipliers, low[row], high[row])
        bound[row] = min(bound[row], float(np.linalg.norm(one)))
    return bound


def at_limits(problem: Problem, tensions: Floats) -> tuple[Flags, Flags]:
    """Return which tensions are at their lower and at their upper limits, (B, m) each."""
    close = AT_LIMIT * np.maximum(1.0, largest_limit(problem))[:, None]
    return tensions - problem.lower <= close, problem.upper - tensions <= close


def largest_limit(problem: Problem) -> Floats:
    """Return the largest limit of each problem, (B,), in N."""
    return np.asarray(np.maximum(np.abs(problem.lower), np.abs(problem.upper)).max(axis=1, initial=0.0))


def _bound(problem: Problem, tensions: Floats, multipliers: Floats) -> Floats:
    pull = times(np.swapaxes(problem.structure, 1, 2), multipliers)
    moved = _moved(tensions - problem.reference - pull, *at_limits(problem, tensions))
    return np.asarray(np.linalg.norm(moved, axis=-1))


def _moved(off: Floats, low: Flags, high: Flags) -> Floats:
    """Return by how much the reference must move: not at all where a limit holds the tension."""
    held = (low & (off > 0)) | (high & (off < 0)) | (low & high)
    return np.where(held, 0.0, off)


def _multipliers(structure: Floats, change: Floats, low: Flags, high: Flags) -> Floats:
    """Find y with ``W'y = change`` between the limits, ``<=`` at lower ones and ``>=`` at upper ones."""
    from scipy.optimize import nnls

    use = ~(low & high)
    slack = np.diag(low.astype(float) - high)[:, low ^ high]
    matrix = np.hstack([structure.T, -structure.T, slack])[use]
    count = len(structure)
    if not matrix.size:
        return np.zeros(count)
    try:
        solution, _ = nnls(matrix, change[use], maxiter=50 * matrix.shape[1])
    except RuntimeError:  # too many iterations: then there is no proof
        return np.full(count, np.nan)
    return np.asarray(solution[:count] - solution[count : 2 * count])
