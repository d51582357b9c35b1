"""Entries of the benchmark: solvers through the interface, and baselines on the plain program."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np

from tensionlab.allocation import Allocator
from tensionlab.benchmark.baselines import BASELINES, TIGHT, Baseline, make_baseline
from tensionlab.benchmark.problem_sets import Reachable
from tensionlab.benchmark.results import KEY
from tensionlab.benchmark.speed import seconds
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers import SOLVERS, every_solver, make, name_solvers
from tensionlab.solvers.base import POLICIES, Answer, Policy, Problem, Solver, refusal
from tensionlab.solvers.least_squares import Newton
from tensionlab.support.arrays import Floats
from tensionlab.verification import require_answer

Setting = Literal["proved", "default", "tight"]
LEAST_SQUARES = Newton.objective  # the objective of all problem sets
WRAPPERS = ("qp", "cvxpy")  # families of built-in solvers that wrap baselines
POLICY_WRAPPERS = ("qp:clarabel", "qp:daqp", "cvxpy")  # run by default where wrenches may be infeasible


@dataclass(frozen=True)
class Entry:
    """A solver with a setting.

    A solver is "proved": the instance runs through the interface, its answers verified. A baseline, which has no
    instance, has its defaults, or is as accurate ("tight") as its options make it.
    """

    solver: str  # one of `BASELINES`, or as in `tensionlab.solvers.select_solvers`
    setting: Setting
    policy: Policy | None
    objective: str
    missing: str = ""  # why it cannot take part
    instance: Solver | None = field(default=None, compare=False, repr=False)

    def key(self, problem_set: str) -> dict[str, str]:
        """Return what identifies its results on a problem set."""
        return dict(zip(KEY, (problem_set, self.solver, self.setting, self.policy or ""), strict=True))

    @property
    def compared_policy(self) -> Policy:
        """Policy that its answers to infeasible wrenches are compared with."""
        return self.policy or POLICIES[0]


def entries(reachable: Reachable, solvers: Sequence[str | Solver] | None = None) -> list[Entry]:
    """Return the entries of a problem set: of the solvers and baselines given, by name or as instances, or of all.

    Where every wrench is feasible a solver runs once, with the policy that is its own; elsewhere it runs with each
    policy that it supports. Baselines run at their defaults and, if they have such options, tight. A built-in
    family by its bare name is its default variant.
    """
    installed = every_solver()
    if solvers is None:
        wrappers = () if reachable == "all" else POLICY_WRAPPERS
        names = [name for name in installed if name.partition(":")[0] not in WRAPPERS or name in wrappers]
        solvers = [*names, *BASELINES]
    all_entries: list[Entry] = []
    for name, instance in name_solvers(solvers).items():
        if name in BASELINES:
            backend, missing = name.removeprefix("qpsolvers:"), ""
            try:
                make_baseline(name)
            except MissingDependency:
                missing = "not installed"
            all_entries.append(Entry(name, "default", None, LEAST_SQUARES, missing))
            if backend == name or backend in TIGHT:
                all_entries.append(Entry(name, "tight", None, LEAST_SQUARES, missing))
            continue
        try:
            solver = guarded(instance or make(name))
        except UnknownSolver as error:
            others = f"`tensionlab solvers` lists solvers, and baselines are {', '.join(BASELINES)}"
            raise UnknownSolver(f"{str(error).partition(';')[0]}; {others}") from None
        missing = "" if installed.get(name, True) else "not installed"
        policies = solver.policies[: 1 if reachable == "all" else len(POLICIES)] or (None,)
        all_entries += [Entry(name, "proved", policy, solver.objective, missing, solver) for policy in policies]
    return all_entries


class CallTimes(NamedTuple):
    """Wall time of a call, its part that builds a baseline's program, and what the baseline's clock says, in s."""

    call_s: float
    build_s: float = np.nan
    own_s: float = np.nan


@dataclass
class _Interface:
    """Driver of a solver: one `Allocator` for each set of limits, prepared as for a control loop."""

    solver: Solver
    policy: Policy | None
    prepared: dict[tuple[int, bytes, bytes], Allocator] = field(default_factory=dict)

    def answers(self, problem: Problem) -> Answer:
        """Return raw answers to a block of problems, nothing clipped; raises ValueError to refuse the shape."""
        problem = replace(problem, policy=self.policy)
        return require_answer(problem, self.solver.solve(problem))

    def call(self, problem: Problem, row: int) -> CallTimes:
        """Time one call for one problem of a block."""
        structure, wrench, lower, upper = _one(problem, row)
        key = (len(wrench), lower.tobytes(), upper.tobytes())
        if key not in self.prepared:
            self.prepared[key] = Allocator((lower, upper), self.solver, policy=self.policy)
            self.prepared[key](structure, wrench)
        return CallTimes(seconds(self.prepared[key], structure, wrench))


@dataclass
class _Baseline:
    """Driver of a baseline on the plain program."""

    solver: Baseline

    def answers(self, problem: Problem) -> Answer:
        answer = Answer(np.full(problem.lower.shape, np.nan), np.zeros(len(problem), dtype=np.int64))
        for row in range(len(problem)):
            program = self.solver.build(*_one(problem, row))
            result = self.solver.run(program)
            if isinstance(result, Exception):
                answer.failures[row] = f"{type(result).__name__}: {result}"
                continue
            reply = self.solver.read(program, result)
            answer.iterations[row] = reply.iterations
            if reply.tensions is None:
                answer.failures[row] = reply.failure
            else:
                answer.tensions[row] = reply.tensions
        return answer

    def call(self, problem: Problem, row: int) -> CallTimes:
        arrays = _one(problem, row)
        began = time.perf_counter()
        program = self.solver.build(*arrays)
        built = time.perf_counter()
        result = self.solver.run(program)
        call_s = time.perf_counter() - began
        own_s = np.nan if isinstance(result, Exception) else self.solver.read(program, result).own_s
        return CallTimes(call_s, built - began, own_s)


def _one(problem: Problem, row: int) -> list[Floats]:
    """Copy structure, wrench and limits of one problem, as some backends refuse read-only arrays."""
    return [np.array(array[row]) for array in problem.arrays[:4]]


Driver = _Interface | _Baseline


def driver(entry: Entry) -> Driver:
    """Return the driver of an entry."""
    if entry.instance is not None:
        return _Interface(entry.instance, entry.policy)
    return _Baseline(make_baseline(entry.solver, "tight" if entry.setting == "tight" else "default"))


def guarded(solver: Solver) -> Solver:
    """Return the solver; unless it comes with tensionlab, its exceptions are failures of the problems."""
    if type(solver) in SOLVERS.values():
        return solver
    return cast(Solver, GuardedSolver(solver, solver.objective, solver.policies))


@dataclass(frozen=True)
class GuardedSolver:
    """Solver whose exceptions and invalid answers are failures of the problems that cause them."""

    solver: Solver
    objective: str
    policies: tuple[Policy, ...]

    def refuses(self, n: int, m: int) -> str | None:
        """Return why the solver does not support this size."""
        return refusal(self.solver, n, m)

    def solve(self, problem: Problem) -> Answer:
        """Solve the batch; where that breaks, one problem at a time."""
        try:
            return require_answer(problem, self.solver.solve(problem))
        except MissingDependency:
            raise
        except Exception as error:  # the code of others may raise anything
            if len(problem) <= 1:
                nothing = np.full(problem.lower.shape, np.nan)
                reason = f"{type(error).__name__}: {error}{self._place(error)}"
                failures = dict.fromkeys(range(len(problem)), reason)
                return Answer(nothing, np.zeros(len(problem), dtype=np.int64), failures=failures)
        parts = [self.solve(problem.take(np.array([row]))) for row in range(len(problem))]
        directions = [part.separation for part in parts if part.separation is not None]
        return Answer(
            tensions=np.concatenate([part.tensions for part in parts]),
            iterations=np.concatenate([part.iterations for part in parts]),
            separation=np.concatenate(directions) if len(directions) == len(parts) else None,
            failures={row: reason for row, part in enumerate(parts) for reason in part.failures.values()},
        )

    def _place(self, error: Exception) -> str:
        """Return the last line of the solver's own file that ran, in brackets; nothing where none did."""
        own = getattr(sys.modules.get(type(self.solver).__module__), "__file__", None)
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == own]
        return f" ({Path(own).name}:{lines[-1]})" if own and lines else ""
