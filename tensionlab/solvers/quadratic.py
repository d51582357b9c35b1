"""Tensions by quadratic programs, solved by any backend of qpsolvers."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any, ClassVar

import numpy as np

from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers.base import TOLERANCE, Answer, Policy, Problem
from tensionlab.solvers.programs import (
    NO_TENSIONS,
    SAFETY,
    ScaledProblem,
    choose_each,
    finite_tensions,
    independent_rows,
)
from tensionlab.support.arrays import Floats
from tensionlab.support.operating_system import holding_interrupts

# QP solvers by their names in qpsolvers, with settings that make their answers pass `TOLERANCE`.
BACKENDS: dict[str, dict[str, Any]] = {
    # The programs are scaled already; Clarabel's own scaling costs it the last digits.
    "clarabel": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12, "equilibrate_enable": False},
    # At its default of 1e-4, OSQP takes some wrenches for unreachable that are not.
    "osqp": {"eps_abs": 1e-10, "eps_rel": 0.0, "eps_prim_inf": 1e-8, "polishing": True, "max_iter": 20_000},
    "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-11},
    "quadprog": {},
    "piqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 0.0},
    # Without a limit ProxQP spends half a second on each infeasible wrench, and HiGHS may cycle.
    "proxqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "max_iter": 500},
    "highs": {
        "primal_feasibility_tolerance": 1e-10,
        "dual_feasibility_tolerance": 1e-10,
        "qp_regularization_value": 0.0,
        "qp_iteration_limit": 1000,
        "time_limit": 1.0,
    },
}
MODULES = {"proxqp": "proxsuite", "highs": "highspy"}  # that are not called as the backend is
SPARSE = frozenset({"clarabel", "osqp", "highs"})  # those that take sparse matrices only
PROXIMAL = 1e-6  # weight of staying at the last tensions while the wrench error, of weight 1, is minimised
DIRECTION = 1e-4  # the same while the scale of the wrench is maximised
BIAS = 1e-4  # share of the accepted error that these steps may leave; one more step than it takes is cheap
MAX_STEPS = 8  # most of these steps; two or three are usual


def installed_backends() -> tuple[str, ...]:
    """Return the QP solvers that `QuadraticProgram` can use on this machine, without importing them."""
    if find_spec("qpsolvers") is None:
        return ()
    return tuple(name for name in BACKENDS if find_spec(MODULES.get(name, name)) is not None)


@cache
def import_qpsolvers() -> Any:
    """Return qpsolvers, imported without JAX, which it imports before it finds that there is no jaxopt."""
    if find_spec("jaxopt") is None:
        sys.modules["qpsolvers.solvers.jaxopt_osqp_"] = None  # type: ignore[assignment]
    with holding_interrupts():
        import qpsolvers

    return qpsolvers


def check_known(backend: str) -> None:
    """Refuse a name that no backend has."""
    if backend not in BACKENDS:
        raise UnknownSolver(f"no QP backend is called {backend!r}; choose one of {', '.join(BACKENDS)}")


def check_installed(backend: str) -> None:
    """Refuse a backend that is not installed."""
    if backend not in installed_backends():
        raise MissingDependency(f'QP backend {backend!r} is not installed: pip install "tensionlab[solvers]"')


def raised_by(backend: str) -> tuple[type[Exception], ...]:
    """Return the exceptions that a backend throws on a program that it cannot digest."""
    from qpsolvers.exceptions import QPError

    # ValueError and RuntimeError: what C++ bindings make of a breakdown, and NumPy of an SVD's.
    raised: tuple[type[Exception], ...] = (QPError, ValueError, RuntimeError)
    if backend == "osqp":
        from osqp import OSQPException

        raised += (OSQPException,)
    return raised


@dataclass(frozen=True)
class QuadraticProgram:
    """Tensions closest to the reference by quadratic programs.

    Minimises ``|t - reference|²`` subject to ``W t = w`` and the limits. Where the measured answer misses w:

    - "force" minimises ``(W t - w)' Q (W t - w)`` inside the limits, Q the weights of the problem;
    - "tension" does the same with ``(W W')⁺`` for Q;
    - "direction" maximises s in [0, 1] subject to ``W t = s w``; without any such s it is "force"; a wrench
      nearly parallel to a facet is kept as far as the tolerance allows (`tensionlab.solvers.programs`);

    and ``|t - reference|²`` is minimised again among the tensions that render the same wrench. The costs in
    the list are not strictly convex, which some backends refuse, so both are minimised by proximal steps:
    each adds a small cost of leaving the last tensions, and repeating it removes the bias.

    Sources: Oh and Agrawal, "Cable suspended planar robots with redundant cables: controllers with positive
    tensions", 2005, for the program; Rockafellar, "Monotone operators and the proximal point algorithm",
    1976; Caron and others, qpsolvers, for the backends.

    Parameters
    ----------
    backend : str
        A name in `BACKENDS`. Iterations are those of all programs together; 0 from clarabel, daqp and highs,
        which report none.
    """

    backend: str = "clarabel"

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Policy, ...]] = ("force", "tension", "direction")

    def __post_init__(self) -> None:
        check_known(self.backend)

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch, one after another."""
        check_installed(self.backend)

        def start(scaled: ScaledProblem) -> _QuadraticPrograms:
            return _QuadraticPrograms(self.backend, scaled)

        return choose_each(problem, self.backend, start, raised_by(self.backend))


@dataclass
class _QuadraticPrograms:
    backend: str
    scaled: ScaledProblem
    iterations: int = 0
    reason: str = NO_TENSIONS

    def _minimise(
        self, cost: Floats, linear: Floats, rows: Floats, values: Floats, limits: tuple[Floats, Floats]
    ) -> Floats | None:
        """Return the x inside the limits that the backend gives for the program of this module, or None."""
        from scipy import sparse

        qpsolvers = import_qpsolvers()
        matrix: Any = sparse.csc_matrix if self.backend in SPARSE else np.asarray
        lower, upper = limits
        program = qpsolvers.Problem(matrix(np.diag(cost)), linear, A=matrix(rows), b=values, lb=lower, ub=upper)
        solution = qpsolvers.solve_problem(program, self.backend, **BACKENDS[self.backend])
        if "info" in solution.extras:
            self.iterations += int(solution.extras["info"].iter)
        elif "iterations" in solution.extras:
            self.iterations += int(solution.extras["iterations"][0])
        x = finite_tensions(solution.x, len(cost))
        return None if x is None else np.clip(x, lower, upper)

    def closest(self, wrench: Floats) -> Floats | None:
        scaled = self.scaled
        basis, strength = independent_rows(scaled.structure)
        rows = basis.T @ scaled.structure / strength[:, None]
        values = basis.T @ wrench / strength
        cost = np.ones(len(scaled.reference))
        return self._minimise(cost, -scaled.reference, rows, values, (scaled.lower, scaled.upper))

    def least_error(self, root: Floats, wrench: Floats) -> Floats | None:
        scaled = self.scaled
        weighted = root @ scaled.structure
        basis, strength = independent_rows(weighted)
        size = strength[0]
        rows, values = basis.T @ weighted / size, basis.T @ root @ wrench / size
        count, cables = rows.shape
        # The error is a variable of its own, x = (t, error), so that the cost stays diagonal.
        cost = np.concatenate([np.full(cables, PROXIMAL), np.ones(count)])
        beyond = np.full(count, np.inf)
        limits = np.concatenate([scaled.lower, -beyond]), np.concatenate([scaled.upper, beyond])
        best: Floats | None = None
        centre = np.clip(scaled.reference, scaled.lower, scaled.upper)
        for _ in range(MAX_STEPS):
            linear = np.concatenate([-PROXIMAL * centre, np.zeros(count)])
            solution = self._minimise(cost, linear, np.hstack([rows, np.eye(count)]), values, limits)
            if solution is None:
                break
            best = centre = solution[:cables]
            # No tensions inside the limits have an error smaller than this one's by more than gap / |error|.
            error = values - rows @ centre
            pull = error @ rows
            gap = np.maximum(pull * (scaled.lower - centre), pull * (scaled.upper - centre)).sum()
            if size * gap <= BIAS * scaled.accepted * np.linalg.norm(error):
                break
        return best

    def longest(self) -> tuple[Floats | None, float]:
        scaled = self.scaled
        matrix = np.hstack([scaled.structure, -scaled.wrench[:, None]])
        basis, strength = independent_rows(matrix)
        rows, values = basis.T @ matrix / strength[:, None], -basis.T @ scaled.fixed_wrench / strength
        limits = np.append(scaled.lower, 0.0), np.append(scaled.upper, 1.0)
        cost, gain = np.full(matrix.shape[1], DIRECTION), np.eye(matrix.shape[1])[-1]
        best, centre = None, np.append(scaled.reference, 1.0)
        for _ in range(MAX_STEPS):
            solution = self._minimise(cost, -gain - DIRECTION * centre, rows, values, limits)
            if solution is None or np.linalg.norm(matrix @ solution + scaled.fixed_wrench) > scaled.accepted:
                break
            converged = best is not None and solution[-1] - best[-1] <= BIAS * SAFETY * TOLERANCE
            best = centre = solution
            if converged:
                break
        return (None, 0.0) if best is None else (best[:-1], float(best[-1]))
