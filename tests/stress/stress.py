"""Stress test of the exact solver: millions of random and awkward problems, each answer checked without it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, allocate
from tensionlab.benchmark.optimum import at_limits, distance_bound, largest_limit
from tensionlab.benchmark.rigs import near_singular, structures
from tensionlab.solvers.base import POLICIES, TOLERANCE, Policy, Problem, Status
from tensionlab.solvers.programs import times
from tensionlab.support.arrays import Floats, Integers

SHAPES = (
    *((1, 1), (1, 2), (2, 3), (2, 8), (3, 3), (3, 4), (3, 5), (3, 8), (3, 12), (3, 32)),
    *((4, 6), (5, 7), (6, 6), (6, 7), (6, 8), (6, 12), (6, 32)),
)
BATCH = 20_000
# A wrench within reach is rendered to this share of what the cables pull with, in wrench components.
RENDERED = 1e-12
# Tensions are wrong if they are further than this from the optimum, in N, or as a share of the largest limit.
WRONG = 1e-6


@dataclass(frozen=True)
class Draw:
    """Problems of one shape, their wrenches not yet chosen."""

    structure: Floats
    lower: Floats
    upper: Floats
    inside: Floats
    """Tensions inside the limits."""

    def wrench(self, stretch: Floats | float = 1.0) -> Floats:
        """Return the wrenches that the tensions inside the limits render, stretched."""
        rendered = times(self.structure, self.inside)
        return np.asarray(rendered * np.broadcast_to(stretch, len(rendered))[:, None])


def _ordinary(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    structure = structures(rng, 3 if n <= 3 else 6, m, count)[:, :n]
    lower, upper = np.full((count, m), 0.5), np.full((count, m), 6.0)
    return Draw(structure, lower, upper, rng.uniform(lower, upper))


def _edge(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Wrenches that take nearly all cables to their limits."""
    draw = _ordinary(rng, n, m, count)
    kind = rng.random((count, m))
    inside = np.where(kind < 0.4, draw.lower, np.where(kind < 0.8, draw.upper, draw.inside))
    return Draw(draw.structure, draw.lower, draw.upper, inside)


