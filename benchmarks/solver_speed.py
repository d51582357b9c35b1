"""Speed of the exact solver next to DAQP, in batches and single calls: ``python -m benchmarks.solver_speed``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import daqp
import numpy as np
import qpsolvers

from tensionlab.allocation import Allocator, allocate
from tensionlab.benchmark.rigs import structures
from tensionlab.benchmark.speed import (
    describe_kernels,
    quantile,
    seconds,
    take_turns,
    using_threads,
    without_collector,
)
from tensionlab.solvers import SOLVERS, as_fused_solver, make
from tensionlab.solvers.base import Status, refusal
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_duration, format_number
from tensionlab.support.table import Column, Table

LOWER, UPPER = 0.5, 6.0  # tension limits of all problems, in N
SHAPES = ((3, 4), (3, 8), (3, 12), (6, 8))  # components and cables of the batches
CALL_SHAPES = ((3, 8), (6, 8))  # components and cables of the single calls
DAQP_CALLS = 1000  # problems that DAQP solves in each round
DAQP_EQUALITY = 5  # DAQP's mark of a constraint that is an equality
BLOCK = 20  # single calls in a row before the next caller's turn
PASSES = 3  # times that each caller gets each single problem


def random_problems(components: int, cables: int, count: int, seed: int) -> tuple[Floats, Floats]:
    """Return random structure matrices (count, n, m) of unit cables, and feasible wrenches (count, n)."""
    rng = np.random.default_rng(seed)
    structure = structures(rng, components, cables, count)
    tensions = rng.uniform(LOWER, UPPER, size=(count, cables))
    return structure, np.einsum("bnm,bm->bn", structure, tensions)


def infeasible_wrenches(structure: Floats, wrench: Floats, seed: int) -> Floats:
    """Return wrenches in the same directions that are 1 % to 100 % larger than any tensions can render."""
    far = 1e3 * wrench
    scale = allocate(structure, far, (LOWER, UPPER), policy="direction").scale
    share = 1.0 + 10.0 ** np.random.default_rng(seed).uniform(-2.0, 0.0, len(wrench))
    return np.asarray((np.nan_to_num(scale, nan=1e-2) * share)[:, None] * far)


def daqp_solver(structure: Floats, wrench: Floats) -> Callable[[int], Any]:
    """Return a function that solves the problem of a row with DAQP, all stacking done beforehand."""
    count, n, m = structure.shape
    cost, linear = np.eye(m), np.zeros(m)
    sense = np.array([0] * m + [DAQP_EQUALITY] * n, dtype=np.int32)
    above = np.hstack([np.full((count, m), UPPER), wrench])
    below = np.hstack([np.full((count, m), LOWER), wrench])
    return lambda row: daqp.solve(cost, linear, structure[row], above[row], below[row], sense)


def time_batches(
    components: int, cables: int, feasible: bool, count: int = 100_000, rounds: int = 7
) -> dict[str, float]:
    """Return the seconds of a problem in one `allocate` call, on one core and on all, and by DAQP.

    DAQP's are those of its own clock ("c"), the median of `DAQP_CALLS` problems a round, and of a Python loop. All
    are timed in turn, and the best round of each counts: a busy machine takes more from a long batch than from a
    short call. "gap" is the largest difference of the tensions, in N; NaN where wrenches are infeasible.
    """
    structure, wrench = random_problems(components, cables, count, seed=0)
    if not feasible:
        wrench = infeasible_wrenches(structure, wrench, seed=0)
    solve, gap = daqp_solver(structure, wrench), 0.0 if feasible else np.nan
    spent: dict[str, list[float]] = {"one": [], "all": [], "c": [], "loop": []}
    for turn in range(rounds):
        for name, threads in (("one", 1), ("all", os.cpu_count() or 1)):
            with using_threads(threads):
                began = time.perf_counter()
                found = allocate(structure, wrench, (LOWER, UPPER))
                spent[name].append((time.perf_counter() - began) / count)
        assert (found.status == (Status.EXACT if feasible else Status.NEAREST)).all()
        rows = np.arange(turn * DAQP_CALLS, (turn + 1) * DAQP_CALLS) % count
        began = time.perf_counter()
        answers = [solve(row) for row in rows.tolist()]
        spent["loop"].append((time.perf_counter() - began) / len(rows))
        spent["c"].append(
            quantile(np.array([info["setup_time"] + info["solve_time"] for *_, info in answers]), 0.5)
        )
        if feasible:
            gap = max(gap, float(np.abs([answer[0] for answer in answers] - found.tensions[rows]).max()))
    return {name: min(values) for name, values in spent.items()} | {"gap": gap}


def time_calls(components: int, cables: int, calls: int = 5000) -> dict[str, Floats]:
    """Return the seconds (PASSES, calls) of single calls by caller, in turns of `BLOCK` in a random order."""
    structure, wrench = random_problems(components, cables, calls, seed=0)
    lower, upper = np.full(cables, LOWER), np.full(cables, UPPER)
    prepared = Allocator((lower, upper))

    def front_page(row: int) -> Any:
        """Call qpsolvers as its front page shows."""
        cost, linear = np.eye(cables), np.zeros(cables)
        matrix, right = structure[row], wrench[row]
        return qpsolvers.solve_qp(cost, linear, A=matrix, b=right, lb=lower, ub=upper, solver="daqp")

    callers: dict[str, Callable[[int], Any]] = {
        "tl.Allocator": lambda row: prepared(structure[row], wrench[row]),
        "tl.allocate": lambda row: allocate(structure[row], wrench[row], (lower, upper)),
        "daqp.solve, matrices prebuilt": daqp_solver(structure, wrench),
        'qpsolvers.solve_qp(solver="daqp")': front_page,
    }
    for name in SOLVERS:
        solver = make(name)
        if as_fused_solver(solver) and not refusal(solver, components, cables) and name != "newton":
            allocator = Allocator((lower, upper), solver)
            callers[f'tl.Allocator(solver="{name}")'] = partial(
                lambda call, row: call(structure[row], wrench[row]), allocator
            )
    rng = np.random.default_rng(0)
    spent = {name: np.empty((PASSES, calls)) for name in callers}
    blocks = [range(first, min(first + BLOCK, calls)) for first in range(0, calls, BLOCK)]
    timed = {name: partial(seconds, call) for name, call in callers.items()}
    with without_collector():
        for number in range(PASSES):
            for name, row, spent_s in take_turns(((block, timed) for block in blocks), rng):
                spent[name][number, row] = spent_s
    return spent


def main() -> None:
    """Print the tables of batches and of single calls."""
    print(describe_kernels())
    times = ("one core", "all cores", "DAQP in C", "loop over DAQP")
    batches = Table(
        ["n", "m", "wrenches", *(Column(name, format=format_duration) for name in times),
         Column("one core / DAQP in C", format=".3f"), Column("gap max", "N", format_number)],
        ([n, m, "feasible" if feasible else "infeasible", row["one"], row["all"], row["c"], row["loop"],
          row["one"] / row["c"], row["gap"]]
         for n, m in SHAPES for feasible in (True, False) for row in [time_batches(n, m, feasible)]),
    )  # fmt: skip
    calls = Table(
        ["n", "m", "caller", Column("median", format=format_duration), Column("p99.9", format=format_duration),
         Column("uninterrupted p99.9", format=format_duration)],
        ([n, m, name, quantile(spent, 0.5), quantile(spent, 0.999), quantile(spent.min(axis=0), 0.999)]
         for n, m in CALL_SHAPES for name, spent in time_calls(n, m).items()),
    )  # fmt: skip
    print(f"Time of a problem in a batch:\n{batches}\n\nTime of one call:\n{calls}")


if __name__ == "__main__":
    main()
