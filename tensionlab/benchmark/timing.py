"""Timing of calls in turns, and statistics of many times."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tensionlab.support.arrays import Floats

Caller = TypeVar("Caller")
Measured = TypeVar("Measured")

SHIFT_S = 1e-6  # shift of the geometric mean, in s: a call of 0.1 µs counts hardly less than one of 0.2 µs


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


def maximum(values: Floats) -> float:
    """Return the largest finite value; NaN if there is none."""
    values = values[np.isfinite(values)]
    return float(values.max()) if values.size else float("nan")


def profile(seconds: Floats, solved: NDArray[np.bool_], tried: NDArray[np.bool_]) -> list[Floats]:
    """Return the performance profile of each entry: how much slower it is than the fastest, problem by problem.

    Of C entries on P problems, all (P, C): the times, and whether an entry solved or tried a problem. For each
    entry, ratios of its times to the fastest entry that solved the same problem, sorted; infinite where it failed.
    The share of ratios not above x is its profile at x. Problems that no entry solved do not count, nor those that
    an entry did not try.

    Source: Dolan and Moré, "Benchmarking optimization software with performance profiles", 2002.
    """
    times = np.where(solved, seconds, np.inf)
    best = times.min(axis=1, initial=np.inf)
    solved_by_any = np.isfinite(best)
    ratios = np.divide(times, best[:, None], out=np.full(times.shape, np.inf), where=np.isfinite(times))
    return [np.sort(ratios[solved_by_any & tried[:, c], c]) for c in range(times.shape[1])]
