"""The puncture method: from the least tensions towards the middle of the limits, until no cable is slack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tensionlab import _native
from tensionlab.solvers.base import RANK_TOLERANCE, Answer, Nearest, Problem


@dataclass(frozen=True)
class Puncture:
    """Which low tensions render the wrench, between the least-norm solution and the closed form?

    Two solutions of ``W t = w`` are known without a search: ``t_p = W⁺ w``, the least norm, which wants
    negative tensions on most rigs, and ``t_cf = t_m + W⁺ (w - W t_m)``, the one closest to the middle of the
    limits. All tensions between the two render the wrench: ``t = t_p + s (t_cf - t_p)``. The answer is where
    this line punctures the limits first, the least s in [0, 1] with ``lower <= t <= upper``. (The source
    looks at the lower limits alone; where an upper one is kept at their s, the answers are the same.) Where
    no s keeps the limits, the answer is t_cf, clipped to them, and that proves nothing about the wrench. The
    answer changes continuously with the wrench as long as t_cf keeps the limits.

    A cable whose limits are equal pulls what it must, and the others share the rest. The reference plays no
    part.

    Source: Müller, Reichert and Bruckmann, "Analysis of a real-time capable cable force computation method",
    2015.
    """

    objective: ClassVar[str] = "least share of the way from the least norm to the middle of the limits"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions = _native.puncture(
            problem.structure, problem.wrench, problem.lower, problem.upper, problem.weights, RANK_TOLERANCE
        )
        return Answer(tensions=tensions, iterations=np.zeros(len(problem), dtype=np.int64))
