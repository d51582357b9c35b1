"""Tension allocation as small quadratic programs, for every QP solver that qpsolvers finds.

Whatever the policy, a backend only sees programs of one shape, with a diagonal cost, orthogonal equality
rows and simple limits, because all of them solve that shape accurately::

    minimise  x' diag(cost) x / 2 + linear' x   subject to   rows x = values,   lower <= x <= upper

The claims of a backend (found, status) are never read: its x is measured.
"""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers.contract import TOLERANCE, Answer, Floats, Nearest, Problem
from tensionlab.solvers.linear import independent_rows, whitener


@dataclass(frozen=True)
class Backend:
    """How qpsolvers' name for a solver is installed, fed, and made accurate enough."""

    module: str
    sparse: bool
    settings: dict[str, float | bool]


BACKENDS: dict[str, Backend] = {
    "clarabel": Backend("clarabel", True, {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12}),
    "osqp": Backend("osqp", True, {"eps_abs": 1e-10, "eps_rel": 0.0, "polishing": True, "max_iter": 20_000}),
    "daqp": Backend("daqp", False, {"primal_tol": 1e-11, "dual_tol": 1e-11}),
    "quadprog": Backend("quadprog", False, {}),
    "piqp": Backend(
        "piqp",
        False,
        {"eps_abs": 1e-11, "eps_rel": 0.0, "eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 0.0},
    ),
    "proxqp": Backend("proxsuite", False, {"eps_abs": 1e-11, "eps_rel": 0.0}),
    "highs": Backend(
        "highspy",
        True,
        {
            "primal_feasibility_tolerance": 1e-10,
            "dual_feasibility_tolerance": 1e-10,
            "qp_regularization_value": 0.0,
        },
    ),
}
"""The QP solvers that can be asked for, by their names in qpsolvers, with settings that pass `TOLERANCE`."""

SAFETY = 0.1
"""Share of `TOLERANCE` that an answer may use up here before the next program is tried."""
PROXIMAL = 1e-6
"""Weight of staying at the last tensions while the wrench error, of weight 1, is minimised."""
DIRECTION = 1e-4
"""The same while the length along the wrench is maximised; it need not be small, only repeated."""
BIAS = 1e-4
"""Share of the accepted error that the proximal steps may leave; one step more than it takes is cheap."""
STEPS = 8
"""Most repetitions of one of these; two or three are usual."""


def installed_backends() -> tuple[str, ...]:
    """Which QP solvers `QuadraticProgram` can use on this machine."""
    if importlib.util.find_spec("qpsolvers") is None:
        return ()
    return tuple(name for name, backend in BACKENDS.items() if importlib.util.find_spec(backend.module))


@dataclass(frozen=True)
class QuadraticProgram:
    """Which tensions closest to the reference render the wrench, as quadratic programs say.

    Minimises ``|t - reference|²`` subject to ``W t = w`` and the limits. Where the measured answer misses w:

    - "force": minimises ``(W t - w)' Q (W t - w)`` inside the limits, Q the weights of the problem;
    - "tension": the same with ``(W W')⁺`` for Q;
    - "direction": maximises s in [0, 1] subject to ``W t = s w``; without any such s, as "force";

    and then again ``|t - reference|²`` among the tensions that render the same wrench. The last two costs are
    not strictly convex, which some backends refuse, so both are minimised by proximal steps: each adds a
    small cost of leaving the last tensions, and repeating it removes the bias.

    Sources: Oh and Agrawal, "Cable suspended planar robots with redundant cables: controllers with positive
    tensions", 2005, for the program; Rockafellar, "Monotone operators and the proximal point algorithm",
    1976; qpsolvers by Caron and others for the backends.

    Parameters
    ----------
    backend : str
        A name in `BACKENDS`. Iterations are those of all programs together, where the backend tells them.
    """

    backend: str = "clarabel"

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Nearest, ...]] = ("force", "tension", "direction")

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise UnknownSolver(
                f"QP backend {self.backend!r} is unknown: choose one of {', '.join(BACKENDS)}"
            )

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch, one after another."""
        if self.backend not in installed_backends():
            raise MissingDependency(
                f"the QP backend {self.backend!r} is not installed: "
                'install it with pip install "tensionlab[solvers]"'
            )
        tensions = np.full(problem.reference.shape, np.nan)
        iterations = np.zeros(len(problem), dtype=np.int64)
        failures: dict[int, str] = {}
        errors = _raised_by(self.backend)
        roots = _metrics(problem)
        with warnings.catch_warnings():
            # Backends warn of every program without a solution; here that is an answer like any other.
            warnings.simplefilter("ignore")
            for row in range(len(problem)):
                engine = _Engine(self.backend)
                try:
                    found = _allocate(engine, problem, row, roots[row])
                except errors as error:
                    failures[row] = f"{self.backend}: {type(error).__name__}: {error}"
                    continue
                iterations[row] = engine.iterations
                if found is None:
                    failures[row] = f"{self.backend}: gave no tensions, not even inside the limits alone"
                else:
                    tensions[row] = found
        return Answer(tensions=tensions, iterations=iterations, failures=failures)


def _raised_by(backend: str) -> tuple[type[Exception], ...]:
    """Which exceptions a backend throws on a program that it cannot digest."""
    from qpsolvers.exceptions import QPError

    # ValueError and RuntimeError: what the C++ bindings make of a breakdown, and NumPy of an SVD's.
    raised: tuple[type[Exception], ...] = (QPError, ValueError, RuntimeError)
    if backend == "osqp":
        from osqp import OSQPException

        raised += (OSQPException,)
    return raised


def _metrics(problem: Problem) -> Floats:
    """Which matrix turns a wrench error into what the policy minimises: (B, n, n)."""
    if problem.nearest == "tension":
        return whitener(problem.structure)
    force = np.diag(np.sqrt(problem.weights))
    return np.broadcast_to(force, (len(problem), *force.shape))


@dataclass
class _Engine:
    """One backend, and the iterations it has spent."""

    name: str
    iterations: int = 0

    def minimise(
        self, cost: Floats, linear: Floats, rows: Floats, values: Floats, lower: Floats, upper: Floats
    ) -> Floats | None:
        """Which x inside its limits the backend gives for the program of this module, or None."""
        from qpsolvers import Problem as Program
        from qpsolvers import solve_problem

        backend = BACKENDS[self.name]
        quadratic: Any = np.diag(cost)
        if backend.sparse:
            quadratic, rows = sparse.csc_matrix(quadratic), sparse.csc_matrix(rows)
        program = Program(quadratic, linear, A=rows, b=values, lb=lower, ub=upper)
        solution = solve_problem(program, self.name, **backend.settings)
        extras = solution.extras
        if "info" in extras:
            self.iterations += int(extras["info"].iter)
        elif "iterations" in extras:
            self.iterations += int(extras["iterations"][0])
        x = solution.x
        if x is None or len(x) != len(cost) or not np.isfinite(x).all():
            return None
        return np.clip(x, lower, upper)


@dataclass(frozen=True)
class _Row:
    """One problem without its fixed cables, tensions in units of the largest limit or reference.

    The free cables have to render ``wrench - held``; an error of ``accepted`` is as good as none.
    """

    structure: Floats
    wrench: Floats
    held: Floats
    lower: Floats
    upper: Floats
    reference: Floats
    accepted: float


def _allocate(engine: _Engine, problem: Problem, index: int, root: Floats) -> Floats | None:
    """Which tensions the policy chooses for one problem of the batch; None if the backend gives none."""
    lower, upper, reference = problem.lower[index], problem.upper[index], problem.reference[index]
    structure, wrench = problem.structure[index], problem.wrench[index]
    tensions = lower.copy()
    # A cable without play would leave interior-point backends no interior.
    free = lower < upper
    if not structure[:, free].any():
        tensions[free] = np.clip(reference, lower, upper)[free]
        return tensions
    unit = float(max(abs(lower).max(), abs(upper).max(), abs(reference).max()))
    row = _Row(
        structure=structure[:, free],
        wrench=wrench / unit,
        held=structure[:, ~free] @ lower[~free] / unit,
        lower=lower[free] / unit,
        upper=upper[free] / unit,
        reference=reference[free] / unit,
        accepted=SAFETY * TOLERANCE * max(1.0, float(np.linalg.norm(wrench))) / unit,
    )
    found = _choose(engine, row, root, problem.nearest)
    if found is None:
        return None
    tensions[free] = np.clip(found * unit, lower[free], upper[free])
    return tensions


def _choose(engine: _Engine, row: _Row, root: Floats, nearest: Nearest | None) -> Floats | None:
    exact = _closest(engine, row, row.wrench - row.held)
    if exact is not None:
        return exact
    best = _furthest(engine, row) if nearest == "direction" else None
    if best is None:
        best = _least_error(engine, row, root)
    if best is None:
        return None
    tied = _closest(engine, row, row.structure @ best)
    return best if tied is None else tied


def _closest(engine: _Engine, row: _Row, wrench: Floats) -> Floats | None:
    """Which tensions closest to the reference render a wrench; None if the backend's don't."""
    basis, strength = independent_rows(row.structure)
    rows = basis.T @ row.structure / strength[:, None]
    values = basis.T @ wrench / strength
    found = engine.minimise(np.ones(rows.shape[1]), -row.reference, rows, values, row.lower, row.upper)
    if found is None or np.linalg.norm(row.structure @ found - wrench) > row.accepted:
        return None
    return found


def _least_error(engine: _Engine, row: _Row, root: Floats) -> Floats | None:
    """Which tensions make ``|root (W t - w)|`` least inside the limits; None if the backend gives none."""
    weighted = root @ row.structure
    basis, strength = independent_rows(weighted)
    size = strength[0]
    rows, values = basis.T @ weighted / size, basis.T @ root @ (row.wrench - row.held) / size
    count, cables = rows.shape
    unlimited = np.full(count, np.inf)
    best = None
    centre = np.clip(row.reference, row.lower, row.upper)
    for _ in range(STEPS):
        found = engine.minimise(
            np.concatenate([np.full(cables, PROXIMAL), np.ones(count)]),
            np.concatenate([-PROXIMAL * centre, np.zeros(count)]),
            np.hstack([rows, np.eye(count)]),
            values,
            np.concatenate([row.lower, -unlimited]),
            np.concatenate([row.upper, unlimited]),
        )
        if found is None:
            return best
        best = centre = found[:cables]
        # No tensions inside the limits have an error smaller than this one's by more than the gap.
        error = values - rows @ best
        pull = error @ rows
        gap = np.maximum(pull * (row.lower - best), pull * (row.upper - best)).sum()
        if size * gap <= BIAS * row.accepted * np.linalg.norm(error):
            break
    return best


def _furthest(engine: _Engine, row: _Row) -> Floats | None:
    """Which tensions render ``s w`` with the largest s in [0, 1]; None if no s is found."""
    matrix = np.hstack([row.structure, -row.wrench[:, None]])
    basis, strength = independent_rows(matrix)
    rows, values = basis.T @ matrix / strength[:, None], -basis.T @ row.held / strength
    lower, upper = np.append(row.lower, 0.0), np.append(row.upper, 1.0)
    gain = np.zeros(lower.size)
    gain[-1] = 1.0
    cost = np.full(lower.size, DIRECTION)
    best, centre = None, np.append(row.reference, 1.0)
    for _ in range(STEPS):
        found = engine.minimise(cost, -gain - DIRECTION * centre, rows, values, lower, upper)
        if found is None or np.linalg.norm(matrix @ found + row.held) > row.accepted:
            break
        grown = best is None or found[-1] > best[-1] + 1e-10
        if best is None or found[-1] > best[-1]:
            best = found
        if not grown:
            break
        centre = found
    return None if best is None else best[:-1]
