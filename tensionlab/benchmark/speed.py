"""Timing of calls in turns, and the speed of the exact solver and of DAQP in large batches and single calls."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from tensionlab import _native
from tensionlab.allocation import Allocator, allocate
from tensionlab.benchmark import baselines
from tensionlab.benchmark.rigs import structures
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats

Caller = TypeVar("Caller")
Measured = TypeVar("Measured")

SHIFT_S = 1e-6  # shift of the geometric mean, in s: a call of 0.1 µs counts hardly less than one of 0.2 µs
INSTRUCTION_SET = _native.INSTRUCTION_SET  # that the kernels use on this machine
LOWER, UPPER = 0.5, 6.0  # tension limits of all problems, in N
SHAPES = ((3, 4), (3, 8), (3, 12), (6, 8))  # components and cables of the batches
CALL_SHAPES = ((3, 8), (6, 8))  # components and cables of the single calls
THREADS = "TENSIONLAB_NUM_THREADS"  # environment variable with the number of threads of the kernels
DAQP_CALLS = 1000  # problems that DAQP solves in each round
BLOCK = 20  # single calls in a row before the next caller's turn
PASSES = 3  # times that each caller gets each single problem


def seconds(call: Callable[..., Any], *arguments: Any) -> float:
    """Return the wall time of a call."""
    began = time.perf_counter()
    call(*arguments)
    return time.perf_counter() - began


@contextmanager
def without_collector() -> Iterator[None]:
    """Keep Python's garbage collector from running, and from searching what exists already."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


def take_turns(
    turns: Iterable[tuple[Sequence[int], Mapping[Caller, Callable[[int], Measured]]]], rng: np.random.Generator
) -> Iterator[tuple[Caller, int, Measured]]:
    """Yield each caller, row and measurement of each turn: some rows, and the callers that measure a call for one.

    In each turn the rows and the callers are shuffled, so that all callers share the machine's slow moments. The
    first call of a caller in a turn is repeated and its first measurement dropped: it fills the caches.
    """
    for rows, callers in turns:
        order, names = rng.permutation(np.asarray(rows)).tolist(), list(callers)
        for place in rng.permutation(len(names)):
            measure = callers[names[place]]
            measure(order[0])
            for row in order:
                yield names[place], row, measure(row)


def shifted_geometric_mean(seconds: Floats, shift: float = SHIFT_S) -> float:
    """Return ``exp(mean(log(t + shift))) - shift``, the typical time; NaN for no times.

    Ratios count, and tiny times do not dominate. As in the benchmarks of Mittelmann.
    """
    seconds = seconds[np.isfinite(seconds)]
    if not seconds.size:
        return float("nan")
    return float(np.exp(np.mean(np.log(seconds + shift))) - shift)


def quantile(values: Floats, share: float) -> float:
    """Return the value that this share of the values does not exceed, without NaN; NaN if there are no others.

    The value is one of those measured: the smallest that enough of them do not exceed. So the largest of 100
    calls is their 99.9 % quantile, and not an interpolation between two of them.
    """
    values = values[np.isfinite(values)]
    return float(np.quantile(values, share, method="inverted_cdf")) if values.size else float("nan")


