"""Solvers of others in a comparison: an exception of theirs is a problem that failed, not the end of it."""

from __future__ import annotations

import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from tensionlab.errors import MissingDependency
from tensionlab.solvers import SOLVERS
from tensionlab.solvers.base import Answer, Policy, Problem, Solver
from tensionlab.verification import require_answer


def guarded(solver: Solver) -> Solver:
    """Return the solver, guarded unless it comes with tensionlab."""
    return solver if type(solver) in SOLVERS.values() else cast(Solver, _Guarded(solver, solver.policies))


@dataclass(frozen=True)
class _Guarded:
    """Solver whose exceptions, and answers that are none, are failures of the problems that cause them."""

    solver: Solver
    policies: tuple[Policy, ...]

    @property
    def objective(self) -> str:
        return self.solver.objective

    def solve(self, problem: Problem) -> Answer:
        """Solve the batch; where that breaks, one problem at a time."""
        try:
            return require_answer(problem, self.solver.solve(problem))
        except MissingDependency:
            raise
        except Exception as error:  # the code of others may raise anything
            if len(problem) <= 1:
                return self._failure(problem, error)
        parts = [self.solve(problem.take(np.array([row]))) for row in range(len(problem))]
        directions = [part.separation for part in parts if part.separation is not None]
        return Answer(
            tensions=np.concatenate([part.tensions for part in parts]),
            iterations=np.concatenate([part.iterations for part in parts]),
            separation=np.concatenate(directions) if len(directions) == len(parts) else None,
            failures={row: reason for row, part in enumerate(parts) for reason in part.failures.values()},
        )

    def _failure(self, problem: Problem, error: Exception) -> Answer:
        nothing = np.full(problem.lower.shape, np.nan)
        reasons = dict.fromkeys(range(len(problem)), f"{type(error).__name__}: {error}{self._place(error)}")
        return Answer(nothing, np.zeros(len(problem), dtype=np.int64), failures=reasons)

    def _place(self, error: Exception) -> str:
        """Return the last line of the solver's own file that ran, in brackets; nothing where none did."""
        own = getattr(sys.modules.get(type(self.solver).__module__), "__file__", None)
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == own]
        return f" ({Path(own).name}:{lines[-1]})" if own and lines else ""
