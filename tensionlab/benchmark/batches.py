"""How fast is the exact solver, against the fastest peer's own clock, in one run?

`python -m tensionlab.benchmark.batches` prints it: a hundred thousand problems in one call, beside
DAQP's C code and a Python loop over DAQP.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab import _native
from tensionlab.allocation import allocate
from tensionlab.arrays import Floats
from tensionlab.benchmark import daqp_direct
from tensionlab.benchmark.statistics import quantile
from tensionlab.solvers.base import Status

LOWER, UPPER = 0.5, 6.0
SHAPES = ((3, 4), (3, 8), (3, 12), (6, 8))
"""Components and cables of the batches."""
THREADS = "TENSIONLAB_NUM_THREADS"
PEER_CALLS = 1000
"""Problems that DAQP solves in each round."""


@dataclass(frozen=True)
class BatchRow:
    """Seconds a problem, each the best of the rounds; NaN where DAQP is not installed.

    Attributes
    ----------
    components, cables, count : int
    reachable : bool
        Whether all wrenches can be rendered, or none.
    one_core_s, all_cores_s : float
        In one `allocate` call, proof included, on one thread and on ``cores``.
    cores : int
    daqp_c_s : float
        Set-up and solve by DAQP's own clock, without its Python wrapper.
    daqp_loop_s : float
        A Python loop over DAQP's own module, its arrays ready.
    gap_max : float
        Largest difference between both tensions, in N; NaN out of reach, where DAQP has none.
    """

    components: int
    cables: int
    count: int
    reachable: bool
    one_core_s: float
    all_cores_s: float
    cores: int
    daqp_c_s: float
    daqp_loop_s: float
    gap_max: float

    @property
    def ratio(self) -> float:
        """One core's time over DAQP's in C."""
        return self.one_core_s / self.daqp_c_s


def instruction_set() -> str:
    """Which instruction set do the kernels use on this machine?"""
    return _native.instruction_set()


def random_problems(components: int, cables: int, count: int, seed: int) -> tuple[Floats, Floats]:
    """Random structure matrices (count, n, m) of unit cables, and wrenches (count, n) they can render."""
    rng = np.random.default_rng(seed)
    pulls = rng.normal(size=(count, 3, cables))
    pulls /= np.linalg.norm(pulls, axis=1, keepdims=True)
    arms = rng.normal(scale=0.3, size=(count, 3, cables))
    structure = pulls if components == 3 else np.concatenate([pulls, np.cross(arms, pulls, axis=1)], axis=1)
    tensions = rng.uniform(LOWER, UPPER, size=(count, cables))
    return structure, np.einsum("bnm,bm->bn", structure, tensions)


def beyond(structure: Floats, wrench: Floats, seed: int) -> Floats:
    """Wrenches in the same directions that are 1 % to 100 % further than any tensions can do."""
    far = 1e3 * wrench
    scale = allocate(structure, far, (LOWER, UPPER), nearest="direction").scale
    share = 1.0 + 10.0 ** np.random.default_rng(seed).uniform(-2.0, 0.0, len(wrench))
    return np.asarray((np.nan_to_num(scale, nan=1e-2) * share)[:, None] * far)


def against_daqp(
    components: int, cables: int, reachable: bool = True, count: int = 100_000, rounds: int = 7, seed: int = 0
) -> BatchRow:
    """How long does a problem take in one large batch, in DAQP's C code, and in a Python loop over it?

    All are timed in turn, ``rounds`` times, and each one's best compared: a busy machine takes more from a
    long batch than from a short call. DAQP solves another `PEER_CALLS` of the problems in each round; its C time
    is the median of those. Without DAQP its columns are NaN.
    """
    structure, wrench = random_problems(components, cables, count, seed)
    if not reachable:
        wrench = beyond(structure, wrench, seed)
    expected = Status.EXACT if reachable else Status.NEAREST
    cores = os.cpu_count() or 1
    one: list[float] = []
    every: list[float] = []
    inside: list[float] = []
    loop: list[float] = []
    gap = 0.0
    peer = daqp_loop(structure, wrench) if daqp_direct.installed() else None
    for turn in range(rounds):
        for threads, spent in ((1, one), (cores, every)):
            with using_threads(threads):
                began = time.perf_counter()
                result = allocate(structure, wrench, (LOWER, UPPER))
                spent.append((time.perf_counter() - began) / count)
        assert (result.status == expected).all()
        if peer is None:
            continue
        rows = np.arange(turn * PEER_CALLS, (turn + 1) * PEER_CALLS) % count
        began = time.perf_counter()
        answers = peer(rows)
        loop.append((time.perf_counter() - began) / len(rows))
        inside.append(quantile(np.array([info["setup_time"] + info["solve_time"] for *_, info in answers]), 0.5))
        if reachable:
            theirs = np.array([tensions for tensions, *_ in answers])
            gap = max(gap, float(np.abs(theirs - result.tensions[rows]).max()))
    return BatchRow(
        components=components,
        cables=cables,
        count=count,
        reachable=reachable,
        one_core_s=min(one),
        all_cores_s=min(every),
        cores=cores,
        daqp_c_s=min(inside, default=float("nan")),
        daqp_loop_s=min(loop, default=float("nan")),
        gap_max=gap if reachable and peer else float("nan"),
    )


@contextmanager
def using_threads(count: int) -> Iterator[None]:
    """Let the kernels use so many threads inside a block; they read the environment in each call."""
    before = os.environ.get(THREADS)
    os.environ[THREADS] = str(count)
    try:
        yield
    finally:
        if before is None:
            del os.environ[THREADS]
        else:
            os.environ[THREADS] = before


def daqp_loop(structure: Floats, wrench: Floats) -> Callable[[Any], list[Any]]:
    """A function that solves some of the problems with DAQP, all stacking done beforehand."""
    solve = daqp_direct.load().solve
    count, n, m = structure.shape
    cost, linear, sense = np.eye(m), np.zeros(m), daqp_direct.sense(n, m)
    above = np.hstack([np.full((count, m), UPPER), wrench])
    below = np.hstack([np.full((count, m), LOWER), wrench])
    return lambda rows: [solve(cost, linear, structure[row], above[row], below[row], sense) for row in rows]


def main() -> None:
    """Print the table."""
    print(f"Instruction set: {instruction_set()}")
    print("                   µs a problem:     batch       batch    DAQP  DAQP, loop   ratio to  largest gap")
    print("  n   m   wrenches            1 core   all cores    in C   in Python  DAQP in C            N")
    for components, cables in SHAPES:
        for reachable in (True, False):
            row = against_daqp(components, cables, reachable)
            times = (row.one_core_s, row.all_cores_s, row.daqp_c_s, row.daqp_loop_s)
            cells = [f"{1e6 * value:11.3f}" for value in times]
            kind = "reachable  " if reachable else "unreachable"
            print(f"{components:3d} {cables:3d}   {kind} {' '.join(cells)} {row.ratio:10.3f} {row.gap_max:12.1e}")


if __name__ == "__main__":
    main()
