"""Baselines: solvers of others run as they come, one program, once, with no policy and nothing repaired."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import InputError, MissingDependency, UnknownSolver
from tensionlab.solvers.quadratic import BACKENDS, SPARSE, installed_backends, raised_by


@dataclass(frozen=True)
class Reply:
    """What a peer gave back for one problem; none of it is believed.

    Attributes
    ----------
    tensions : (m,) array or None
        Tensions in N, just as they came, limits broken or not; None if there were none.
    iterations : int
        As the baseline counts them; 0 where it does not say.
    setup_s, solve_s : float
        Its own clock, in seconds; NaN where it does not say.
    failure : str
        Why there are no tensions.
    """

    tensions: Floats | None
    iterations: int = 0
    setup_s: float = float("nan")
    solve_s: float = float("nan")
    failure: str = ""


class Baseline(Protocol):
    """One way to minimise ``|t|²`` subject to ``W t = w`` and limits, in two steps that are timed apart."""

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Put one problem, (n, m), (n,), (m,), (m,), into the form that the baseline takes."""
        ...

    def run(self, program: Any) -> Reply:
        """Solve it."""
        ...


def finite_tensions(found: Any, cables: int) -> Floats | None:
    """Return what a backend gave as finite tensions, or None."""
    if found is None or np.shape(found) != (cables,) or not np.isfinite(found).all():
        return None
    return np.array(found, dtype=np.float64)


TIGHT: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 0.0, "polishing": True, "max_iter": 20_000},
    "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-11},
    "piqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 0.0},
    "proxqp": {"eps_abs": 1e-11, "eps_rel": 0.0},
    "highs": {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
}
"""The tight settings of each backend: as accurate as its own options make it. quadprog has none."""

ALWAYS: dict[str, dict[str, Any]] = {
    # Its clock is off by default.
    "piqp": {"compute_timings": True},
    # Without a limit it has spent 50 s on one wrench out of reach; within reach it needs some 20 iterations.
    "proxqp": {"compute_timings": True, "max_iter": 500},
    # It may cycle for ever there.
    "highs": {"time_limit": 1.0, "qp_iteration_limit": 10_000},
}
"""Set in both: what a measurement needs, and what keeps it from hanging."""

CLOCK = {"proxqp": 1e-6}
"""Unit of a backend's own times, in s, where it is not the second."""


@dataclass(frozen=True)
class PlainProgram:
    """Backend of qpsolvers on the plain program: least ``|t|²`` with ``W t = w`` and the limits.

    Parameters
    ----------
    backend : str
        A name in `BACKENDS`.
    settings : {"default", "tight"}
        The backend's own defaults, or `TIGHT`.
    """

    backend: str
    settings: Literal["default", "tight"] = "default"

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise UnknownSolver(f"no QP backend is called {self.backend!r}; choose one of {', '.join(BACKENDS)}")
        if self.settings == "tight" and self.backend not in TIGHT:
            raise InputError(f"{self.backend} has no options that would make it tighter; use its defaults")
        if self.backend not in installed_backends():
            raise MissingDependency(
                f'QP backend {self.backend!r} is not installed; pip install "tensionlab[solvers]" brings it'
            )

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Make the program of qpsolvers, its matrices dense or sparse as the backend takes them."""
        import qpsolvers

        cables = structure.shape[1]
        cost: Any = np.eye(cables)
        rows: Any = structure
        if self.backend in SPARSE:
            from scipy import sparse

            cost, rows = sparse.eye(cables, format="csc"), sparse.csc_matrix(structure)
        return qpsolvers.Problem(cost, np.zeros(cables), A=rows, b=wrench, lb=lower, ub=upper)

    def run(self, program: Any) -> Reply:
        """Solve it; `warnings` are the caller's to silence, because that would cost time here."""
        import qpsolvers

        options = ALWAYS.get(self.backend, {}) | (TIGHT[self.backend] if self.settings == "tight" else {})
        try:
            solution = qpsolvers.solve_problem(program, self.backend, **options)
        except raised_by(self.backend) as error:
            return Reply(None, failure=f"{type(error).__name__}: {error}")
        tensions = finite_tensions(solution.x, len(program.q))
        extras = solution.extras
        info = extras.get("info")
        unit = CLOCK.get(self.backend, 1.0)
        return Reply(
            tensions,
            iterations=int(info.iter) if info else int(extras.get("iterations", [0])[0]),
            setup_s=unit * info.setup_time if info else float("nan"),
            solve_s=unit * info.solve_time if info else extras.get("solve_time", float("nan")),
            failure="" if tensions is not None else "gave no finite tensions",
        )


def solve_qp(structure: Floats, wrench: Floats, lower: Floats, upper: Floats, backend: str) -> Floats | None:
    """Return the tensions of the one call that the front page of qpsolvers shows, or None."""
    import qpsolvers

    cables = structure.shape[1]
    found: Floats | None = qpsolvers.solve_qp(
        np.eye(cables), np.zeros(cables), A=structure, b=wrench, lb=lower, ub=upper, solver=backend
    )
    return found
