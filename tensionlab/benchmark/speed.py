"""Timing of calls in turns, statistics of many times, and what the compiled kernels run on."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from tensionlab import _native
from tensionlab.support.arrays import Floats
from tensionlab.support.operating_system import KERNEL_THREADS

Caller = TypeVar("Caller")
Measured = TypeVar("Measured")

SHIFT_S = 1e-6  # shift of the geometric mean, in s: a call of 0.1 µs counts hardly less than one of 0.2 µs
INSTRUCTION_SET = _native.INSTRUCTION_SET  # that the kernels use on this machine


def describe_kernels() -> str:
    """Say which compiler made the kernels, for which instruction sets, and which this processor uses."""
    compiled = ", ".join(_native.INSTRUCTION_SETS)
    return f"kernels: {_native.COMPILER}, compiled for {compiled}; this processor uses {_native.INSTRUCTION_SET}"


@contextmanager
def using_threads(count: int) -> Iterator[None]:
    """Let the kernels use `count` threads inside a block; they read the environment in each call."""
    previous = os.environ.get(KERNEL_THREADS)
    os.environ[KERNEL_THREADS] = str(count)
    try:
        yield
    finally:
        del os.environ[KERNEL_THREADS]
        os.environ.update({} if previous is None else {KERNEL_THREADS: previous})


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
    return float(np.exp(np.mean(np.log(seconds + shift))) - shift) if seconds.size else float("nan")


def quantile(values: Floats, share: float) -> float:
    """Return the value that this share of the values does not exceed, without NaN; NaN if there are no others.

    The value is one of those measured: the smallest that enough of them do not exceed. So the largest of 100
    calls is their 99.9 % quantile, and not an interpolation between two of them.
    """
    values = values[np.isfinite(values)]
    return float(np.quantile(values, share, method="inverted_cdf")) if values.size else float("nan")