@dataclass(frozen=True)
class BatchRow:
    """Seconds of a problem in a large batch, each the best of the rounds; NaN where DAQP is not installed.

    In one `allocate` call, verification included, on one thread and on ``cores``; set-up and solve by DAQP's own
    clock, without its Python wrapper; and in a Python loop over DAQP's module, its arrays ready. ``gap_max`` is
    the largest difference of the tensions, in N; NaN where wrenches are infeasible, for which DAQP has none.
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


@dataclass(frozen=True)
class CallRow:
    """Seconds of one call for one problem.

    ``median_s`` and ``p999_s`` include the machine's interruptions, ``quiet_p999_s`` hardly: it is the 99.9 %
    quantile of each problem's best time of `PASSES`.
    """

    components: int
    cables: int
    caller: str
    median_s: float
    p999_s: float
    quiet_p999_s: float


def describe_kernels() -> str:
    """Say which compiler made the kernels, for which instruction sets, and which this processor uses."""
    compiled = ", ".join(_native.INSTRUCTION_SETS)
    return f"kernels: {_native.COMPILER}, compiled for {compiled}; this processor uses {_native.INSTRUCTION_SET}"


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


def time_batches(
    components: int, cables: int, reachable: bool = True, count: int = 100_000, rounds: int = 7, seed: int = 0
) -> BatchRow:
    """Time a problem in one large batch, in DAQP's C code, and in a Python loop over DAQP.

    All are timed in turn, ``rounds`` times, and the best of each counts: a busy machine takes more from a long
    batch than from a short call. DAQP solves another `DAQP_CALLS` of the problems in each round; its C time is
    the median of those.
    """
    structure, wrench = random_problems(components, cables, count, seed)
    if not reachable:
        wrench = infeasible_wrenches(structure, wrench, seed)
    expected = Status.EXACT if reachable else Status.NEAREST
    cores = os.cpu_count() or 1
    spent: dict[str, list[float]] = {"one_core_s": [], "all_cores_s": [], "daqp_c_s": [], "daqp_loop_s": []}
    daqp = daqp_loop(structure, wrench) if baselines.daqp_installed() else None
    gap = 0.0 if reachable and daqp else np.nan
    for turn in range(rounds):
        for threads, name in ((1, "one_core_s"), (cores, "all_cores_s")):
            with using_threads(threads):
                began = time.perf_counter()
                result = allocate(structure, wrench, (LOWER, UPPER))
                spent[name].append((time.perf_counter() - began) / count)
        assert (result.status == expected).all()
        if daqp is None:
            continue
        rows = np.arange(turn * DAQP_CALLS, (turn + 1) * DAQP_CALLS) % count
        began = time.perf_counter()
        answers = daqp(rows)
        spent["daqp_loop_s"].append((time.perf_counter() - began) / len(rows))
        in_c = np.array([info["setup_time"] + info["solve_time"] for *_, info in answers])
        spent["daqp_c_s"].append(quantile(in_c, 0.5))
        if reachable:
            found = np.array([tensions for tensions, *_ in answers])
            gap = max(gap, float(np.abs(found - result.tensions[rows]).max()))
    times = {name: min(values, default=np.nan) for name, values in spent.items()}
    return BatchRow(components, cables, count, reachable, cores=cores, gap_max=gap, **times)


@contextmanager
def using_threads(count: int) -> Iterator[None]:
    """Let the kernels use `count` threads inside a block; they read the environment in each call."""
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
    """Return a function that solves the problems of some rows with DAQP, all stacking done beforehand."""
    solve = baselines.load_daqp().solve
    count, n, m = structure.shape
    cost, linear, sense = np.eye(m), np.zeros(m), baselines.constraint_types(n, m)
    above = np.hstack([np.full((count, m), UPPER), wrench])
    below = np.hstack([np.full((count, m), LOWER), wrench])
    return lambda rows: [solve(cost, linear, structure[row], above[row], below[row], sense) for row in rows]


def time_calls(components: int, cables: int, calls: int = 5000, seed: int = 0) -> list[CallRow]:
    """Time single calls, as of a control loop or a script, and those of DAQP and qpsolvers on the same problems.

    DAQP is called with the identity matrix of its cost, zeros and constraint types prebuilt. Callers take turns of
    `BLOCK` calls, in a new random order each time, after one that is not timed, in `PASSES` passes.
    """
    structure, wrench = random_problems(components, cables, calls, seed)
    lower, upper = np.full(cables, LOWER), np.full(cables, UPPER)
    prepared = Allocator((lower, upper))
    callers: dict[str, Callable[[int], Any]] = {
        "tl.Allocator": lambda row: prepared(structure[row], wrench[row]),
        "tl.allocate": lambda row: allocate(structure[row], wrench[row], (lower, upper)),
    }
    if baselines.daqp_installed():
        loop = daqp_loop(structure, wrench)
        callers["daqp.solve, matrices prebuilt"] = lambda row: loop((row,))
        callers['qpsolvers.solve_qp(solver="daqp")'] = lambda row: baselines.solve_qp(
            structure[row], wrench[row], lower, upper, "daqp"
        )
    rng = np.random.default_rng(seed)
    spent = {name: np.empty((PASSES, calls)) for name in callers}
    blocks = [range(first, min(first + BLOCK, calls)) for first in range(0, calls, BLOCK)]
    timed = {name: partial(seconds, call) for name, call in callers.items()}
    with without_collector():
        for times in range(PASSES):
            for name, row, spent_s in take_turns(((block, timed) for block in blocks), rng):
                spent[name][times, row] = spent_s
    return [
        CallRow(components, cables, name, quantile(each, 0.5), quantile(each, 0.999), quantile(each.min(0), 0.999))
        for name, each in spent.items()
    ]
