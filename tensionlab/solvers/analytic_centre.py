"""The analytic centre: tensions clear of all their limits, by a compiled dual Newton method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tensionlab import _native
from tensionlab.solvers.base import Answer, Nearest, Problem


@dataclass(frozen=True)
class AnalyticCentre:
    """Which tensions render the wrench and stay clear of all limits, with the largest product of distances?

    Maximises ``sum ln(t - lower) + sum ln(upper - t)`` subject to ``W t = w``. There is one answer for every
    wrench inside the workspace, it is a smooth function of wrench and pose, and no tension touches a limit.
    Cables without play keep their tension and take no part; the reference takes none either.

    A multiplier y of the wrench components fixes each tension: with c the middle of its limits, h half their
    range and q = h W_i'y it is ``c + h q / (1 + sqrt(1 + q²))``. Newton steps with a line search raise the dual,
    which is self-concordant, in those n variables; they need no feasible start (`native/dual_ascent.hpp`).

    The wrench error s is not forbidden but has a price, ``s = P (1 + P |y|²) y`` with P = 1e-14, in units of the
    largest (weighted) change of the wrench that half the range of one cable makes. At a distance d from the edge
    of the workspace, where k cables would be at their limits, it is k P / d: a hundredth of a unit away 1e-11
    units at most, 1e-6 units away 1e-7, and at the very edge 5e-7, which is still EXACT on rigs of a few newton.
    Beyond, the tensions tend to their limits and the wrench to the one of least error: near the best that can be
    rendered, and not proved to be.

    Sources: Sonnevend, "An analytical centre for polyhedrons and new classes of global algorithms for linear
    (smooth, convex) programming", 1985; Nesterov and Nemirovskii, "Interior-Point Polynomial Algorithms in Convex
    Programming", 1994, for the steps. On a cable robot: "Experimental validation of the analytic-centre based
    tension distribution algorithm for cable driven parallel robots", 2025.
    """

    objective: ClassVar[str] = "largest product of distances to the limits"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions, iterations = _native.log_barrier(
            problem.structure, problem.wrench, problem.lower, problem.upper, problem.weights
        )
        return Answer(tensions, iterations)
