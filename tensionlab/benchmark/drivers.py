"""How a contestant is asked: for its raw answers to a block of problems, and for one timed call."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from tensionlab.allocation import Allocator
from tensionlab.benchmark.entries import Contestant
from tensionlab.solvers.base import Answer, Nearest, Problem, Solver
from tensionlab.solvers.peer import Peer

NAN = float("nan")


class Times(NamedTuple):
    """Of one call, in s.

    ``call`` is the wall time from arrays to tensions, ``build`` the part of it that brought the arrays into
    the form that the peer takes, ``setup`` and ``solve`` what its own clock says; NaN where nothing is said.
    """

    call: float
    build: float = NAN
    setup: float = NAN
    solve: float = NAN


class Driver(Protocol):
    """Asks one contestant."""

    def answers(self, problem: Problem) -> Answer:
        """Raw answers to a block of problems, nothing clipped. A ValueError says that it refuses the shape."""
        ...

    def call(self, problem: Problem, row: int) -> Times:
        """Time of one call for one problem of a block."""
        ...


def driver(contestant: Contestant) -> Driver:
    """Who asks this contestant?"""
    made = contestant.make()
    return _Peer(made) if contestant.setting != "proved" else _House(made, contestant.nearest)  # type: ignore[arg-type]


@dataclass
class _House:
    """A solver of the house: one `Allocator` for each set of limits, prepared as for a control loop."""

    solver: Solver
    nearest: Nearest | None
    prepared: dict[tuple[int, bytes, bytes], Allocator] = field(default_factory=dict)

    def answers(self, problem: Problem) -> Answer:
        return self.solver.solve(replace(problem, nearest=self.nearest))

    def call(self, problem: Problem, row: int) -> Times:
        structure, wrench = problem.structure[row], problem.wrench[row]
        lower, upper = problem.lower[row], problem.upper[row]
        key = (len(wrench), lower.tobytes(), upper.tobytes())
        allocator = self.prepared.get(key)
        if allocator is None:
            allocator = Allocator((lower, upper), self.solver, nearest=self.nearest)
            allocator(structure, wrench)
            self.prepared[key] = allocator
        began = time.perf_counter()
        allocator(structure, wrench)
        return Times(time.perf_counter() - began)


@dataclass
class _Peer:
    """A peer on the plain program."""

    peer: Peer

    def answers(self, problem: Problem) -> Answer:
        tensions = np.full(problem.lower.shape, np.nan)
        iterations = np.zeros(len(problem), dtype=np.int64)
        failures: dict[int, str] = {}
        for row in range(len(problem)):
            reply = self.peer.run(self.peer.build(*_one(problem, row)))
            iterations[row] = reply.iterations
            if reply.tensions is None:
                failures[row] = reply.failure
            else:
                tensions[row] = reply.tensions
        return Answer(tensions, iterations, failures=failures)

    def call(self, problem: Problem, row: int) -> Times:
        arrays = _one(problem, row)
        began = time.perf_counter()
        program = self.peer.build(*arrays)
        built = time.perf_counter()
        reply = self.peer.run(program)
        ended = time.perf_counter()
        return Times(ended - began, built - began, reply.setup_s, reply.solve_s)


def _one(problem: Problem, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Structure, wrench and limits of one problem; own arrays, as some backends refuse read-only ones."""
    arrays = (problem.structure[row], problem.wrench[row], problem.lower[row], problem.upper[row])
    return tuple(np.array(array) for array in arrays)  # type: ignore[return-value]
