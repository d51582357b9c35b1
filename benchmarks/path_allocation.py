"""Allocation along a path next to Clarabel and OSQP: ``python -m benchmarks.path_allocation``.

Clarabel at its own tolerance of 1e-8, OSQP at 1e-5.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import clarabel
import numpy as np
import osqp
import scipy.sparse as sp

from tensionlab.benchmark.speed import describe_kernels, quantile, seconds, without_collector
from tensionlab.path_allocation import PathAllocation, allocate_path
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_duration, format_number
from tensionlab.support.table import Column, Table

LOWER, UPPER = 0.5, 6.0  # tension limits, in N
DT = 0.01  # time between samples, in s
SHAPES = ((3, 4), (3, 8), (6, 8))  # components and cables
PATHS = 10  # of each shape
SAMPLES = 1000
ROUNDS = 3  # of which the shortest time counts


class PathProblem(NamedTuple):
    """Structure matrices (K, n, m), wrenches (K, n), largest change from sample to sample in N, reference (m,)."""

    structure: Floats
    wrench: Floats
    change: float
    reference: Floats

    def allocate(self) -> PathAllocation:
        """Return our answer."""
        structure, wrench, change, reference = self
        return allocate_path(structure, wrench, (LOWER, UPPER), change / DT, DT, reference)

    def until(self, count: int) -> PathProblem:
        """Return the first samples."""
        return self._replace(structure=self.structure[:count], wrench=self.wrench[:count])

    def program(self) -> tuple[sp.csc_matrix, Floats, Floats, Floats]:
        """Return the rows of the quadratic program, their lower and upper bounds, and its linear cost."""
        count, _, m = self.structure.shape
        own = sp.eye(count * m, format="csr")
        rows = sp.vstack([sp.block_diag(list(self.structure)), own, own[m:] - own[:-m]]).tocsc()
        equal, size, changes = self.wrench.ravel(), np.ones(count * m), np.full((count - 1) * m, self.change)
        below = np.concatenate([equal, LOWER * size, -changes])
        return rows, below, np.concatenate([equal, UPPER * size, changes]), -np.tile(self.reference, count)


def random_path(components: int, cables: int, count: int, share: float, seed: int) -> PathProblem:
    """Return a path that random tensions render, with a share of their largest change as the limit."""
    rng = np.random.default_rng(seed)
    ends, way = rng.normal(size=(2, components, cables)), np.linspace(0.0, 1.0, count)[:, None, None]
    structure = ends[0] + way * (ends[1] - ends[0])
    structure /= np.linalg.norm(structure, axis=1, keepdims=True)
    tensions = np.clip(3.0 + np.cumsum(0.3 * rng.normal(size=(count, cables)), axis=0), LOWER, UPPER)
    change = share * float(abs(np.diff(tensions, axis=0)).max())
    wrench = np.einsum("knm,km->kn", structure, tensions)
    return PathProblem(structure, wrench, change, rng.uniform(LOWER, UPPER, cables) * rng.integers(2))


def by_clarabel(problem: PathProblem, tolerance: float = 1e-8) -> Floats | None:
    """Return the optimum (K, m) as Clarabel finds it; None if there is none."""
    rows, below, above, linear = problem.program()
    equal = problem.wrench.size
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_iter = False, 200
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    stacked = sp.vstack([rows, -rows[equal:]]).tocsc()
    cones = [clarabel.ZeroConeT(equal), clarabel.NonnegativeConeT(stacked.shape[0] - equal)]
    bounds = np.concatenate([above, -below[equal:]])
    cost = sp.eye(len(linear), format="csc")
    solution = clarabel.DefaultSolver(cost, linear, stacked, bounds, cones, settings).solve()
    if "Infeasible" in str(solution.status):
        return None
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise ArithmeticError(f"Clarabel ended with {solution.status}")
    return np.array(solution.x).reshape(len(problem.wrench), -1)


def refine(problem: PathProblem, tensions: Floats) -> Floats:
    """Return the optimum (K, m) whose active bounds are those of nearly optimal tensions."""
    rows, below, above, linear = problem.program()
    values, equal = rows @ tensions.ravel(), np.arange(rows.shape[0]) < problem.wrench.size
    for within in (1e-7, 1e-6, 1e-5, 1e-8):
        at_most = above - values < within
        active = equal | at_most | (values - below < within)
        matrix = rows[active].toarray()
        missing = np.where(at_most, above, below)[active] + matrix @ linear
        found = -linear + matrix.T @ np.linalg.lstsq(matrix @ matrix.T, missing, rcond=1e-13)[0]
        if ((rows @ found <= above + 1e-9) & (rows @ found >= below - 1e-9)).all():
            return np.asarray(found.reshape(tensions.shape))
    raise ArithmeticError("no set of active bounds leaves the others unviolated")


def by_osqp(problem: PathProblem) -> Floats | None:
    """Return the tensions (K, m) as OSQP finds them; None if it stops early."""
    rows, below, above, linear = problem.program()
    solver = osqp.OSQP()
    cost = sp.eye(len(linear), format="csc")
    solver.setup(cost, linear, rows, below, above, verbose=False, eps_abs=1e-5, eps_rel=1e-5, max_iter=20_000)
    found = solver.solve(raise_error=False)
    return np.array(found.x).reshape(len(problem.wrench), -1) if found.info.status == "solved" else None


def main() -> None:
    """Print the median time of a path, and the largest difference from Clarabel's tensions, for each shape."""
    rows = []
    callers: dict[str, Callable[[PathProblem], object]] = {
        "tensionlab": PathProblem.allocate,
        "Clarabel": by_clarabel,
        "OSQP": by_osqp,
    }
    for components, cables in SHAPES:
        times, apart, certified, solved = np.empty((len(callers), PATHS)), np.empty(PATHS), np.empty(PATHS), 0
        for path in range(PATHS):
            problem = random_path(components, cables, SAMPLES, 1.0, path)
            found, best = problem.allocate(), by_clarabel(problem)
            assert best is not None
            apart[path], certified[path] = abs(found.tensions - best).max(), found.distance
            solved += by_osqp(problem) is not None
            with without_collector():
                spent = [[seconds(call, problem) for call in callers.values()] for _ in range(ROUNDS)]
            times[:, path] = np.min(spent, axis=0)
        medians = [quantile(each, 0.5) for each in times]
        rows.append([f"{components} x {cables}", *medians, solved, apart.max(), certified.max()])
    columns = ["shape", *(Column(name, format=format_duration) for name in callers), "solved by OSQP",
               Column("from Clarabel", "N", format_number), Column("certified", "N", format_number)]  # fmt: skip
    print(Table(columns, rows, f"{PATHS} paths of {SAMPLES} samples, {describe_kernels()}"))


if __name__ == "__main__":
    main()
