"""Dykstra's alternating projections, with the correction term and a stopping rule that can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tensionlab import _native
from tensionlab.solvers.base import RANK_TOLERANCE, Answer, Nearest, Problem


@dataclass(frozen=True)
class Dykstra:
    """Which tensions closest to the reference render the wrench, by projecting back and forth.

    Minimises ``|t - reference|²`` subject to ``W t = w`` and the limits. Projects in turn onto the
    equilibrium space {t: W t = w} and onto the limits; the correction p makes the result the *projection* of
    the start onto the intersection, where plain alternating projections only find some point of it::

        y = x - W⁺ (W x - w)      z = clip(y + p)      p = y + p - z      x = z

    The start is the reference. With reference 0, minimum tension, that gives the same iterates as a start at
    the pseudo-inverse solution W⁺ w, because the first projection of 0 is W⁺ w, which then stays in place.
    y + p never leaves ``reference + range(W')``, so it is enough to keep n numbers ``pull`` with
    ``y + p = reference + W⁺ pull``, and a whole iteration is ``pull += w - W z``. It also follows that every
    z is the exact optimum for the wrench that it renders itself: stopping early costs equilibrium, never
    optimality. The whole batch is one call to `tensionlab/native/dykstra.hpp`, which tests every eighth
    iteration whether to stop; ``TENSIONLAB_NUM_THREADS`` sets the threads.

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
        """Choose tensions for every problem of the batch."""
        tensions, iterations = _native.dykstra(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            problem.reference,
            problem.weights,
            self.tolerance,
            self.iteration_limit,
            RANK_TOLERANCE,
        )
        return Answer(tensions=tensions, iterations=iterations)
