"""Entries of the benchmark: solvers through the interface, and baselines on the plain program."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocator
from tensionlab.errors import MissingDependency, UnknownSolver, optional_import
from tensionlab.solvers import every_solver, make, name_solvers
from tensionlab.solvers.base import POLICIES, Answer, Policy, Problem, Solver
from tensionlab.solvers.convex import PlainConvex
from tensionlab.solvers.least_squares import Newton
from tensionlab.solvers.programs import Baseline, Reply, finite_tensions
from tensionlab.solvers.quadratic import BACKENDS, TIGHT, PlainProgram
from tensionlab.support.arrays import Floats
from tensionlab.verification import require_answer

Setting = Literal["proved", "default", "tight"]
LEAST_SQUARES = Newton.objective  # the objective of all problem sets
# The baselines by name: DAQP called directly, each backend through qpsolvers, and cvxpy.
BASELINES = ("daqp", *(f"qpsolvers:{backend}" for backend in BACKENDS), "cvxpy:plain")
# Families of built-in solvers that wrap baselines. By default they run where their policy is needed.
WRAPPERS = ("qp", "cvxpy")
# Wrappers that run by default where wrenches may be infeasible.
POLICY_WRAPPERS = ("qp:clarabel", "qp:daqp", "cvxpy")
DAQP_EQUALITY = 5  # how DAQP marks a constraint that is an equality
NAN = float("nan")


@dataclass(frozen=True)
class Entry:
    """A solver with a setting.

    The name is one of `BASELINES`, or as in `tensionlab.solvers.select_solvers`. A solver is "proved": the
    instance runs through the interface, its answers verified. A baseline, which has no instance, has its defaults,
    or is as accurate ("tight") as its options make it. ``missing`` says why an entry cannot take part.
    """

    solver: str
    setting: Setting
    policy: Policy | None
    objective: str
    missing: str = ""
    instance: Solver | None = field(default=None, compare=False, repr=False)

    @property
    def comparable(self) -> bool:
        """Whether it has the objective of the problem sets, so that it should find the optimum."""
        return self.objective == LEAST_SQUARES

    @property
    def compared_policy(self) -> Policy:
        """Policy that its answers to infeasible wrenches are compared with."""
        return self.policy or POLICIES[0]


def entries(
    reachable: Literal["all", "none", "mixed"], solvers: Sequence[str | Solver] | None = None
) -> list[Entry]:
    """Return the entries of a problem set: of the solvers and baselines given, by name or as instances, or of all.

    Where every wrench is feasible a solver runs once, with the policy that is its own; elsewhere it runs with each
    policy that it honours. Baselines run at their defaults and, if they have such options, tight. A built-in
    family by its bare name is its default variant.
    """
    installed = every_solver()
    if solvers is None:
        wrappers = () if reachable == "all" else POLICY_WRAPPERS
        names = [name for name in installed if name.partition(":")[0] not in WRAPPERS or name in wrappers]
        solvers = [*names, *BASELINES]
    found: list[Entry] = []
    for name, instance in name_solvers(solvers).items():
        if name in BASELINES:
            found += _baseline_entries(name)
            continue
        try:
            solver = instance or make(name)
        except UnknownSolver as error:
            unknown = str(error).partition(";")[0]
            raise UnknownSolver(
                f"{unknown}; `tensionlab solvers` lists solvers, and baselines are {', '.join(BASELINES)}"
            ) from None
        missing = "" if installed.get(name, True) else "not installed"
        policies = solver.policies[: 1 if reachable == "all" else len(POLICIES)] or (None,)
        found += [Entry(name, "proved", policy, solver.objective, missing, solver) for policy in policies]
    return found


def _baseline_entries(name: str) -> list[Entry]:
    """Return one baseline at its defaults, and tight if it has such options."""
    settings: list[Setting] = ["default", "tight"]
    if name.startswith("qpsolvers:") and name.partition(":")[2] not in TIGHT:
        settings = ["default"]
    missing = ""
    try:
        _baseline(name, "default")
    except MissingDependency:
        missing = "not installed"
    return [Entry(name, setting, None, LEAST_SQUARES, missing) for setting in settings]


def _baseline(name: str, setting: Literal["default", "tight"]) -> Baseline:
    if name == "daqp":
        return DirectDaqp(setting)
    if name == "cvxpy:plain":
        return PlainConvex(setting)
    return PlainProgram(name.partition(":")[2], setting)


class CallTimes(NamedTuple):
    """Times of one call, in s: wall time, the part of it that builds a baseline's program, and by its clock."""

    call: float
    build: float = NAN
    setup: float = NAN
    solve: float = NAN


class Driver(Protocol):
    """Interface through which the benchmark runs one entry."""

    def answers(self, problem: Problem) -> Answer:
        """Return raw answers to a block of problems, nothing clipped; raises ValueError to refuse the shape."""
        ...

    def call(self, problem: Problem, row: int) -> CallTimes:
        """Time one call for one problem of a block."""
        ...


