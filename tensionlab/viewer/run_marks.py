"""Events of a run for its timeline: those in its log, and what its columns tell of answers and modules."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit
from tensionlab.solvers.base import Status
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from tensionlab.support.formatting import format_number

KINDS = {"phase": GREY, "run": BLUE, "status": ORANGE, "fault": RED, "limiter": PURPLE, "brake": GREEN}
"""Kinds of marks, and their colours. Those of the run are its end, and modules that are lost or derated."""
GAP_S = 0.25
"""What is interrupted for less goes on."""


@dataclass(frozen=True)
class Mark:
    """Event at a time in s since the run began, of one of `KINDS`, in words."""

    time: float
    kind: str
    text: str


def marks(run: Run) -> tuple[Mark, ...]:
    """Return the events of a run in order of time; of what lasts, its begin and for how long.

    Examples
    --------
    >>> from tensionlab.viewer.run_marks import Mark
    >>> Mark(1.2, "fault", "top: ENCODER, to the end").kind
    'fault'
    """
    found = [*_noted(run), *_statuses(run), *_of_modules(run)]
    return tuple(sorted(found, key=lambda mark: mark.time))


def _noted(run: Run) -> Iterator[Mark]:
    for event in run.events:
        who = f"{event.module}: " if event.module else ""
        if event.kind in ("phase", "brake"):
            yield Mark(event.time, event.kind, f"{who}{event.text}")
        else:
            yield Mark(event.time, "run", f"{event.kind}: {who}{event.text}")


def _statuses(run: Run) -> Iterator[Mark]:
    for status in Status:
        if status is not Status.EXACT:
            yield from _lasting(run, run.status == status, "status", status.name)
    yield from _lasting(run, run.fallback_used, "status", "unproven: newton's answer was sent")


def _of_modules(run: Run) -> Iterator[Mark]:
    for index, module in enumerate(run.rig.modules):
        for fault in Fault:
            flags = (run.faults[:, index] & fault) != 0
            yield from _lasting(run, flags, "fault", f"{module.name}: {fault.name}")
        for limit in Limit:
            if limit is not Limit.NONE:
                flags = run.limiters[:, index] == limit
                yield from _lasting(run, flags, "limiter", f"{module.name}: {limit.name}")
        commanded, closed = run.commanded_brakes[:, index], run.brake_states[:, index] == BrakeState.CLOSED
        yield from _lasting(run, commanded, "brake", f"{module.name}: brake commanded on")
        yield from _lasting(run, closed, "brake", f"{module.name}: brake closed")


def _lasting(run: Run, flags: NDArray[np.bool_], kind: str, text: str) -> Iterator[Mark]:
    """Yield a mark for each time that something began to be so."""
    for first, last in spells(run.time, flags):
        to_end = last == len(run) - 1
        duration = (
            "to the end" if to_end else f"for {format_number(float(run.time[last + 1] - run.time[first]))} s"
        )
        yield Mark(float(run.time[first]), kind, f"{text}, {duration}")


class Band(NamedTuple):
    """Phase in a timeline: its name, when it began and ended, in s, and the row in which it overlaps no other."""

    name: str
    begin: float
    end: float
    row: int


def phase_bands(found: Sequence[Mark], end: float, durations: Mapping[str, float]) -> list[Band]:
    """Return the phases among marks, each as long as its duration by name in s, or up to the next one.

    Examples
    --------
    >>> from tensionlab.viewer.run_marks import Mark, phase_bands
    >>> draw, full = Mark(0.0, "phase", "draw"), Mark(0.5, "phase", "full draw")
    >>> [(band.end, band.row) for band in phase_bands([draw, full], 6.0, {"draw": 5.0})]
    [(5.0, 0), (6.0, 1)]
    """
    phases = [mark for mark in found if mark.kind == "phase"]
    bands: list[Band] = []
    for i, mark in enumerate(phases):
        following = phases[i + 1].time if i + 1 < len(phases) else end
        stop = min(mark.time + durations.get(mark.text, following - mark.time), end)
        taken = {band.row for band in bands if band.end > mark.time + GAP_S / 10}
        bands.append(Band(mark.text, mark.time, stop, min(set(range(len(taken) + 1)) - taken)))
    return bands


def spells(time: NDArray[np.float64], flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and the last index of each spell of flags (K,), over gaps shorter than `GAP_S`.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.viewer.run_marks import spells
    >>> spells(np.arange(6.0), np.array([False, True, True, False, False, True]))
    [(1, 2), (5, 5)]
    """
    at = np.flatnonzero(flags)
    if not len(at):
        return []
    breaks = np.flatnonzero((np.diff(at) > 1) & (time[at[1:]] - time[at[:-1] + 1] >= GAP_S))
    firsts, lasts = at[np.append(0, breaks + 1)], at[np.append(breaks, len(at) - 1)]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))
