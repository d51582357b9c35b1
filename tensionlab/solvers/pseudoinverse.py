"""Tensions from one pseudo-inverse, clipped to their limits: the fastest answer, and an incomplete one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np

from tensionlab import _native
from tensionlab.solvers.base import RANK_TOLERANCE, Answer, Nearest, Problem

Start = Literal["reference", "middle"]


@dataclass(frozen=True)
class Pseudoinverse:
    """Which tensions render the wrench with the least change from a starting point, limits aside.

    Minimises ``|t - t_s|²`` subject to ``W t = w`` only, by ``t = t_s + W⁺ (w - W t_s)``, and then clips t to
    the limits. Where the clipping changes nothing the answer is exact; elsewhere it renders another wrench,
    and that proves nothing about the wrench asked for.

    Source: Pott, Bruckmann and Mikelsons, "Closed-form force distribution for parallel wire robots", 2009, for
    the start in the middle.

    Parameters
    ----------
    start : {"reference", "middle"}
        The starting point t_s. "reference" is the reference of the problem: with the usual reference 0 that
        is the plain least-norm solution, which wants negative tensions on most rigs. "middle" is
        (lower + upper) / 2, Pott's closed form: it keeps away from both limits, whatever the reference.
    """

    start: Start = "reference"

    policies: ClassVar[tuple[Nearest, ...]] = ()

    def __post_init__(self) -> None:
        if self.start not in get_args(Start):
            raise ValueError(f'Pseudoinverse(start={self.start!r}): must be "reference" or "middle"')

    @property
    def objective(self) -> str:
        """What it minimises, before the limits are looked at."""
        start = "reference" if self.start == "reference" else "middle of the limits"
        return f"least squared change from the {start}, then clipped"

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions, _ = _native.closed_form(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            (problem.lower + problem.upper) / 2 if self.start == "middle" else problem.reference,
            problem.weights,
            False,
            RANK_TOLERANCE,
        )
        return Answer(tensions=tensions, iterations=np.zeros(len(problem), dtype=np.int64))
