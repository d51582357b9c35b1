"""Events of a run for its timeline: those in its log, and those that its columns show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit
from tensionlab.solvers.base import Status
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from tensionlab.support.formatting import format_number

# Kinds of marks, and their colours; "run" marks its end, and lost or derated modules.
KINDS = {"phase": GREY, "run": BLUE, "status": ORANGE, "fault": RED, "limiter": PURPLE, "brake": GREEN}
GAP_S = 0.25  # longest interruption within one spell of an event


@dataclass(frozen=True)
class RunMark:
    """Event at a time in s since the run began, of one of `KINDS`, in words."""

    time: float
    kind: str
    text: str


def marks(run: Run) -> tuple[RunMark, ...]:
    """Return the events of a run in order of time; a lasting one at its begin, with its duration."""
    found = [
        *_noted(run),
        *(mark for kind, text, flags in _flags(run) for mark in _spell_marks(run, kind, text, flags)),
    ]
    return tuple(sorted(found, key=lambda mark: mark.time))


def _noted(run: Run) -> Iterator[RunMark]:
    for event in run.events:
        who = f"{event.module}: " if event.module else ""
        if event.kind in ("phase", "brake"):
            yield RunMark(event.time, event.kind, f"{who}{event.text}")
        else:
            yield RunMark(event.time, "run", f"{event.kind}: {who}{event.text}")


def _flags(run: Run) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    """Yield kind, text and cycles (K,) of each event that the columns of a run show."""
    for status in Status:
        if status is not Status.EXACT:
            yield "status", status.name, run.status == status
    yield "status", "unproven: newton's answer was sent", run.fallback_used
    for index, module in enumerate(run.rig.modules):
        for fault in Fault:
            yield "fault", f"{module.name}: {fault.name}", (run.faults[:, index] & fault) != 0
        for limit in Limit:
            if limit is not Limit.NONE:
                yield "limiter", f"{module.name}: {limit.name}", run.limiters[:, index] == limit
        yield "brake", f"{module.name}: brake commanded on", run.commanded_brakes[:, index]
        yield "brake", f"{module.name}: brake closed", run.brake_states[:, index] == BrakeState.CLOSED


def _spell_marks(run: Run, kind: str, text: str, flags: NDArray[np.bool_]) -> Iterator[RunMark]:
    for first, last in spells(run.time, flags):
        to_end = last == len(run) - 1
        duration = (
            "to the end" if to_end else f"for {format_number(float(run.time[last + 1] - run.time[first]))} s"
        )
        yield RunMark(float(run.time[first]), kind, f"{text}, {duration}")


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