def _parallel(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Cables along one another, opposed, or without play; others of very different strength."""
    draw = _ordinary(rng, n, m, count)
    structure, lower, upper = draw.structure.copy(), draw.lower.copy(), draw.upper.copy()
    structure[::2, :, -1] = structure[::2, :, 0]
    structure[::3, :, -1] = -structure[::3, :, 0]
    upper[::4, m // 2] = lower[::4, m // 2]
    lower[::5, 0], upper[::5, 0] = 0.0, 186.0
    return Draw(structure, lower, upper, rng.uniform(lower, upper))


def _nearly_parallel(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Pairs of cables whose directions differ by 1e-5."""
    draw = _ordinary(rng, n, m, count)
    structure = draw.structure.copy()
    pairs = m // 2
    structure[:, :, :pairs] = structure[:, :, m - pairs :] + 1e-5 * rng.normal(size=(count, n, pairs))
    return Draw(structure, draw.lower, draw.upper, draw.inside)


def _integer(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Small whole numbers: many answers on corners and edges at once, many matrices that lack a rank."""
    structure = rng.integers(-2, 3, (count, n, m)).astype(float)
    lower, upper = np.full((count, m), 1.0), np.full((count, m), 4.0)
    return Draw(structure, lower, upper, rng.integers(1, 5, (count, m)).astype(float))


def _singular(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Structure matrices that lack a rank."""
    draw = _ordinary(rng, n, m, count)
    structure = draw.structure.copy()
    structure[:, -1] = structure[:, 0] * rng.uniform(-1.0, 1.0, (count, 1))
    return Draw(structure, draw.lower, draw.upper, draw.inside)


def _near_singular(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Structure matrices with a condition of 100 to 10,000."""
    condition = 10.0 ** rng.uniform(2.0, 4.0, count)
    if n in (3, 6):
        structure = near_singular(rng, n, m, condition)
    else:
        structure = _ordinary(rng, n, m, count).structure / np.linspace(1.0, condition, n)[:, :, None].swapaxes(
            0, 1
        )
    lower, upper = np.full((count, m), 0.5), np.full((count, m), 6.0)
    return Draw(structure, lower, upper, rng.uniform(lower, upper))


KINDS: dict[str, tuple[Callable[[np.random.Generator, int, int, int], Draw], Callable[..., Floats | float]]] = {
    "within reach": (_ordinary, lambda rng, count: 1.0),
    "at the edge": (_edge, lambda rng, count: 1.0),
    "a hair beyond": (_edge, lambda rng, count: 1.0 + 10.0 ** rng.uniform(-9.0, -2.0, count)),
    "beyond": (_ordinary, lambda rng, count: rng.uniform(1.0, 4.0, count)),
    "far beyond": (_ordinary, lambda rng, count: 10.0 ** rng.uniform(1.0, 6.0, count)),
    "parallel, fixed, strong": (_parallel, lambda rng, count: rng.uniform(0.5, 2.0, count)),
    "nearly parallel": (_nearly_parallel, lambda rng, count: rng.uniform(0.5, 2.0, count)),
    "whole numbers": (_integer, lambda rng, count: rng.integers(1, 3, count).astype(float)),
    "singular": (_singular, lambda rng, count: rng.uniform(0.5, 2.0, count)),
    "nearly singular": (_near_singular, lambda rng, count: rng.uniform(0.5, 2.0, count)),
}
"""How the rigs of a kind are drawn, and by how much a wrench within reach is stretched."""


@dataclass
class Tally:
    """What was found for the problems of one kind under one policy."""

    problems: int = 0
    exact: int = 0
    policy: int = 0
    unproved: int = 0
    wrong: int = 0
    worst: float = 0.0
    rounds: list[int] = field(default_factory=lambda: [0] * 4096)

    def add(self, status: NDArray[np.int8], distance: Floats, iterations: Integers) -> None:
        """Count one batch."""
        self.problems += len(status)
        self.exact += int(np.count_nonzero(status == Status.EXACT))
        self.policy += int(np.count_nonzero(status == Status.NEAREST))
        self.unproved += int(np.count_nonzero(status >= Status.UNPROVEN))
        self.wrong += int(np.count_nonzero(distance > WRONG))
        self.worst = max(self.worst, float(distance.max(initial=0.0)))
        for count, found in enumerate(np.bincount(iterations, minlength=1)):
            self.rounds[min(count, len(self.rounds) - 1)] += int(found)

    def quantile(self, share: float) -> int:
        """Return the iterations that this share of the problems does not exceed."""
        return int(np.searchsorted(np.cumsum(self.rounds), share * self.problems))


def stress(count: int, seed: int = 0, report: Callable[[str], None] = print) -> dict[tuple[str, Policy], Tally]:
    """Solve random problems, and tally wrong and missing answers and iterations of the exact solver.

    Each batch draws its limits, wrench and reference (zero, the lower limits, the middle, or random). An answer is
    right if it is proved EXACT or NEAREST, keeps what `tensionlab.Allocation` promises of the status, and
    multipliers show that no other tensions that render the same are closer to the reference
    (`tensionlab.benchmark.optimum`).

    Parameters
    ----------
    count : int
        Problems in all, spread over kinds, shapes and policies.
    seed : int
    report : callable
        Takes a line of the table when a kind is done.
    """
    tallies: dict[tuple[str, Policy], Tally] = {}
    each = max(1, count // (len(KINDS) * len(SHAPES) * len(POLICIES)))
    report(
        f"{'kind':24} {'policy':10} {'problems':>10} {'exact':>10} {'policy':>10} {'unproved':>8} {'wrong':>6} "
        f"{'worst, N':>9}   iterations: median, 99.9 %, worst"
    )
    for number, (kind, (draw, stretch)) in enumerate(KINDS.items()):
        for policy in POLICIES:
            tally = tallies[kind, policy] = Tally()
            for n, m in SHAPES:
                rng = np.random.default_rng([seed, number, POLICIES.index(policy), n, m])
                for begin in range(0, each, BATCH):
                    some = min(BATCH, each - begin)
                    drawn = draw(rng, n, m, some)
                    stretched = np.broadcast_to(stretch(rng, some), some)
                    problem = _problem(rng, drawn, drawn.wrench(stretched), policy)
                    tally.add(*_check(problem, stretched == 1.0))
            report(
                f"{kind:24} {policy:10} {tally.problems:10,} {tally.exact:10,} {tally.policy:10,} "
                f"{tally.unproved:8} {tally.wrong:6} {tally.worst:9.1e}   "
                f"{tally.quantile(0.5)}, {tally.quantile(0.999)}, {tally.quantile(1.0)}"
            )
    return tallies


def _problem(rng: np.random.Generator, draw: Draw, wrench: Floats, policy: Policy) -> Problem:
    references = (
        np.zeros_like(draw.lower),
        draw.lower,
        (draw.lower + draw.upper) / 2,
        rng.uniform(-2.0, 8.0, draw.lower.shape),
    )
    reference = references[rng.integers(4)]
    return Problem(draw.structure, wrench, draw.lower, draw.upper, reference, np.ones(wrench.shape[1]), policy)


def _solve(problem: Problem) -> Allocation:
    lower, upper = problem.lower, problem.upper
    if (lower == lower[0]).all() and (upper == upper[0]).all():
        lower, upper = lower[0], upper[0]  # one for all rows goes another way
    limits, policy = (lower, upper), problem.policy
    return allocate(problem.structure, problem.wrench, limits, reference=problem.reference, policy=policy)


def _check(problem: Problem, within_reach: NDArray[np.bool_]) -> tuple[NDArray[np.int8], Floats, Integers]:
    """Which statuses, distances to the promised tensions and iterations; within_reach: by construction, (B,)."""
    found = _solve(problem)
    exact = found.status == Status.EXACT
    distance = distance_bound(problem, found.tensions, found.separation)
    # EXACT may be a hair out of reach: then it promises the wrench within tolerance, and the tensions that are
    # best for the wrench they render. Within reach the wrench is rendered to rounding, and what is missing of it
    # would not change the tensions, however near W is to singular.
    missing = problem.wrench - found.wrench
    error = np.linalg.norm(missing, axis=1)
    limit = largest_limit(problem)
    rendered = error <= RENDERED * np.linalg.norm(np.abs(problem.structure).sum(axis=2), axis=1) * limit
    free = ~np.logical_or(*at_limits(problem, found.tensions))
    change = times(np.asarray(np.linalg.pinv(problem.structure * free[:, None, :])), missing)
    better = found.tensions + change
    left = np.linalg.norm(problem.wrench - times(problem.structure, better), axis=1)
    room = ((problem.lower <= better) & (better <= problem.upper)).all(axis=1)
    room &= left <= 1e-3 * error
    distance += np.where(exact & room & rendered, np.linalg.norm(change, axis=1), 0.0)
    asked = np.maximum(1.0, np.linalg.norm(problem.wrench, axis=1))
    missed = (exact & (error > TOLERANCE * asked)) | (within_reach & ~(exact & rendered))
    return found.status, np.where(missed, np.inf, distance / np.maximum(1.0, limit)), found.iterations


def main() -> None:
    """Run and print the table; exit status 1 if an answer is wrong or without proof."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000_000, help="problems in all")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    began = time.perf_counter()
    tallies = stress(asked.count, asked.seed, lambda line: print(line, flush=True))
    problems = sum(tally.problems for tally in tallies.values())
    flawed = sum(tally.wrong + tally.unproved for tally in tallies.values())
    print(f"{problems:,} problems in {time.perf_counter() - began:.0f} s: {flawed} wrong or without proof")
    raise SystemExit(1 if flawed else 0)


if __name__ == "__main__":
    main()
