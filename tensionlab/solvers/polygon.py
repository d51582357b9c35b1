"""The polygon of all tensions that render a wrench: its centroid, its least sum, its least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np

from tensionlab import _native
from tensionlab.solvers.base import RANK_TOLERANCE, Answer, Nearest, Problem

Goal = Literal["centroid", "1-norm", "2-norm"]

OBJECTIVES: dict[Goal, str] = {
    "centroid": "centroid of the polygon of possible tensions",
    "1-norm": "least sum of tensions",
    "2-norm": "least squared change from the reference",
}

LARGEST_REDUNDANCY = 2
"""Dimensions of a polygon."""


@dataclass(frozen=True)
class Polygon:
    """Which point of the polygon of all possible tensions: its centre, its least sum, its least squares?

    With two cables more than the wrench has components, the tensions that render it are the plane
    ``t = t_p + N l`` with two numbers l, N a basis of the null space of W. On that plane each cable leaves a
    strip between the line of its lower limit and that of its upper one, and the strips have a convex polygon
    in common. Its corners are found by walking along the lines from a crossing of two of them
    (`tensionlab/native/polygon.hpp` states the walk), so an answer is found wherever there is one, at the
    edge of the workspace too, where the polygon is an edge or a point. Iterations are the lines walked.

    With one cable more the polygon is a segment, and with none a point. A cable whose limits are equal does
    not count. More redundancy than two is refused; where it is only a rank-deficient structure matrix that
    leaves more, that problem of the batch has FAILED, with the reason. Out of reach the answer is where
    the walk missed the limits by least, clipped to them, and it is no best substitute.

    Source: Gouttefarde, Lamaury, Reichert and Bruckmann, "A versatile tension distribution algorithm for
    n-DOF parallel robots driven by n+2 cables", 2015.

    Parameters
    ----------
    goal : {"centroid", "1-norm", "2-norm"}
        "centroid" is the centre of area of the polygon (the middle of a segment), far from all limits. It is
        continuous where the polygon has an area. "1-norm" is the least sum of tensions, at a corner; where a
        whole edge has the least sum, the middle of the edge, and where all of the polygon has it, the
        centroid. "2-norm" is the point closest to the reference, with reference 0 the least sum of squares;
        the reference plays no part in the other two.
    """

    goal: Goal = "centroid"

    policies: ClassVar[tuple[Nearest, ...]] = ()

    def __post_init__(self) -> None:
        if self.goal not in get_args(Goal):
            raise ValueError(f"Polygon(goal={self.goal!r}): must be one of {', '.join(get_args(Goal))}")

    @property
    def objective(self) -> str:
        """What it minimises among the tensions that render the wrench."""
        return OBJECTIVES[self.goal]

    def refuses(self, n: int, m: int) -> str | None:
        """Why are these too many cables? None if they are not."""
        if m - n <= LARGEST_REDUNDANCY:
            return None
        return (
            f"{m} cables for {n} wrench components have redundancy {m - n}, and a polygon has "
            f"{LARGEST_REDUNDANCY} dimensions"
        )

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        tensions, iterations, redundancy = _native.polygon(
            problem.structure,
            problem.wrench,
            problem.lower,
            problem.upper,
            problem.reference,
            problem.weights,
            get_args(Goal).index(self.goal),
            RANK_TOLERANCE,
        )
        beyond = np.flatnonzero(redundancy > LARGEST_REDUNDANCY)
        tensions[beyond] = np.nan
        failures = {
            int(row): f"the structure matrix has a rank so low that the redundancy is {redundancy[row]}; "
            f"a polygon has {LARGEST_REDUNDANCY} dimensions"
            for row in beyond
        }
        return Answer(tensions=tensions, iterations=iterations, failures=failures)
