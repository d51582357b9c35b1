"""What a sweep needs, before it begins: values, time and disk; and the refusal of what does not fit."""

from __future__ import annotations

import math
import shutil
import time
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

from tensionlab.errors import SweepError
from tensionlab.support.formatting import format_count
from tensionlab.workspace.sweep.executors import thread_count
from tensionlab.workspace.sweep.plan import Plan

MAX_SAMPLE_POSES = 512
SAMPLE_SHARE = 1 / 64
"""Of the poses are evaluated, twice, for the estimate of the time, and no more than that many."""
BYTES_PER_VALUE = 8


def estimate_seconds(plan: Plan) -> float:
    """Return how long a sweep takes on all processors, in s, from some poses in its middle."""
    poses = math.prod(plan.shape)
    sample = replace(plan, chunk=max(1, min(MAX_SAMPLE_POSES, round(SAMPLE_SHARE * poses), plan.chunk)))
    task = sample.task(math.prod(sample.tiles) // 2)
    task.evaluate()  # what is used for the first time takes longer
    start = time.perf_counter()
    task.evaluate()
    return (time.perf_counter() - start) * poses / sample.size(task.number) / thread_count()


def describe(plan: Plan, seconds: float | None) -> str:
    """Return in words how many values a sweep has, how long it takes, if that is known, and what they take up."""
    poses, metrics = math.prod(plan.shape), len(plan.metrics)
    parts = f"{format_count(poses, 'pose')}, {format_count(metrics, 'metric')}"
    values = f"{format_count(poses * metrics, 'value')} ({parts})"
    lasts = "" if seconds is None else f", about {timedelta(seconds=max(1, round(seconds)))}"
    return f"{values}{lasts}, {in_bytes(size(plan))} at most"


def size(plan: Plan) -> int:
    """Return the most that the values of a sweep take, in bytes; Zarr compresses them."""
    return BYTES_PER_VALUE * math.prod(plan.shape) * len(plan.metrics)


def require_space(plan: Plan, path: Path) -> None:
    """Refuse a sweep whose values do not fit on the disk where a new store is to be made."""
    folder = path.absolute().parent
    if path.exists() or not folder.is_dir():
        return
    free = shutil.disk_usage(folder).free
    if size(plan) > free:
        raise SweepError(
            f"the sweep has {describe(plan, None)}, and {folder} has {in_bytes(free)} left; take a longer step, a "
            "smaller box or fewer metrics, or another disk"
        )


def in_bytes(count: int) -> str:
    """Write a number of bytes with its unit, in three digits."""
    power = min(max(0, int(math.log10(max(count, 1)) // 3)), 5)
    return f"{count / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB', 'PB')[power]}"
