"""Derivatives of the tensions: agreement with central differences, and times compared with the solver's.

`python -m benchmarks.jacobian` compares at random problems of all sizes with 1 to 6 wrench components and 1 to 16
cables, under every policy, and then times the derivatives; exit status 1 if any differ by more than `TOLERANCE`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.solver_speed import infeasible_wrenches, random_problems
from benchmarks.workspace import LOWER, UPPER
from tensionlab.allocation import Allocation, allocate
from tensionlab.benchmark.speed import describe_kernels, using_threads
from tensionlab.gradients import allocation_jacobian
from tensionlab.solvers.base import POLICIES, Policy, Problem, Status
from tensionlab.support.arrays import Floats

TOLERANCE = 1e-7  # largest difference, against the largest entry of an array of derivatives, or 1
SIZES = tuple((n, m) for n in range(1, 7) for m in range(1, 17))  # components and cables of the comparison
SHAPES = ((3, 4), (3, 8), (6, 8), (6, 12))  # components and cables that are timed
# Steps of the central differences, of fourth order, and what the tensions there count.
STENCIL = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))
STEP = 1e-3  # of the differences, where derivatives are small; it becomes shorter as they grow
ARGUMENTS = ("structure", "wrench", "lower", "upper", "reference")


class Problems(Problem):
    """Problems of one size; each has its own limits and reference."""

    def solve(self, **changed: Floats) -> Allocation:
        """Return tensions, with some of `ARGUMENTS` changed: (B, K, ...)."""
        given = {name: changed.get(name, getattr(self, name)[:, None]) for name in ARGUMENTS}
        return allocate(
            given["structure"],
            given["wrench"],
            (given["lower"], given["upper"]),
            reference=given["reference"],
            policy=self.policy,
            wrench_weights=self.weights,
        )

    def held(self, tensions: Floats, **changed: Floats) -> NDArray[np.int64]:
        """Return -1 for each cable at its lower limit, 1 for one at its upper, 0 for free ones."""
        lower, upper = (changed.get(name, getattr(self, name)[:, None]) for name in ("lower", "upper"))
        near = 1e-9 * (upper - lower)
        return np.where(tensions <= lower + near, -1, np.where(tensions >= upper - near, 1, 0))


@dataclass(frozen=True)
class Agreement:
    """Agreement with differences under one policy.

    Attributes
    ----------
    problems, kinks : int
        Kinks have no derivative.
    crossed : int
        Of the others, those that have a kink within the steps of the differences.
    compared, infeasible : int
        The rest, and of them those whose wrench is infeasible.
    largest : float
        Largest difference, as in `TOLERANCE`.
    """

    problems: int = 0
    kinks: int = 0
    crossed: int = 0
    compared: int = 0
    infeasible: int = 0
    largest: float = 0.0

    def __add__(self, other: Agreement) -> Agreement:
        counts = {name: value + getattr(other, name) for name, value in vars(self).items() if name != "largest"}
        return Agreement(**counts, largest=max(self.largest, other.largest))


def draw(n: int, m: int, count: int, policy: Policy, seed: int) -> Problems:
    """Return random problems, about half of them feasible where there are cables enough."""
    rng = np.random.default_rng([seed, n, m, POLICIES.index(policy)])
    structure = rng.normal(size=(count, n, m))
    lower = rng.uniform(0.0, 1.0, (count, m))
    upper = lower + rng.uniform(0.5, 6.0, (count, m))
    wrench = np.einsum("bnm,bm->bn", structure, rng.uniform(lower, upper)) * rng.choice(
        [1.0, 1.5, 3.0], (count, 1)
    )
    elsewhere = rng.normal(size=(count, n)) * rng.uniform(0.5, 8.0, (count, 1))
    wrench = np.where(rng.random((count, 1)) < 0.3, elsewhere, wrench)
    reference = rng.uniform(-2.0, 8.0, (count, m))
    return Problems(structure, wrench, lower, upper, reference, rng.uniform(0.2, 5.0, n), policy)


def compare(problems: Problems, seed: int = 0) -> Agreement:
    """Compare all derivatives with central differences of the tensions."""
    given = {name: getattr(problems, name) for name in ARGUMENTS}
    jacobian = allocation_jacobian(
        problems.structure,
        problems.wrench,
        (problems.lower, problems.upper),
        reference=problems.reference,
        policy=problems.policy,
        wrench_weights=problems.weights,
    )
    found = jacobian.allocation
    count, m = found.tensions.shape
    before = problems.held(found.tensions[:, None])
    length = np.maximum(1.0, np.abs(found.tensions).max(axis=1))
    sensitivity = np.abs(jacobian.structure).max(axis=(1, 2, 3)) / length
    step = STEP / (1.0 + np.abs(jacobian.wrench).max(axis=(1, 2)) + sensitivity)
    same = ~jacobian.kink

    def differences(name: str) -> Floats:
        """Return derivatives of the tensions by one argument, (B, m, entries)."""
        each = np.eye(given[name][0].size).reshape(-1, *given[name].shape[1:])
        total = np.zeros((count, len(each), m))
        for steps, weight in STENCIL:
            lengths = step.reshape(-1, *[1] * each.ndim)
            changed = {name: given[name][:, None] + steps * lengths * each}
            there = problems.solve(**changed)
            after = problems.held(there.tensions, **changed)
            kept = (after == before).all(axis=(1, 2))
            kept &= (there.status == found.status[:, None]).all(axis=1)
            same[:] &= kept & (np.isnan(there.scale) == np.isnan(found.scale)[:, None]).all(axis=1)
            total += weight * polished(problems, found, same, there.tensions, changed)
        return np.moveaxis(total / step[:, None, None], 1, -1)

    cotangent = np.random.default_rng(seed).normal(size=(count, m))
    gradients = jacobian.pull_back(cotangent)
    errors = [_error(jacobian.structure.reshape(count, m, -1), differences("structure"))]
    errors.append(_error(jacobian.wrench, differences("wrench")))
    pulled = np.einsum("bi,binj->bnj", cotangent, jacobian.structure)
    errors.append(_error(gradients.structure, pulled))
    for name in ARGUMENTS[1:]:
        errors.append(_error(getattr(gradients, name), np.einsum("bi,bij->bj", cotangent, differences(name))))
    return Agreement(
        problems=count,
        kinks=int(np.count_nonzero(jacobian.kink)),
        crossed=int(np.count_nonzero(~jacobian.kink & ~same)),
        compared=int(np.count_nonzero(same)),
        infeasible=int(np.count_nonzero(same & (found.status == Status.NEAREST))),
        largest=float(np.max(errors, axis=0)[same].max(initial=0.0)),
    )


def polished(
    problems: Problems, found: Allocation, some: NDArray[np.bool_], tensions: Floats, changed: dict[str, Floats]
) -> Floats:
    """Return tensions (B, K, m) of the direction policy, to rounding; those of the other policies as they are.

    The solver's are exact to 1e-9 N there, and differences would have that over their step. Those that keep the
    direction solve ``W t = s w`` for the free cables, one fewer than components, and s. Where none do, they are
    those of the force policy.
    """
    if problems.policy != "direction":
        return tensions
    n = problems.structure.shape[1]
    some = some & (found.status == Status.NEAREST)
    free = problems.held(found.tensions[:, None])[:, 0] == 0
    better = tensions.copy()
    hopeless = some & np.isnan(found.scale)
    better[hopeless] = replace(problems, policy="force").solve(**changed).tensions[hopeless]
    kept = some & ~hopeless & (free.sum(axis=1) == n - 1)
    if not kept.any():
        return better
    shape = kept.sum(), tensions.shape[1]
    structure, wrench = (
        np.broadcast_to(changed.get(name, getattr(problems, name)[:, None])[kept], (*shape, *own))
        for name, own in (("structure", problems.structure.shape[1:]), ("wrench", (n,)))
    )
    index = np.argsort(~free[kept], axis=1, kind="stable")[:, : n - 1]
    side = problems.held(tensions, **changed)[kept]
    lower, upper = (changed.get(name, getattr(problems, name)[:, None])[kept] for name in ("lower", "upper"))
    held = np.where(side < 0, lower, np.where(side > 0, upper, 0.0))
    columns = np.take_along_axis(structure, index[:, None, None, :], axis=3)
    matrix = np.concatenate([columns, -wrench[..., None]], axis=3)
    solved = np.linalg.solve(matrix, -np.einsum("bknm,bkm->bkn", structure, held)[..., None])[..., :-1, 0]
    np.put_along_axis(held, np.broadcast_to(index[:, None], solved.shape), solved, axis=2)
    better[kept] = held
    if np.abs(better - tensions)[some].max(initial=0.0) > 1e-6:
        raise AssertionError("the solver's tensions of the direction policy are not exact to 1e-6 N")
    return better


def _error(found: Floats, expected: Floats) -> Floats:
    """Return the largest difference of each problem, against its largest entry, or 1."""
    flat = [each.reshape(len(found), -1) for each in (found - expected, expected)]
    difference, size = (np.abs(each).max(axis=1, initial=0.0) for each in flat)
    return np.asarray(difference / np.maximum(1.0, size))


def times(n: int, m: int, feasible: bool, count: int, rounds: int) -> dict[str, float]:
    """Return seconds a problem on one core, each the best of the rounds: the solver, and what is made of it."""
    structure, wrench = random_problems(n, m, count, seed=0)
    if not feasible:
        wrench = infeasible_wrenches(structure, wrench, seed=0)
    limits = np.full(m, LOWER), np.full(m, UPPER)
    cotangent = np.random.default_rng(0).normal(size=(count, m))
    works: dict[str, Callable[[], Any]] = {
        "solve": lambda: allocate(structure, wrench, limits),
        "wrench": lambda: fresh().wrench,
        "structure": lambda: fresh().structure,
        "pull back": lambda: fresh().pull_back(cotangent),
    }
    spent: dict[str, list[float]] = {name: [] for name in works}

    def fresh() -> Any:
        """Return derivatives of the same tensions, of which none are made so far."""
        return type(solved)(solved.allocation, solved._problem, solved._shape)

    with using_threads(1):
        solved = allocation_jacobian(structure, wrench, limits)
        for _ in range(rounds):
            for name, work in works.items():
                began = time.perf_counter()
                work()
                spent[name].append((time.perf_counter() - began) / count)
    return {name: min(each) for name, each in spent.items()}


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=42, help="problems of each size under each policy")
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    print(f"{'policy':10} problems  kinks  crossed  compared  infeasible  largest difference")
    total = Agreement()
    for policy in POLICIES:
        each = sum((compare(draw(n, m, options.count, policy, seed=0)) for n, m in SIZES), Agreement())
        total += each
        _print(policy, each)
    _print("all", total)
    print(f"\n{describe_kernels()}\nµs a problem, one core; after the solver, for the same tensions\n")
    print(f"{'':26}  solve  d wrench  d structure  pull back  pull back / solve")
    for n, m in SHAPES:
        for feasible in (True, False):
            row = times(n, m, feasible, 20_000, options.rounds)
            name = f"n = {n}, m = {m}, {'feasible' if feasible else 'infeasible'}"
            cells = " ".join(
                f"{1e6 * row[key]:{width}.2f}" for key, width in zip(row, (6, 9, 12, 10), strict=True)
            )
            print(f"{name:26} {cells} {row['pull back'] / row['solve']:18.2f}")
    raise SystemExit(total.largest > TOLERANCE)


def _print(name: str, each: Agreement) -> None:
    counts = f"{each.problems:8,d} {each.kinks:6,d} {each.crossed:8,d} {each.compared:9,d} {each.infeasible:11,d}"
    print(f"{name:10} {counts} {each.largest:19.1e}", flush=True)


if __name__ == "__main__":
    main()