def driver(entry: Entry) -> Driver:
    """Return the driver of an entry."""
    if entry.instance is not None:
        return _Interface(entry.instance, entry.policy)
    return _Baseline(_baseline(entry.solver, "tight" if entry.setting == "tight" else "default"))


@dataclass
class _Interface:
    """Driver of a solver: one `Allocator` for each set of limits, prepared as for a control loop."""

    solver: Solver
    policy: Policy | None
    prepared: dict[tuple[int, bytes, bytes], Allocator] = field(default_factory=dict)

    def answers(self, problem: Problem) -> Answer:
        problem = replace(problem, policy=self.policy)
        return require_answer(problem, self.solver.solve(problem))

    def call(self, problem: Problem, row: int) -> CallTimes:
        structure, wrench = problem.structure[row], problem.wrench[row]
        lower, upper = problem.lower[row], problem.upper[row]
        key = (len(wrench), lower.tobytes(), upper.tobytes())
        allocator = self.prepared.get(key)
        if allocator is None:
            allocator = Allocator((lower, upper), self.solver, policy=self.policy)
            allocator(structure, wrench)
            self.prepared[key] = allocator
        began = time.perf_counter()
        allocator(structure, wrench)
        return CallTimes(time.perf_counter() - began)


@dataclass
class _Baseline:
    """Driver of a baseline on the plain program."""

    solver: Baseline

    def answers(self, problem: Problem) -> Answer:
        tensions = np.full(problem.lower.shape, np.nan)
        iterations = np.zeros(len(problem), dtype=np.int64)
        failures: dict[int, str] = {}
        for row in range(len(problem)):
            program = self.solver.build(*_one(problem, row))
            reply = self.solver.read(program, self.solver.run(program))
            iterations[row] = reply.iterations
            if reply.tensions is None:
                failures[row] = reply.failure
            else:
                tensions[row] = reply.tensions
        return Answer(tensions, iterations, failures=failures)

    def call(self, problem: Problem, row: int) -> CallTimes:
        arrays = _one(problem, row)
        began = time.perf_counter()
        program = self.solver.build(*arrays)
        built = time.perf_counter()
        result = self.solver.run(program)
        ended = time.perf_counter()
        reply = self.solver.read(program, result)
        return CallTimes(ended - began, built - began, reply.setup_s, reply.solve_s)


def _one(problem: Problem, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Copy structure, wrench and limits of one problem, as some backends refuse read-only arrays."""
    arrays = (problem.structure[row], problem.wrench[row], problem.lower[row], problem.upper[row])
    return tuple(np.array(array) for array in arrays)  # type: ignore[return-value]


def load_daqp() -> Any:
    """Return DAQP's own module; MissingDependency if it is not installed."""
    with optional_import("solvers", "entry daqp"):
        import daqp
    return daqp


def daqp_installed() -> bool:
    """Return whether DAQP's module can be imported."""
    return importlib.util.find_spec("daqp") is not None


def constraint_types(components: int, cables: int) -> NDArray[np.int32]:
    """Return DAQP's type of each constraint: first the limits of the cables, then the equations."""
    return np.array([0] * cables + [DAQP_EQUALITY] * components, dtype=np.int32)


@dataclass(frozen=True)
class DirectDaqp:
    """DAQP by its own Python module, the fastest baseline, on least ``|t|²`` with ``W t = w`` and the limits.

    Source: Arnström, Bemporad and Axehill, "A dual active-set solver for embedded quadratic programming using
    recursive LDL' updates", 2022. The settings are its own defaults, or those of
    `tensionlab.solvers.quadratic.TIGHT`.
    """

    settings: Literal["default", "tight"] = "default"
    solve: Any = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "solve", load_daqp().solve)

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Make the cost and stack limits and equations as DAQP takes them, as a script does in each call."""
        n, m = structure.shape
        above, below = np.concatenate([upper, wrench]), np.concatenate([lower, wrench])
        return np.eye(m), np.zeros(m), structure, above, below, constraint_types(n, m)

    def run(self, program: Any) -> Any:
        """Solve a program of `build`."""
        return self.solve(*program, **TIGHT["daqp"]) if self.settings == "tight" else self.solve(*program)

    def read(self, program: Any, result: Any) -> Reply:
        """Read tensions, iterations and times out of DAQP's answer."""
        found, _, flag, info = result
        tensions = finite_tensions(found, len(program[1]))
        return Reply(
            tensions,
            iterations=int(info["iterations"]),
            setup_s=float(info["setup_time"]),
            solve_s=float(info["solve_time"]),
            failure="" if tensions is not None else f"gave no finite tensions (exit flag {flag})",
        )
