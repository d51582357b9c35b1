"""Pott's improved closed form: fix the worst cable at its limit and solve again for the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tensionlab import _native
from tensionlab.solvers.base import RANK_TOLERANCE, Answer, Nearest, Problem


@dataclass(frozen=True)
class ClosedForm:
    """Which tensions close to the middle of their limits render the wrench, in a bounded number of steps.

    Starts from the middle, ``t = t_m + W⁺ (w - W t_m)``. While a cable misses its limits, the one that misses
    them by most is fixed at the limit, the wrench that it takes over is subtracted, its column is dropped,
    and the rest is solved again; at most (free cables - rank of W) times. The answer is exact far more often
    than that of one pseudo-inverse, but it is no minimum of anything once a cable has been fixed, and a
    failure doesn't prove the wrench out of reach. The reference plays no part. Iterations are the cables
    fixed.

    Source: Pott, "An improved force distribution algorithm for over-constrained cable-driven parallel
    robots", 2014.
    """

    objective: ClassVar[str] = "close to the middle of the limits, the worst cable fixed first"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions, iterations = _native.closed_form(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            (problem.lower + problem.upper) / 2,
            problem.weights,
            True,
            RANK_TOLERANCE,
        )
        return Answer(tensions=tensions, iterations=iterations)
