"""How did a run go? Counts, times and shares, from its log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Status
from tensionlab.arrays import Floats
from tensionlab.hardware.log.reader import Run, RunEvent
from tensionlab.hardware.protocol.codes import Fault, Limit

PERCENTILES = (50.0, 99.0, 100.0)


@dataclass(frozen=True)
class ModuleReport:
    """How did one module do in a run?

    Attributes
    ----------
    name, link : str
        The module, and where it was reached.
    sent_least, sent_mean, sent_most : float
        Set-points, in N; NaN if none was sent.
    limits : dict of str to float
        Share of the cycles in which each `Limit` held the tension back; those that never did are left out.
    faults : list of str
        That it ever reported.
    age : tuple of float
        Median, 99th percentile and largest age of its telemetry, in s.
    lost_at : float or None
        Time since when it did not take part any more, in s.
    """

    name: str
    link: str
    sent_least: float
    sent_mean: float
    sent_most: float
    limits: dict[str, float]
    faults: list[str]
    age: tuple[float, ...]
    lost_at: float | None


@dataclass(frozen=True)
class RunReport:
    """How did a run go?

    Attributes
    ----------
    rig, solver, nearest : str
        What ran, by which solver, with which policy; None if it honours none.
    rate, duration : float
        Cycles a second that were wanted; time from the first cycle to the last, in s.
    cycles, missed, fallback_used, slew_limited : int
        Cycles; deadlines at which none began; answers of the exact solver in place of the run's; set-points that
        were not what was chosen, by the limit on their change.
    statuses : dict of str to int
        Cycles by the `Status` of their allocation.
    start_delay, compute_time : tuple of float
        Begin of the cycles after their deadlines, and what the host needed for them, in s: median, 99th
        percentile, largest.
    ended : str
        What ended the run; empty if the log does not say.
    complete : bool
        Whether the log was closed.
    modules : tuple of ModuleReport
    events : tuple of RunEvent
    """

    rig: str
    solver: str
    nearest: str | None
    rate: float
    duration: float
    cycles: int
    missed: int
    fallback_used: int
    slew_limited: int
    statuses: dict[str, int]
    start_delay: tuple[float, ...]
    compute_time: tuple[float, ...]
    ended: str
    complete: bool
    modules: tuple[ModuleReport, ...]
    events: tuple[RunEvent, ...]


def report(run: Run) -> RunReport:
    """How did a run go? As far as its log goes."""
    deadlines = np.round((run.time - run.start_delay) * run.setup.rate)
    missed = int(deadlines[-1] - deadlines[0]) + 1 - len(run) if len(run) else 0
    changed = np.isfinite(run.commanded) & (abs(run.commanded - run.chosen) > 0.0)
    return RunReport(
        rig=run.rig.name,
        solver=run.setup.solver,
        nearest=run.setup.nearest,
        rate=run.setup.rate,
        duration=float(run.time[-1] - run.time[0]) if len(run) else 0.0,
        cycles=len(run),
        missed=missed,
        fallback_used=int(run.fallback_used.sum()),
        slew_limited=int(changed.any(axis=1).sum()),
        statuses={Status(status).name: int((run.status == status).sum()) for status in Status},
        start_delay=percentiles(run.start_delay),
        compute_time=percentiles(run.compute_time),
        ended=str(run.summary.get("ended", "")),
        complete=run.complete,
        modules=tuple(_module(run, index) for index in range(run.rig.m)),
        events=run.events,
    )


def _module(run: Run, index: int) -> ModuleReport:
    name = run.rig.modules[index].name
    sent = run.commanded[:, index]
    sent = sent[np.isfinite(sent)]
    gone = np.flatnonzero(~run.active[:, index])
    return ModuleReport(
        name=name,
        link=run.setup.links.get(name, ""),
        sent_least=float(sent.min()) if sent.size else np.nan,
        sent_mean=float(sent.mean()) if sent.size else np.nan,
        sent_most=float(sent.max()) if sent.size else np.nan,
        limits=_shares(run.limiters[:, index]),
        faults=[str(fault.name) for fault in Fault if (run.faults[:, index] & fault).any()],
        age=percentiles(run.ages[:, index]),
        lost_at=float(run.time[gone[0]]) if gone.size else None,
    )


def _shares(limits: NDArray[np.int64]) -> dict[str, float]:
    numbers, counts = np.unique(limits, return_counts=True)
    pairs = zip(numbers.tolist(), (counts / max(len(limits), 1)).tolist(), strict=True)
    names = {int(limit): limit.name for limit in Limit}
    return {names.get(number, f"limit {number}"): share for number, share in pairs if number != Limit.NONE}


def percentiles(values: Floats) -> tuple[float, ...]:
    """Median, 99th percentile and largest of the values that are numbers; NaN where there is none."""
    values = values[np.isfinite(values)]
    if not values.size:
        return (np.nan,) * len(PERCENTILES)
    return tuple(float(value) for value in np.percentile(values, PERCENTILES))
