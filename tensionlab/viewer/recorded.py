"""A run from its log, as a watcher would have seen it at each time."""

from __future__ import annotations

from collections import Counter
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import LogError
from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.sharing import RunInfo, RunSnapshot
from tensionlab.solvers.base import Status
from tensionlab.viewer.run_scene import Instant

SHOWN_TIMES = 1000  # number of latest cycles over which times of the loop are shown


def require_drawable(run: Run, path: str | PathLike[str]) -> None:
    """Refuse a run of which nothing can be drawn: LogError, naming the file."""
    if not len(run):
        raise LogError(f"{path}: the run ended before its first cycle; there is nothing to show")
    if (np.diff(run.time) < 0.0).any():
        raise LogError(f"{path}: its cycles are not in the order of time; the log is damaged")
    placed = np.isfinite(run.position).all(axis=1) & np.isfinite(run.anchors).all(axis=(1, 2))
    if not placed.all():
        raise LogError(
            f"{path}: in cycle {run.cycle[~placed][0]} it is not known where the hand and all anchors are; "
            "there is nothing to draw"
        )


def info_of(run: Run) -> RunInfo:
    """Return what did not change while the run lasted."""
    setup = run.setup
    call = str(run.manifest.get("call", ""))
    return RunInfo(0, 0, call, run.rig, setup.solver, setup.rate, setup.ttl, setup.links, setup.scenery)


def cycle_of(run: Run, index: int) -> dict[str, NDArray[Any]]:
    """Return the cycle of an index, by the names of `CycleTable`."""
    return {name: getattr(run, name)[index] for name in COLUMNS}


def report_at(run: Run, index: int) -> RunSnapshot:
    """Return the report of a run in progress after a cycle, by its index; NaN and 0 for what logs do not have."""
    m, done = run.rig.m, index + 1
    events = tuple(event for event in run.events if event.cycle <= run.cycle[index])
    deadlines = np.round((run.time[[0, index]] - run.start_delay[[0, index]]) * run.setup.rate)
    counts = np.bincount(run.status[:done], minlength=len(Status))
    fallback = int(run.fallback_used[:done].sum())
    statuses = Counter({status: int(counts[status]) for status in Status})
    return RunSnapshot(
        number=0,
        over=False,
        cycle=cycle_of(run, index),
        bad_frames=np.zeros(m, np.int64),
        currents=np.full(m, np.nan),
        supplies=np.full(m, np.nan),
        start_delays=run.start_delay[max(done - SHOWN_TIMES, 0) : done],
        compute_times=run.compute_time[max(done - SHOWN_TIMES, 0) : done],
        cycles=done,
        missed=int(deadlines[1] - deadlines[0]) + 1 - done,
        fallback_used=fallback,
        answers=Statistics(statuses=statuses, fallback_used=fallback).answers,
        lost={event.module: event.text for event in events if event.kind == "lost"},
        unconfirmed={},
        ended="",
        emergency=False,
        events=events,
    )


def instant_at(run: Run, index: int) -> Instant:
    """Return the instant of the cycle of an index."""
    return Instant.of(run.rig, cycle_of(run, index))
