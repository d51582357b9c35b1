"""The answer that all others are held against: found by way of the exact solver, and proved here without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.benchmark.optimality_proof import distance_bound, sides, size
from tensionlab.solvers.base import Problem, Status
from tensionlab.solvers.linear import times, whitener
from tensionlab.solvers.newton import Newton
from tensionlab.verification import verify

Flags = NDArray[np.bool_]

PROVED = 1e-7
"""An optimum is proved to be no further than this from the tensions of least ``|t|²`` that render its wrench, as a
share of the largest limit, and so near is it to those that would render the wrench without rounding."""


@dataclass(frozen=True)
class Optimum:
    """The best tensions for B problems, and which of them are proved to be.

    Attributes
    ----------
    tensions : (B, m) array
    wrench : (B, n) array
        What they render.
    reachable : (B,) array of bool
        Whether that is the wrench asked for.
    verified : (B,) array of bool
        Whether the status is proved, and the tensions are proved to be the smallest that render their wrench.
    """

    tensions: Floats
    wrench: Floats
    reachable: Flags
    verified: Flags


def optimum(problem: Problem) -> Optimum:
    """Which tensions are the best under the policy of the problem, and is that proved?

    The exact solver says which cables are at their limits. Where the wrench is within reach, the others then
    follow from the equations, which are solved once more: cables nearly in a plane turn an error of 1e-11 N in
    the wrench, which no status minds, into one of 1e-4 N in the tensions.
    """
    found = verify(problem, Newton().solve(problem))
    reachable = found.status == Status.EXACT
    tensions, sensitivity = _polished(problem, found.tensions, reachable)
    wrench = times(problem.structure, tensions)
    missing = np.linalg.norm(problem.wrench - wrench, axis=1)
    proved = np.where(reachable, missing * sensitivity, 0.0) + distance_bound(problem, tensions)
    known = reachable | (found.status == Status.NEAREST)
    verified = known & (proved <= PROVED * np.maximum(1.0, size(problem)))
    return Optimum(tensions, wrench, reachable, verified)


def _polished(problem: Problem, tensions: Floats, reachable: Flags) -> tuple[Floats, Floats]:
    """The tensions with their equations solved again, and by how much they change with the wrench.

    Returns
    -------
    tensions : (B, m) array
        With the least change of the cables off their limits that renders the wrench; unchanged where that
        would break a limit, or where the wrench is out of reach.
    sensitivity : (B,) array
        Largest change of the tensions, in N, for a change of the wrench by 1 N.
    """
    low, high = sides(problem, tensions)
    loose = problem.structure * ~(low | high)[:, None, :]
    inverse = np.asarray(np.linalg.pinv(loose), dtype=np.float64)
    better = tensions + times(inverse, problem.wrench - times(problem.structure, tensions))
    kept = reachable & ((problem.lower <= better) & (better <= problem.upper)).all(axis=1)
    return np.where(kept[:, None], better, tensions), np.linalg.norm(inverse, ord=2, axis=(1, 2))


def error_above_least(problem: Problem, best: Optimum, tensions: Floats) -> Floats:
    """How much larger than it need be is the error that the policy makes small?

    Parameters
    ----------
    problem : Problem
        B problems, with the policy.
    best : Optimum
        Of the same policy.
    tensions : (B, m) array
        Inside their limits, in N.

    Returns
    -------
    (B,) array
        In N, below 0 never by more than rounding. Where the wrench is reachable, the norm of what is missing;
        else the policy's error minus its least: the norm of what is missing ("force"), the distance to the
        equilibrium space ("tension"), or the distance to the longest wrench in the direction ("direction").
    """
    rendered = times(problem.structure, tensions)
    if problem.nearest == "direction":
        return np.asarray(np.linalg.norm(rendered - best.wrench, axis=1))
    missing, least = problem.wrench - rendered, problem.wrench - best.wrench
    if problem.nearest == "tension":
        root = np.where(best.reachable[:, None, None], np.eye(missing.shape[1]), whitener(problem.structure))
        missing, least = times(root, missing), times(root, least)
    above = np.linalg.norm(missing, axis=1) - np.where(best.reachable, 0.0, np.linalg.norm(least, axis=1))
    return np.asarray(above)
