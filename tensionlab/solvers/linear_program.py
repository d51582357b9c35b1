"""Tensions from linear programs: the least sum, the least largest tension, the most margin to the limits.

All tensions that are best for such a program, and no others, render the wrench inside tighter limits. A compiled
dual simplex method finds those limits (`tensionlab/native/linear_program.hpp`), and `Newton` finds the tensions
inside them that are closest to the reference. A simplex method alone stops at a corner of the best tensions, which
depends on the order of the cables and jumps when the wrench changes a little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from tensionlab import _native
from tensionlab.solvers.contract import Answer, Nearest, Problem
from tensionlab.solvers.newton import Newton

PROGRAMS: tuple[Literal["sum", "maximum", "margin"], ...] = ("sum", "maximum", "margin")


@dataclass(frozen=True)
class LeastSum:
    """x."""

    objective: ClassVar[str] = "least sum of tensions"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        return _closest_of_the_best(problem, 0)


@dataclass(frozen=True)
class Minimax:
    """x."""

    objective: ClassVar[str] = "least largest tension"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        return _closest_of_the_best(problem, 1)


@dataclass(frozen=True)
class OptimallySafe:
    """x."""

    alpha: float = 1.0

    objective: ClassVar[str] = "largest margin to the limits"
    policies: ClassVar[tuple[Nearest, ...]] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.alpha < math.inf:
            raise ValueError(f"OptimallySafe(alpha={self.alpha}): must be a number, 0 or more")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        return _closest_of_the_best(problem, 2, self.alpha)


def _closest_of_the_best(problem: Problem, program: int, alpha: float = 1.0) -> Answer:
    lower, upper, steps = _native.tighten(
        problem.structure, problem.wrench, problem.lower, problem.upper, problem.weights, program, alpha
    )
    closest = Newton().solve(replace(problem, lower=lower, upper=upper))
    return Answer(closest.tensions, steps + closest.iterations)
