"""The exact solver as a program of JAX next to the compiled kernels: ``python -m benchmarks.jax_batch [COUNT]``.

COUNT problems of each size are solved by JAX on its default device and by `tensionlab.allocate`, in turn, and the
answers compared. COUNT is 10^5 if left out; 10^7 fill a large accelerator. ``--sets`` compares the answers on
COUNT problems of each set of the benchmark instead, under every policy.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import jax
import numpy as np

from benchmarks.solver_speed import LOWER, SHAPES, UPPER, infeasible_wrenches, random_problems
from tensionlab.allocation import Allocation, allocate
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, problem_of, problem_set
from tensionlab.jax import ProvedTensions, solve
from tensionlab.solvers.base import POLICIES
from tensionlab.support.formatting import format_duration, format_number
from tensionlab.support.table import Column, Table

ROUNDS = 3
GAP = Column("gap max", format=format_number)
UNPROVED = Column("unproved", format="d")


def compare(found: ProvedTensions, expected: Allocation) -> tuple[float, int]:
    """Return the largest difference of tensions, as a share of the largest tension, and how many have no proof."""
    size = np.maximum(np.abs(expected.tensions).max(axis=-1, keepdims=True), 1.0)
    gap = np.abs(np.asarray(found.tensions) - expected.tensions) / size
    return float(gap.max()), int(np.sum(~np.asarray(found.optimal)))


def time_sizes(count: int) -> Table:
    """Return the seconds of a problem in a batch of each size, compiled beforehand."""
    rows: list[list[Any]] = []
    for n, m in SHAPES:
        structure, feasible = random_problems(n, m, count, seed=0)
        for name, wrench in (("feasible", feasible), ("infeasible", infeasible_wrenches(structure, feasible, 0))):
            matrices, wrenches = jax.device_put(structure), jax.device_put(wrench)
            jax.block_until_ready(solve(matrices, wrenches, (LOWER, UPPER)))
            spent = []
            for _ in range(ROUNDS):
                began = time.perf_counter()
                found = jax.block_until_ready(solve(matrices, wrenches, (LOWER, UPPER)))
                between = time.perf_counter()
                expected = allocate(structure, wrench, (LOWER, UPPER))
                spent.append((between - began, time.perf_counter() - between))
            jax_s, native_s = np.min(spent, axis=0) / count
            rows.append([n, m, name, jax_s, native_s, *compare(found, expected)])
    times = (Column(name, format=format_duration) for name in ("JAX", "allocate"))
    return Table(["n", "m", "wrenches", *times, GAP, UNPROVED], rows)


def compare_sets(count: int) -> Table:
    """Return how far the answers differ on the problems of every set, by policy."""
    rows: list[list[Any]] = []
    for name in PROBLEM_SETS:
        for policy in POLICIES:
            found = []
            for problem in (problem_of(group, policy) for group in problem_set(name, count).groups):
                given = problem.structure, problem.wrench, (problem.lower, problem.upper)
                found.append(compare(solve(*given, policy=policy), allocate(*given, policy=policy)))
            rows.append([name, policy, max(gap for gap, _ in found), sum(number for _, number in found)])
    return Table(["set", "policy", GAP, UNPROVED], rows)


def main() -> None:
    """Print the table that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("count", type=int, nargs="?", default=100_000, help="problems (default: 100,000)")
    parser.add_argument("--sets", action="store_true", help="compare on the sets of the benchmark")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print(f"JAX {jax.__version__} on {jax.devices()[0].device_kind}")
    print(compare_sets(options.count) if options.sets else time_sizes(options.count))


if __name__ == "__main__":
    main()
