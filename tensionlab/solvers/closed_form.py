"""Solvers without a search for an optimum: pseudo-inverses, the puncture method, the polygon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.solvers.base import RANK_TOLERANCE
from tensionlab.solvers.compiled import CompiledSolver

Start = Literal["reference", "middle"]


@dataclass(frozen=True)
class Pseudoinverse(CompiledSolver):
    """Least change from a starting point that renders the wrench, limits aside, then clipped to them.

    Minimises ``|t - t_s|²`` subject to ``W t = w`` only, by ``t = t_s + W⁺ (w - W t_s)``, and then clips t to the
    limits. Where the clipping changes nothing the answer is exact; elsewhere it renders another wrench, which
    proves nothing about the desired one.

    Source: Pott, Bruckmann and Mikelsons, "Closed-form force distribution for parallel wire robots", 2009, for
    the start in the middle.

    Parameters
    ----------
    start : {"reference", "middle"}
        The starting point t_s. "reference" is the reference of the problem: with the usual reference 0 that is the
        plain least-norm solution, which has negative tensions on most rigs. "middle" is (lower + upper) / 2,
        Pott's closed form: it keeps away from both limits, whatever the reference.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.Pseudoinverse("middle")).tensions.round(3)
    array([2.899, 3.875, 1.923, 4.011])
    """

    start: Start = "reference"

    def __post_init__(self) -> None:
        if self.start not in get_args(Start):
            raise InputError(f'Pseudoinverse(start={self.start!r}): must be "reference" or "middle"')

    @property
    def objective(self) -> str:
        """What it minimises, limits aside."""
        start = "reference" if self.start == "reference" else "middle of the limits"
        return f"least squared change from the {start}, then clipped"

    def _compiled(self) -> _native.TensionSolver:
        return _native.closed_form(self.start == "middle", False, RANK_TOLERANCE)


@dataclass(frozen=True)
class ImprovedClosedForm(CompiledSolver):
    """Pott's improved closed form: close to the middle of the limits, in a bounded number of steps.

    Starts from the middle, ``t = t_m + W⁺ (w - W t_m)``. While cables violate their limits, the one that does by
    most is fixed at the limit, its wrench is subtracted, its column is dropped, and the others are solved again;
    at most (free cables - rank of W) times. The answer is exact far more often than that of one pseudo-inverse,
    but once a cable is fixed it minimises nothing, and a failure certifies nothing. The reference plays no part.

    Source: Pott, "An improved force distribution algorithm for over-constrained cable-driven parallel robots",
    2014.
    """

    objective: ClassVar[str] = "close to the middle of the limits, the worst cable fixed first"

    def _compiled(self) -> _native.TensionSolver:
        return _native.closed_form(True, True, RANK_TOLERANCE)


@dataclass(frozen=True)
class Puncture(CompiledSolver):
    """Puncture method: low tensions between the least-norm solution and the closed form.

    Two solutions of ``W t = w`` are known without a search: ``t_p = W⁺ w``, the least norm, which has negative
    tensions on most rigs, and ``t_cf = t_m + W⁺ (w - W t_m)``, the one closest to the middle of the limits. All
    tensions between the two render the wrench: ``t = t_p + s (t_cf - t_p)``. The answer is where this line
    punctures the limits first, the least s in [0, 1] with ``lower <= t <= upper``. (The source looks at the lower
    limits alone; where an upper one is kept at their s, the answers are the same.) Where no s keeps the limits,
    the answer is t_cf, clipped to them, which proves nothing about the wrench. The answer changes continuously
    with the wrench as long as t_cf keeps the limits.

    A cable whose limits are equal pulls what it must, and the others share the rest. The reference plays no part.

    Source: Müller, Reichert and Bruckmann, "Analysis of a real-time capable cable force computation method", 2015.
    """

    objective: ClassVar[str] = "least share of the way from the least norm to the middle of the limits"

    def _compiled(self) -> _native.TensionSolver:
        return _native.puncture(RANK_TOLERANCE)


PolygonGoal = Literal["centroid", "1-norm", "2-norm"]

OBJECTIVES: dict[PolygonGoal, str] = {
    "centroid": "centroid of the polygon of possible tensions",
    "1-norm": "least sum of tensions",
    "2-norm": "least squared change from the reference",
}

MAX_REDUNDANCY = 2  # dimensions of a polygon


@dataclass(frozen=True)
class Polygon(CompiledSolver):
    """Point of the polygon of all feasible tensions: its centroid, its least sum, or its least squares.

    With two cables more than the wrench has components, the tensions that render it are the plane
    ``t = t_p + N l`` with two numbers l, N a basis of the null space of W. On that plane each cable leaves a
    strip between the line of its lower limit and that of its upper one, and the strips have a convex polygon
    in common. Its corners are found by walking along the lines from a crossing of two of them
    (``native/solvers/polygon.hpp`` states the walk), so an answer is found wherever there is one, at the
    edge of the workspace too, where the polygon is an edge or a point. Iterations are the lines walked.

    With one cable more the polygon is a segment, and with none a point. A cable whose limits are equal does
    not count. More redundancy than two is refused; where it is only a rank-deficient structure matrix that
    leaves more, that problem of the batch has FAILED, with the reason. Where the wrench is infeasible the answer
    is where the walk missed the limits by least, clipped to them, and it is no best substitute.

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

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.Polygon("centroid")).tensions.round(3)
    array([2.907, 3.883, 1.931, 4.021])
    """

    goal: PolygonGoal = "centroid"

    def __post_init__(self) -> None:
        if self.goal not in get_args(PolygonGoal):
            raise InputError(f"Polygon(goal={self.goal!r}): must be one of {', '.join(get_args(PolygonGoal))}")

    @property
    def objective(self) -> str:
        """What it minimises among the tensions that render the wrench."""
        return OBJECTIVES[self.goal]

    def refuses(self, n: int, m: int) -> str | None:
        """Return why these are too many cables; None if they are not."""
        if m - n <= MAX_REDUNDANCY:
            return None
        return (
            f"{m} cables for {n} wrench components have redundancy {m - n}, and a polygon has "
            f"{MAX_REDUNDANCY} dimensions"
        )

    def _compiled(self) -> _native.TensionSolver:
        return _native.polygon(get_args(PolygonGoal).index(self.goal), RANK_TOLERANCE)
