"""Tensions from linear programs: the least sum, the least largest tension, the largest margin to the limits.

The best tensions of such a program are those that render the wrench inside tighter limits: the largest tension
or the margin is a limit like any other, and a cable on which it depends stays at its own. A compiled dual
simplex method finds the tighter limits (``native/solvers/linear_program.hpp``). Where there is a choice,
`Newton` takes the tensions closest to the reference, so that the answer depends neither on the order of the
cables nor on the path of the method, and changes little with the wrench. A simplex method alone stops at some
corner, and jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.solvers.base import RANK_TOLERANCE, TOLERANCE
from tensionlab.solvers.compiled import CompiledSolver

PROGRAMS = ("sum", "largest", "margin")


@dataclass(frozen=True)
class LeastSum(CompiledSolver):
    """Tensions with the least sum.

    Minimises ``sum(t)`` subject to ``W t = w`` and the limits. Of equally good tensions it takes those closest to
    the reference. They change continuously with the wrench, but jump when the rig moves through a pose in which
    two sets of cables are equally good. For an infeasible wrench they are those of the closest wrench, and no
    status is promised. Iterations are simplex and Newton steps.

    Source: Shiang, Cannon and Gorman, "Optimal force distribution applied to a robotic crane with flexible
    cables", 2000.
    """

    objective: ClassVar[str] = "least sum of tensions"

    def _compiled(self) -> _native.TensionSolver:
        return _native.linear_program(PROGRAMS.index("sum"), 1.0, RANK_TOLERANCE, TOLERANCE)


@dataclass(frozen=True)
class Minimax(CompiledSolver):
    """Tensions whose maximum is least.

    Minimises ``max(t)`` subject to ``W t = w`` and the limits, as the linear program of the least τ with
    ``t <= τ``. Cables with equal limits do not count. Of equally good tensions it takes those closest to the
    reference; they change continuously with the wrench. For an infeasible wrench they are those of the closest
    wrench, and no status is promised. Iterations are simplex and Newton steps.

    Source: Gosselin and Grenier, "On the determination of the force distribution in overconstrained cable-driven
    parallel mechanisms", 2011, where it is the limit of the p-norms.
    """

    objective: ClassVar[str] = "least largest tension"

    def _compiled(self) -> _native.TensionSolver:
        return _native.linear_program(PROGRAMS.index("largest"), 1.0, RANK_TOLERANCE, TOLERANCE)


@dataclass(frozen=True)
class OptimallySafe(CompiledSolver):
    """Tensions with the largest margin to the limits (max-margin).

    Maximises S subject to ``W t = w`` and ``lower + S <= t <= upper - alpha S``. Cables with equal limits do not
    count. Of equally good tensions it takes those closest to the reference; they change continuously with the
    wrench. Where S is negative the wrench is infeasible; the tensions are then those of the closest wrench, and no
    status is promised. Iterations are simplex and Newton steps.

    Source: Borgstrom, Jordan, Borgstrom, Stealey, Sukhatme, Batalin and Kaiser, "Rapid computation of optimally
    safe tension distributions for parallel cable-driven robots", 2009.

    Parameters
    ----------
    alpha : float
        Margin to the upper limits for each unit of margin to the lower ones: 1 keeps equally far from both, 0
        counts only the lower limits.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> rig.allocate([0.0, 0.0, 1.5], solver=tl.solvers.OptimallySafe(alpha=2.0)).tensions.round(3)
    array([2.646, 3.622, 1.67 , 3.66 ])
    """

    alpha: float = 1.0

    objective: ClassVar[str] = "largest margin to the limits"

    def __post_init__(self) -> None:
        if not 0.0 <= self.alpha < math.inf:
            raise InputError(f"OptimallySafe(alpha={self.alpha}): must be a number, 0 or more")

    def _compiled(self) -> _native.TensionSolver:
        return _native.linear_program(PROGRAMS.index("margin"), self.alpha, RANK_TOLERANCE, TOLERANCE)
