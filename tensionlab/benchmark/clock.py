"""The clock: single calls of all contestants in turn, and large batches.

In each of several rounds the blocks come in a new random order; in each block the contestants come in a new
random order, and each answers the first problem once untimed, because what the others left in the caches is not
its fault, and then all of the block's problems in a random order. So all contestants share the machine's slow
moments. Python's garbage collector sleeps while the clock runs and works between blocks.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocator
from tensionlab.arrays import Floats
from tensionlab.benchmark.drivers import Driver
from tensionlab.benchmark.entries import Contestant
from tensionlab.benchmark.rows import Evidence
from tensionlab.benchmark.statistics import quantile
from tensionlab.solvers import make
from tensionlab.solvers.base import Problem

BATCH = 10_000
"""Problems in a timed batch; a group is repeated until it has as many."""


@dataclass(frozen=True)
class Block:
    """Some problems of one group: which, of all problems of the set, and the problems themselves."""

    rows: NDArray[np.intp]
    problem: Problem


def time_calls(
    asked: dict[Contestant, tuple[Driver, list[Block]]],
    evidence: dict[Contestant, Evidence],
    repeats: int,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> None:
    """Time single calls, everyone in turn."""
    queue: dict[int, tuple[Block, list[Contestant]]] = {}
    for contestant, (_, blocks) in asked.items():
        for block in blocks:
            queue.setdefault(id(block), (block, []))[1].append(contestant)
    turns = list(queue.values())
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        for repeat in range(repeats):
            for done, turn in enumerate(rng.permutation(len(turns))):
                block, takers = turns[turn]
                order = rng.permutation(len(block.rows)).tolist()
                for taker in rng.permutation(len(takers)):
                    ask, calls = asked[takers[taker]][0], evidence[takers[taker]].calls
                    ask.call(block.problem, 0)
                    for row in order:
                        calls[block.rows[row], repeat] = ask.call(block.problem, row)
                gc.collect()
                progress((repeat + (done + 1) / len(turns)) / repeats)
    finally:
        gc.enable()
        gc.unfreeze()


def time_batch(contestant: Contestant, blocks: list[Block], seconds: float) -> float:
    """How long does a problem take in one large batch, as the median of three?

    Problems of one shape are one batch, repeated until it has `BATCH` of them, or fewer for a slow solver.
    """
    shapes: dict[tuple[int, ...], list[Problem]] = {}
    for block in blocks:
        shapes.setdefault(block.problem.structure.shape[1:], []).append(block.problem)
    total, count = 0.0, 0
    for parts in shapes.values():
        structure, wrench, lower, upper = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("structure", "wrench", "lower", "upper")
        )

        def spend(size: int, arrays: tuple[Floats, ...] = (structure, wrench, lower, upper)) -> float:
            chosen = np.arange(size) % len(arrays[0])
            repeated = [array[chosen] for array in arrays]
            allocator = Allocator((repeated[2], repeated[3]), make(contestant.solver), nearest=contestant.nearest)
            began = time.perf_counter()
            allocator(repeated[0], repeated[1])
            return time.perf_counter() - began

        once = spend(len(structure))
        affordable = int(len(structure) * seconds / len(shapes) / 3 / max(once, 1e-9))
        size = min(BATCH, max(len(structure), affordable))
        total += quantile(np.array([spend(size) for _ in range(3)]), 0.5) * len(structure) / size
        count += len(structure)
    return total / count if count else float("nan")
