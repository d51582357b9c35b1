"""Tension allocation written down in cvxpy: the readable reference for all three policies."""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers.base import TOLERANCE, Answer, Nearest, Problem
from tensionlab.solvers.baselines import Reply, finite_tensions
from tensionlab.solvers.programs import Ray, whitener

SETTINGS: dict[str, dict[str, Any]] = {
    "CLARABEL": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12},
}
"""The solvers of cvxpy that can be asked for, with settings that pass `TOLERANCE`."""

SAFETY = 0.1
"""Share of `TOLERANCE` that an answer may use up here before the next program is tried."""


@dataclass(frozen=True)
class ConvexProgram:
    """Which tensions closest to the reference render the wrench, as one would write it on a blackboard.

    Minimises ``|t - reference|²`` subject to ``W t = w`` and the limits. Where the measured answer misses w,
    the policy says what to render instead ("force": the least ``(W t - w)' Q (W t - w)``, Q the weights;
    "tension": the same with ``(W W')⁺`` for Q; "direction": the largest s in [0, 1] with ``W t = s w``, and
    "force" without any such s, see `tensionlab.solvers.programs`), and the first program is solved again for
    that wrench. The programs are in `CompiledPrograms`.

    Sources: Oh and Agrawal, "Cable suspended planar robots with redundant cables: controllers with positive
    tensions", 2005, for the program; Diamond and Boyd, "CVXPY: a Python-embedded modeling language for convex
    optimization", 2016; Agrawal and others, "Differentiable convex optimization layers", 2019, for the
    parameters that let one compiled program serve a whole batch.

    Parameters
    ----------
    backend : str
        A name in `SETTINGS`. Iterations are those of all programs together.
    """

    backend: str = "CLARABEL"

    objective: ClassVar[str] = "least squared change from the reference"
    policies: ClassVar[tuple[Nearest, ...]] = ("force", "tension", "direction")

    def __post_init__(self) -> None:
        if self.backend not in SETTINGS:
            raise UnknownSolver(f"cvxpy backend {self.backend!r} is unknown: choose {', '.join(SETTINGS)}")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch, one after another."""
        try:
            import cvxpy  # noqa: F401 - here, to say so before any work
        except ModuleNotFoundError as error:
            raise MissingDependency("cvxpy is not installed: pip install tensionlab brings it") from error
        size, n, m = problem.structure.shape
        board = compiled_programs(n, m, threading.get_ident())
        tensions = np.full((size, m), np.nan)
        iterations = np.zeros(size, dtype=np.int64)
        failures: dict[int, str] = {}
        with warnings.catch_warnings():
            # cvxpy warns of answers that may be inaccurate; all of them are measured.
            warnings.simplefilter("ignore")
            for row in range(size):
                run = _Run(board, self.backend)
                try:
                    found = _allocate(run, problem, row)
                except (ValueError, RuntimeError) as error:
                    failures[row] = f"{self.backend}: {type(error).__name__}: {error}"
                    continue
                iterations[row] = run.iterations
                if found is None:
                    failures[row] = f"{self.backend}: {run.reason}"
                else:
                    tensions[row] = found
        return Answer(tensions=tensions, iterations=iterations, failures=failures)


class CompiledPrograms:
    """The programs for n wrench components and m cables; W, w, ... are parameters, t and s are found.

    ``held`` is the wrench of cables that have no play, and ``root`` a root of the metric of the policy, here
    already multiplied into ``root_W`` and ``root_w``: a product of two parameters could not be compiled once.
    """

    def __init__(self, n: int, m: int) -> None:
        import cvxpy

        cp: Any = cvxpy
        self.W, self.w, self.held = cp.Parameter((n, m)), cp.Parameter(n), cp.Parameter(n)
        self.root_W, self.root_w = cp.Parameter((n, m)), cp.Parameter(n)
        self.lower, self.upper, self.reference = cp.Parameter(m), cp.Parameter(m), cp.Parameter(m)
        W, t, s = self.W, cp.Variable(m), cp.Variable()
        self.t, self.s = t, s
        limits = [self.lower <= t, t <= self.upper]

        self.closest = cp.Problem(
            cp.Minimize(cp.sum_squares(t - self.reference)),
            [W @ t + self.held == self.w, *limits],
        )
        self.least_error = cp.Problem(
            cp.Minimize(cp.sum_squares(self.root_W @ t - self.root_w)),
            limits,
        )
        self.furthest = cp.Problem(
            cp.Maximize(s),
            [W @ t + self.held == s * self.w, s >= 0, s <= 1, *limits],
        )


@lru_cache(maxsize=32)
def compiled_programs(n: int, m: int, thread: int) -> CompiledPrograms:
    """Which compiled programs serve this shape; a set for each thread, which writes its parameters there."""
    return CompiledPrograms(n, m)


@dataclass
class _Run:
    """The programs with one backend, the iterations it has spent on one problem, and why it failed if it did."""

    board: CompiledPrograms
    backend: str
    unit: float = 1.0
    iterations: int = 0
    reason: str = "gave no tensions, not even inside the limits alone"

    def solve(self, program: Any) -> Floats | None:
        """Which tensions inside the limits the backend gives for a program, or None."""
        from cvxpy.error import SolverError

        board = self.board
        # Parallel cables can stop the backend short of the last digits; its own settings then still find some.
        for settings in (SETTINGS[self.backend], {}):
            board.t.value = None
            try:
                # Cold, so that an answer does not depend on the problem before it.
                program.solve(solver=self.backend, warm_start=False, **settings)
            except SolverError as error:
                self.reason = f"{type(error).__name__}: {error}"
                continue
            self.iterations += program.solver_stats.num_iters or 0
            break
        if board.t.value is None or not np.isfinite(board.t.value).all():
            return None
        found: Floats = np.clip(board.t.value, board.lower.value, board.upper.value)
        return found


def _allocate(run: _Run, problem: Problem, row: int) -> Floats | None:
    """Which tensions the policy chooses for one problem of the batch; None if the backend gives none."""
    W, w = problem.structure[row], problem.wrench[row]
    lower, upper, reference = problem.lower[row], problem.upper[row], problem.reference[row]
    # A cable without play would leave an interior-point method no interior. It pulls as part of ``held``,
    # and in the programs its place is taken by one that may do as it likes because it pulls nothing.
    free = lower < upper
    unit = float(max(abs(lower).max(), abs(upper).max(), abs(reference).max())) or 1.0
    run.unit = unit
    board, loose = run.board, W * free
    board.W.value, board.w.value = loose, w / unit
    board.held.value = W @ np.where(free, 0.0, lower) / unit
    board.lower.value = np.where(free, lower / unit, 0.0)
    board.upper.value = np.where(free, upper / unit, 1.0)
    board.reference.value = np.where(free, reference / unit, 0.5)
    accepted = SAFETY * TOLERANCE * max(1.0, float(np.linalg.norm(w))) / unit
    found = _choose(run, problem, row, accepted)
    return None if found is None else np.where(free, np.clip(found * unit, lower, upper), lower)


def _choose(run: _Run, problem: Problem, row: int, accepted: float) -> Floats | None:
    board = run.board
    W, w, held = board.W.value, board.w.value, board.held.value

    def closest(wrench: Floats) -> Floats | None:
        board.w.value = wrench
        t = run.solve(board.closest)
        return t if t is not None and np.linalg.norm(W @ t + held - wrench) <= accepted else None

    exact = closest(w)
    if exact is not None:
        return exact

    best = None
    if problem.nearest == "direction":
        board.w.value = w
        best = run.solve(board.furthest)
        if best is not None and np.linalg.norm(W @ best + held - board.s.value * w) > accepted:
            best = None
        best = _widened(run, w, best)
    if best is None:
        force = np.diag(np.sqrt(problem.weights))
        root = whitener(problem.structure[row]) if problem.nearest == "tension" else force
        board.root_W.value, board.root_w.value = root @ W, root @ (w - held)
        best = run.solve(board.least_error)
    if best is None:
        return None
    tied = closest(W @ best + held)
    return best if tied is None else tied


def _widened(run: _Run, w: Floats, best: Floats | None) -> Floats | None:
    """Which tensions render more of the wrench where it grazes what can be rendered, or those given."""
    board, unit = run.board, run.unit
    W, held = board.W.value, board.held.value

    def nearest(s: float) -> Floats | None:
        board.root_W.value, board.root_w.value = W, s * w - held
        t = run.solve(board.least_error)
        return None if t is None else np.append(t, 1.0)

    # The cables that are held are one more, with a tension of 1, and all is in newton again.
    lower, upper = np.append(board.lower.value, 1.0), np.append(board.upper.value, 1.0)
    ray = Ray(np.column_stack([W, held]) * unit, w * unit, lower, upper, nearest)
    scale = 0.0 if best is None else float(board.s.value)
    found = ray.widened(None if best is None else np.append(best, 1.0), scale)
    return None if found is None else found[:-1]


@dataclass(frozen=True)
class PlainConvex:
    """Which tensions does cvxpy give for least ``|t|²``, ``W t = w`` and the limits, written down once?

    Parameters
    ----------
    settings : {"default", "tight"}
        The solver that cvxpy chooses, with its settings there; or Clarabel with those of `SETTINGS`. Both
        start cold. cvxpy compiles the program once for each shape; from then on it only fills in numbers.
    """

    settings: Literal["default", "tight"] = "default"

    def __post_init__(self) -> None:
        try:
            import cvxpy  # noqa: F401 - here, to say so before any work
        except ModuleNotFoundError as error:
            raise MissingDependency("cvxpy is not installed: pip install tensionlab brings it") from error

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> CompiledPrograms:
        """Fill the numbers into the program of this shape."""
        n, m = structure.shape
        board = compiled_programs(n, m, threading.get_ident())
        board.W.value, board.w.value, board.held.value = structure, wrench, np.zeros(n)
        board.lower.value, board.upper.value, board.reference.value = lower, upper, np.zeros(m)
        board.t.value = None
        return board

    def run(self, program: CompiledPrograms) -> Reply:
        """Solve it."""
        from cvxpy.error import SolverError

        closest, options = program.closest, {}
        if self.settings == "tight":
            options = {"solver": "CLARABEL", **SETTINGS["CLARABEL"]}
        try:
            closest.solve(warm_start=False, **options)
        except (SolverError, ValueError) as error:
            return Reply(None, failure=f"{type(error).__name__}: {error}")
        tensions, stats = finite_tensions(program.t.value, program.t.size), closest.solver_stats
        return Reply(
            tensions,
            iterations=stats.num_iters or 0,
            setup_s=stats.setup_time or float("nan"),
            solve_s=stats.solve_time or float("nan"),
            failure="" if tensions is not None else f"gave no tensions ({closest.status})",
        )
