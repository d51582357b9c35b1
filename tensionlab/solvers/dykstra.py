"""Dykstra's alternating projections, with the correction term and a stopping rule that can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tensionlab.solvers.contract import Answer, Floats, Nearest, Problem
from tensionlab.solvers.linear import pseudoinverse, times

CHECK_EVERY = 8
"""Iterations between two tests of a batch; a test costs about as much as an iteration."""


@dataclass(frozen=True)
class Dykstra:
    """Which tensions closest to the reference render the wrench, by projecting back and forth.

    Minimises ``|t - reference|²`` subject to ``W t = w`` and the limits. Projects in turn onto the
    equilibrium space {t: W t = w} and onto the limits; the correction p makes the result the *projection* of
    the start onto the intersection, where plain alternating projections only find some point of it::

        y = x - W⁺ (W x - w)      z = clip(y + p)      p = y + p - z      x = z

    The start is the reference. With reference 0, minimum tension, that gives the same iterates as a start at
    the pseudo-inverse solution W⁺ w, because the first projection of 0 is W⁺ w, which then stays in place.
    y + p never leaves ``reference + range(W')``, so the loop below keeps the n numbers ``pull`` with
    ``y + p = reference + W⁺ pull``, and a whole iteration is ``pull += w - W z``. It also follows that every
    z is the exact optimum for the wrench that it renders itself: stopping early costs equilibrium, never
    optimality.

    Out of reach, z tends to the point inside the limits that is closest to the equilibrium space, the argmin
    of ``(W t - w)' (W W')⁺ (W t - w)``, while p grows without bound. A part of w outside the range of W is
    beyond every tension and is left out of account.

    Sources: Boyle and Dykstra, "A method for finding projections onto the intersection of convex sets in
    Hilbert spaces", 1986; for cables Hassan and Khajepour, "Analysis of bounded cable tensions in
    cable-actuated parallel manipulators", 2011; the limit where nothing intersects, Bauschke and Borwein,
    "Dykstra's alternating projection algorithm for two sets", 1994.

    Parameters
    ----------
    tolerance : float
        A problem is done when ``|W z - w|`` is at most this times max(1, |w|) or, out of reach, when the
        duality gap proves z to be within it of the least distance. Never when x stops moving: it stalls.
    iteration_limit : int
        Iterations after which the last z is returned, whatever it is worth.
    """

    tolerance: float = 1e-9
    iteration_limit: int = 50_000

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Nearest, ...]] = ("tension",)

    def __post_init__(self) -> None:
        if not self.tolerance >= 0 or self.iteration_limit < 1:
            raise ValueError(f"{self}: tolerance must not be negative, and iteration_limit at least 1")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch; converged problems leave it."""
        rows = np.arange(len(problem))
        tensions = np.empty_like(problem.reference)
        iterations = np.full(len(problem), self.iteration_limit, dtype=np.int64)

        W, lower, upper, reference = problem.structure, problem.lower, problem.upper, problem.reference
        inverse = pseudoinverse(W)
        target = times(W, times(inverse, problem.wrench))
        accepted = self.tolerance * np.maximum(1.0, np.linalg.norm(problem.wrench, axis=1))
        pull = target - times(W, reference)

        for iteration in range(1, self.iteration_limit + 1):
            z = np.clip(reference + times(inverse, pull), lower, upper)
            missing = target - times(W, z)
            pull = pull + missing
            if iteration % CHECK_EVERY != 1 and iteration != self.iteration_limit:
                continue
            done = np.linalg.norm(missing, axis=1) <= accepted
            done |= _proved(times(inverse, missing), z, lower, upper, accepted)
            if iteration == self.iteration_limit:
                tensions[rows] = z
            if done.any():
                tensions[rows[done]] = z[done]
                iterations[rows[done]] = iteration
                on = ~done
                rows, W, inverse, target, pull = rows[on], W[on], inverse[on], target[on], pull[on]
                lower, upper, reference, accepted = lower[on], upper[on], reference[on], accepted[on]
            if not rows.size:
                break
        return Answer(tensions=tensions, iterations=iterations)


def _proved(step: Floats, z: Floats, lower: Floats, upper: Floats, accepted: Floats) -> Floats:
    """Which z are proved to be as close to the equilibrium space as the limits allow.

    ``step = W⁺ (w - W z)`` leads from z to the equilibrium space, so its norm is the distance. No point
    inside the limits is closer than that norm minus the gap: how far the limits extend beyond z along step.
    """
    beyond = np.maximum(step * (lower - z), step * (upper - z)).sum(axis=1)
    proved: Floats = beyond <= accepted * np.linalg.norm(step, axis=1)
    return proved
