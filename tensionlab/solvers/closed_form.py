"""Pott's improved closed form: fix the worst cable at its limit and solve again for the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tensionlab.solvers.contract import RANK_TOLERANCE, Answer, Nearest, Problem
from tensionlab.solvers.linear import pseudoinverse, times

ROUNDING = 1e-12
"""A limit counts as kept if it is missed by less than this share of the largest limit; clipping hides it."""


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
        """Choose tensions for every problem of the batch; finished problems leave it."""
        structure, lower, upper = problem.structure, problem.lower, problem.upper
        middle = (lower + upper) / 2
        tensions = middle.copy()
        iterations = np.zeros(len(problem), dtype=np.int64)
        # A cable without play is fixed from the start, and costs no reduction.
        free = lower < upper
        loose = structure * free[:, None, :]
        budget = free.sum(axis=1) - np.linalg.matrix_rank(loose, rtol=RANK_TOLERANCE)
        slack = ROUNDING * np.maximum(abs(lower), abs(upper)).max(axis=1, initial=0.0)

        rows = np.arange(len(problem))
        while rows.size:
            # A zero column is a dropped cable: the pseudo-inverse gives it no part of the missing wrench.
            loose = structure[rows] * free[rows, None, :]
            start = np.where(free[rows], middle[rows], tensions[rows])
            missing = problem.wrench[rows] - times(structure[rows], start)
            found = start + times(pseudoinverse(loose), missing)
            tensions[rows] = np.clip(found, lower[rows], upper[rows])

            violation = abs(found - tensions[rows]) * free[rows]
            worst = violation.argmax(axis=1)
            again = (violation.max(axis=1) > slack[rows]) & (iterations[rows] < budget[rows])
            rows = rows[again]
            free[rows, worst[again]] = False
            iterations[rows] += 1
        return Answer(tensions=tensions, iterations=iterations)
