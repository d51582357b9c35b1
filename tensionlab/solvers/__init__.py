"""Every way to choose tensions: the table of solvers, and the names by which they are asked for."""

from __future__ import annotations

import difflib
from dataclasses import fields
from typing import Any, cast

from tensionlab.errors import UnknownSolver
from tensionlab.solvers import plugins
from tensionlab.solvers.analytic_centre import AnalyticCentre
from tensionlab.solvers.base import Answer, FusedSolver, Nearest, Problem, Solver, Status
from tensionlab.solvers.closed_form import ClosedForm
from tensionlab.solvers.convex import ConvexProgram
from tensionlab.solvers.dykstra import Dykstra
from tensionlab.solvers.linear_program import LeastSum, Minimax, OptimallySafe
from tensionlab.solvers.newton import Newton
from tensionlab.solvers.polygon import Polygon
from tensionlab.solvers.pseudoinverse import Pseudoinverse
from tensionlab.solvers.puncture import Puncture
from tensionlab.solvers.quadratic import QuadraticProgram
from tensionlab.solvers.slack_norm import SlackNorm
from tensionlab.solvers.spidar import Spidar

SOLVERS: dict[str, type[Any]] = {
    "newton": Newton,
    "dykstra": Dykstra,
    "pseudoinverse": Pseudoinverse,
    "closed-form": ClosedForm,
    "least-sum": LeastSum,
    "minimax": Minimax,
    "safe": OptimallySafe,
    "puncture": Puncture,
    "polygon": Polygon,
    "analytic-centre": AnalyticCentre,
    "slack": SlackNorm,
    "spidar": Spidar,
    "qp": QuadraticProgram,
    "cvxpy": ConvexProgram,
}
"""The house's own solvers by name. A new one is a file and a line here; `plugins` finds those of others."""


def make(name: str) -> Solver:
    """Which solver does this name mean?

    Parameters
    ----------
    name : str
        A name in `SOLVERS`, or one that another distribution offers. What follows a colon sets the solver's
        first hyper-parameter: ``"qp:osqp"`` is ``QuadraticProgram(backend="osqp")``.

    Raises
    ------
    UnknownSolver
        If there is no such name.
    PluginError
        If another distribution offers the name, and what it offers cannot be used.
    ValueError
        If the solver refuses the hyper-parameter.
    """
    family, colon, choice = name.partition(":")
    solver_class = SOLVERS.get(family) or plugins.find(family)
    if solver_class is None:
        names = [*SOLVERS, *plugins.offered()]
        close = difflib.get_close_matches(family, names, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"choose one of {', '.join(names)}"
        raise UnknownSolver(f"no solver is called {family!r}; {hint}")
    if not colon:
        solver: Solver = solver_class()
        return solver
    parameters = fields(solver_class)
    if not parameters:
        raise UnknownSolver(f"{family!r} has no variants, so {name!r} means nothing; write {family!r}")
    first = parameters[0]
    default: Any = first.default
    try:
        value = default.__class__(choice)
    except (TypeError, ValueError):
        raise UnknownSolver(f"in {name!r}, {choice!r} is no value for {family}'s {first.name}") from None
    variant: Solver = solver_class(**{first.name: value})
    return variant


def fused(solver: Solver) -> FusedSolver | None:
    """Return a solver that also verifies its answers, in one pass; None where `tensionlab.verification` has to.

    Only built-in solvers may: the statuses of others are never believed.
    """
    built_in = type(solver) in SOLVERS.values() and hasattr(solver, "solve_verified")
    return cast(FusedSolver, solver) if built_in else None


__all__ = ["SOLVERS", "Answer", "Nearest", "Problem", "Solver", "Status", "fused", "make"]
