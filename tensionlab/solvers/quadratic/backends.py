"""The QP solvers that qpsolvers finds: their names, their settings, and one call of one of them.

A backend sees programs of one shape, with a diagonal cost, because all of them solve that shape accurately::

    minimise  x' diag(cost) x / 2 + linear' x   subject to   rows x = values,   lower <= x <= upper

What it claims (found, status) is never read: its x is measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab.arrays import Floats

BACKENDS: dict[str, dict[str, Any]] = {
    # The programs are scaled already; Clarabel's own scaling costs it the last digits.
    "clarabel": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12, "equilibrate_enable": False},
    # At its default of 1e-4, OSQP takes some wrenches for unreachable that are not.
    "osqp": {"eps_abs": 1e-10, "eps_rel": 0.0, "eps_prim_inf": 1e-8, "polishing": True, "max_iter": 20_000},
    "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-11},
    "quadprog": {},
    "piqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 0.0},
    # Without a limit ProxQP spends half a second on each wrench out of reach, and HiGHS may cycle for ever.
    "proxqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "max_iter": 500},
    "highs": {
        "primal_feasibility_tolerance": 1e-10,
        "dual_feasibility_tolerance": 1e-10,
        "qp_regularization_value": 0.0,
        "qp_iteration_limit": 1000,
        "time_limit": 1.0,
    },
}
"""QP solvers by their names in qpsolvers, with settings that make their answers pass `TOLERANCE`."""
SPARSE = frozenset({"clarabel", "osqp", "highs"})
"""Those that take sparse matrices only."""


def installed_backends() -> tuple[str, ...]:
    """Which QP solvers `QuadraticProgram` can use on this machine."""
    import qpsolvers

    return tuple(name for name in BACKENDS if name in qpsolvers.available_solvers)


class NoTensions(RuntimeError):  # noqa: N818 - it says what happened
    """A backend gave nothing even for a program that only has limits."""


def raised_by(backend: str) -> tuple[type[Exception], ...]:
    """Which exceptions a backend throws on a program that it cannot digest."""
    from qpsolvers.exceptions import QPError

    # ValueError and RuntimeError: what C++ bindings make of a breakdown, and NumPy of an SVD's.
    raised: tuple[type[Exception], ...] = (QPError, ValueError, RuntimeError)
    if backend == "osqp":
        from osqp import OSQPException

        raised += (OSQPException,)
    return raised


@dataclass
class Engine:
    """One backend, and the iterations it has spent."""

    name: str
    iterations: int = 0

    def minimise(
        self, cost: Floats, linear: Floats, rows: Floats, values: Floats, limits: tuple[Floats, Floats]
    ) -> Floats | None:
        """Which x inside the limits the backend gives for the program of this module, or None."""
        import qpsolvers
        from scipy import sparse

        matrix: Any = sparse.csc_matrix if self.name in SPARSE else np.asarray
        lower, upper = limits
        program = qpsolvers.Problem(matrix(np.diag(cost)), linear, A=matrix(rows), b=values, lb=lower, ub=upper)
        solution = qpsolvers.solve_problem(program, self.name, **BACKENDS[self.name])
        if "info" in solution.extras:
            self.iterations += int(solution.extras["info"].iter)
        elif "iterations" in solution.extras:
            self.iterations += int(solution.extras["iterations"][0])
        x = solution.x
        if x is None or len(x) != len(cost) or not np.isfinite(x).all():
            return None
        inside: Floats = np.clip(x, lower, upper)
        return inside
