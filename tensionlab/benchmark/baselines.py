"""Baselines: QP solvers called as their own documentation shows, on the plain program.

The plain program minimises ``|t|²`` subject to ``W t = w`` and the limits. Nothing is scaled or verified.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from tensionlab.errors import InputError, optional_import
from tensionlab.solvers.convex import SETTINGS, CompiledPrograms, compiled_programs, require_cvxpy
from tensionlab.solvers.programs import finite_tensions
from tensionlab.solvers.quadratic import (
    BACKENDS,
    SPARSE,
    check_installed,
    check_known,
    import_qpsolvers,
    raised_by,
)
from tensionlab.support.arrays import Floats

Tolerance = Literal["default", "tight"]

BASELINES = ("daqp", *(f"qpsolvers:{backend}" for backend in BACKENDS), "cvxpy:plain")  # "daqp": without qpsolvers
TIGHT: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 0.0, "polishing": True, "max_iter": 20_000},
    "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-11},
    "piqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 0.0},
    "proxqp": {"eps_abs": 1e-11, "eps_rel": 0.0},
    "highs": {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
}  # settings that make each backend as accurate as its own options allow; quadprog has none
ALWAYS: dict[str, dict[str, Any]] = {
    # Without a limit it spends 50 s on some infeasible wrenches; feasible ones need some 20 iterations.
    "proxqp": {"max_iter": 500, "compute_timings": True},
    "piqp": {"compute_timings": True},
    "highs": {"time_limit": 1.0, "qp_iteration_limit": 10_000},  # it may cycle on infeasible wrenches
}  # settings in both cases: they keep a backend from hanging, and let it read its own clock
DAQP_EQUALITY = 5  # DAQP's mark of a constraint that is an equality


class Reply(NamedTuple):
    """Unverified, unclipped tensions of a baseline, (m,), in N, or a reason; iterations and seconds as it says."""

    tensions: Floats | None
    iterations: int = 0
    failure: str = ""
    own_s: float = np.nan


def load_daqp() -> Any:
    """Return DAQP's own module; MissingDependency if it is not installed."""
    with optional_import("solvers", "entry daqp"):
        import daqp
    return daqp


class DirectDaqp:
    """DAQP by its own Python module, the fastest baseline.

    Source: Arnström, Bemporad and Axehill, "A dual active-set solver for embedded quadratic programming using
    recursive LDL' updates", 2022.
    """

    def __init__(self, tolerance: Tolerance = "default") -> None:
        self.solve = load_daqp().solve
        self.settings = TIGHT["daqp"] if tolerance == "tight" else {}

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Make the cost and stack limits and equations, as a script does in each call."""
        n, m = structure.shape
        above, below = np.concatenate([upper, wrench]), np.concatenate([lower, wrench])
        sense = np.array([0] * m + [DAQP_EQUALITY] * n, dtype=np.int32)
        return np.eye(m), np.zeros(m), structure, above, below, sense

    def run(self, program: Any) -> Any:
        """Solve a program of `build`."""
        return self.solve(*program, **self.settings)

    def read(self, program: Any, result: Any) -> Reply:
        """Read DAQP's result."""
        solution, _, flag, info = result
        tensions = finite_tensions(solution, len(program[1]))
        own_s = info["setup_time"] + info["solve_time"]
        return Reply(tensions, int(info["iterations"]), f"gave no finite tensions (exit flag {flag})", own_s)


@dataclass(frozen=True)
class PlainProgram:
    """Backend of qpsolvers."""

    backend: str
    tolerance: Tolerance = "default"

    def __post_init__(self) -> None:
        check_known(self.backend)
        if self.tolerance == "tight" and self.backend not in TIGHT:
            raise InputError(f"{self.backend} has no options that would make it tighter; use its defaults")
        check_installed(self.backend)

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Make the program of qpsolvers, its matrices dense or sparse as the backend takes them."""
        cables = structure.shape[1]
        cost: Any = np.eye(cables)
        rows: Any = structure
        if self.backend in SPARSE:
            from scipy import sparse

            cost, rows = sparse.eye(cables, format="csc"), sparse.csc_matrix(structure)
        return import_qpsolvers().Problem(cost, np.zeros(cables), A=rows, b=wrench, lb=lower, ub=upper)

    def run(self, program: Any) -> Any:
        """Solve it; the caller silences `warnings`, because that would cost time here."""
        options = ALWAYS.get(self.backend, {}) | (TIGHT[self.backend] if self.tolerance == "tight" else {})
        try:
            return import_qpsolvers().solve_problem(program, self.backend, **options)
        except raised_by(self.backend) as error:
            return error

    def read(self, program: Any, result: Any) -> Reply:
        """Read a solution of qpsolvers."""
        info = result.extras.get("info")
        iterations = info.iter if info else result.extras.get("iterations", [0])[0]
        own_s = info.run_time if info else result.extras.get("solve_time", np.nan)
        own_s *= 1e-6 if self.backend == "proxqp" else 1.0  # ProxQP counts microseconds
        return Reply(finite_tensions(result.x, len(program.q)), int(iterations), "gave no finite tensions", own_s)


@dataclass(frozen=True)
class PlainConvex:
    """Program written in cvxpy, compiled once for each shape; each call fills in numbers and starts cold.

    By default with the solver that cvxpy chooses; tight is Clarabel with `tensionlab.solvers.convex.SETTINGS`.
    """

    tolerance: Tolerance = "default"

    def __post_init__(self) -> None:
        require_cvxpy()

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> CompiledPrograms:
        """Fill the numbers into the program of this shape."""
        n, m = structure.shape
        program = compiled_programs(n, m, threading.get_ident())
        program.W.value, program.w.value = structure, wrench
        program.lower.value, program.upper.value, program.reference.value = lower, upper, np.zeros(m)
        program.t.value = None
        return program

    def run(self, program: CompiledPrograms) -> Any:
        """Solve a program of `build`."""
        from cvxpy.error import SolverError

        options = {"solver": "CLARABEL", **SETTINGS["CLARABEL"]} if self.tolerance == "tight" else {}
        try:
            return program.closest.solve(warm_start=False, **options)
        except (SolverError, ValueError) as error:
            return error

    def read(self, program: CompiledPrograms, result: Any) -> Reply:
        """Read the variables of the program."""
        tensions = finite_tensions(program.t.value, program.t.size)
        stats = program.closest.solver_stats
        own_s = np.nan if stats.solve_time is None else stats.solve_time
        return Reply(tensions, stats.num_iters or 0, f"gave no tensions ({program.closest.status})", own_s)


# `build` puts one problem, (n, m), (n,), (m,), (m,), into the library's form, `run` solves it or returns the
# exception that the backend throws, and `read` reads the result.
Baseline = DirectDaqp | PlainProgram | PlainConvex


def make_baseline(name: str, tolerance: Tolerance = "default") -> Baseline:
    """Return a baseline of `BASELINES`; MissingDependency if its library is not installed."""
    if name == "daqp":
        return DirectDaqp(tolerance)
    if name == "cvxpy:plain":
        return PlainConvex(tolerance)
    return PlainProgram(name.partition(":")[2], tolerance)
