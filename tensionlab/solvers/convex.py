"""Tension allocation written down in cvxpy: the readable reference for all three policies."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from tensionlab.errors import UnknownSolver, optional_import
from tensionlab.solvers.base import Answer, Policy, Problem
from tensionlab.solvers.programs import NO_TENSIONS, ScaledProblem, choose_each, finite_tensions
from tensionlab.support.arrays import Floats
from tensionlab.support.operating_system import holding_interrupts

SETTINGS: dict[str, dict[str, Any]] = {
    "CLARABEL": {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12},
}  # solvers of cvxpy that can be chosen, with settings that pass `TOLERANCE`


@dataclass(frozen=True)
class ConvexProgram:
    """Tensions closest to the reference by convex programs, stated as a textbook would.

    The programs are in `CompiledPrograms`; what they minimise, and what the policies do, is as in
    `tensionlab.solvers.QuadraticProgram`.

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
    policies: ClassVar[tuple[Policy, ...]] = ("force", "tension", "direction")

    def __post_init__(self) -> None:
        if self.backend not in SETTINGS:
            raise UnknownSolver(f"cvxpy backend {self.backend!r} is unknown: choose {', '.join(SETTINGS)}")

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch, one after another."""
        require_cvxpy()

        def start(scaled: ScaledProblem) -> _ConvexPrograms:
            compiled = compiled_programs(*scaled.structure.shape, threading.get_ident())
            compiled.W.value, compiled.fixed_wrench.value = scaled.structure, scaled.fixed_wrench
            compiled.lower.value, compiled.upper.value = scaled.lower, scaled.upper
            compiled.reference.value = scaled.reference
            return _ConvexPrograms(compiled, self.backend, scaled)

        return choose_each(problem, self.backend, start, (ValueError, RuntimeError))


def require_cvxpy() -> None:
    """Raise MissingDependency if cvxpy is not installed."""
    with optional_import("reference", "solver cvxpy"), holding_interrupts():
        import cvxpy  # noqa: F401


class CompiledPrograms:
    """The programs for n wrench components and m cables; W, w, ... are parameters, t and s are found.

    ``fixed_wrench`` is the wrench of cables whose limits are equal. The root of the policy's metric is multiplied
    into ``root_W`` and ``root_w``, because a product of two parameters cannot be compiled once.
    """

    def __init__(self, n: int, m: int) -> None:
        import cvxpy

        cp: Any = cvxpy
        self.W, self.w, self.fixed_wrench = cp.Parameter((n, m)), cp.Parameter(n), cp.Parameter(n)
        self.root_W, self.root_w = cp.Parameter((n, m)), cp.Parameter(n)
        self.lower, self.upper, self.reference = cp.Parameter(m), cp.Parameter(m), cp.Parameter(m)
        W, t, s = self.W, cp.Variable(m), cp.Variable()
        self.t, self.s = t, s
        limits = [self.lower <= t, t <= self.upper]

        least_change = cp.Minimize(cp.sum_squares(t - self.reference))
        self.closest = cp.Problem(least_change, [W @ t == self.w, *limits])
        self.least_error = cp.Problem(cp.Minimize(cp.sum_squares(self.root_W @ t - self.root_w)), limits)
        rendered = W @ t + self.fixed_wrench == s * self.w
        self.longest = cp.Problem(cp.Maximize(s), [rendered, s >= 0, s <= 1, *limits])


@lru_cache(maxsize=32)
def compiled_programs(n: int, m: int, thread: int) -> CompiledPrograms:
    """Return the compiled programs of this shape; a set for each thread, which writes its parameters there."""
    return CompiledPrograms(n, m)


@dataclass
class _ConvexPrograms:
    """Compiled programs with the numbers of one problem."""

    compiled: CompiledPrograms
    backend: str
    scaled: ScaledProblem
    iterations: int = 0
    reason: str = NO_TENSIONS

    def closest(self, wrench: Floats) -> Floats | None:
        self.compiled.w.value = wrench
        return self._solve(self.compiled.closest)

    def least_error(self, root: Floats, wrench: Floats) -> Floats | None:
        self.compiled.root_W.value = root @ self.scaled.structure
        self.compiled.root_w.value = root @ wrench
        return self._solve(self.compiled.least_error)

    def longest(self) -> tuple[Floats | None, float]:
        self.compiled.w.value = self.scaled.wrench
        best = self._solve(self.compiled.longest)
        return (None, 0.0) if best is None else (best, float(self.compiled.s.value))

    def _solve(self, program: Any) -> Floats | None:
        from cvxpy.error import SolverError

        variable = self.compiled.t
        # Parallel cables can stop the backend short of the last digits; its own settings then still find some.
        for settings in (SETTINGS[self.backend], {}):
            variable.value = None
            try:
                # Cold, so that an answer does not depend on the problem before it.
                program.solve(solver=self.backend, warm_start=False, **settings)
            except SolverError as error:
                self.reason = f"{type(error).__name__}: {error}"
                continue
            self.iterations += program.solver_stats.num_iters or 0
            break
        tensions = finite_tensions(variable.value, variable.size)
        return None if tensions is None else np.clip(tensions, self.scaled.lower, self.scaled.upper)
