"""Texts of a run as HTML: forces, modules, loop times and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.hardware.sharing import RunInfo, RunSnapshot
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS
from tensionlab.support.formatting import format_count, format_number
from tensionlab.viewer.html import norm, render, vector
from tensionlab.viewer.run_marks import KINDS, RunMark
from tensionlab.viewer.run_scene import ENLARGED, Instant
from tensionlab.viewer.scene import force_scale

SHOWN_EVENTS = 20  # number of latest events that are shown of a run in progress
LISTED_MARKS = 14  # number of events around the time that is shown of a log
DECIMALS = 3  # decimals of components in N: a text that changes its length from cycle to cycle cannot be read
LATE_PERIODS = 3.0  # age of telemetry, in cycles, from which on it is marked


def forces(rig: Rig, instant: Instant) -> str:
    """Return desired, commanded and measured wrench, and the error."""
    d = rig.dimension
    lines = [(name, colour, *_force(getattr(instant, name), d)) for name, colour in FORCE_COLOURS.items()]
    if np.isfinite(instant.desired).all():
        lines.append(("measured − desired", "", *_force(instant.measured - instant.desired, d)))
    newtons = 1.0 / (ENLARGED * force_scale(rig))
    return render("run.forces", lines, newtons, "; vectors in N and N·m" if rig.n > d else "")


def _force(wrench: Floats, d: int) -> tuple[str, str]:
    """Return the size of the force and the components of a wrench; only pretension where none is desired."""
    if not np.isfinite(wrench).all():
        return "–", "pretension only"
    rounded = np.round(wrench, DECIMALS)
    return f"{norm(rounded[:d])} N", vector(rounded)


def modules(info: RunInfo, report: RunSnapshot, instant: Instant, *, fresh: bool = True) -> str:
    """Return each module's tension as a bar with its set-point, and its state below."""
    assert report.cycle is not None
    rig = info.rig
    colours, slack = instant.colours(rig, fresh=fresh), instant.slack(rig)
    lines = []
    for i, module in enumerate(rig.modules):
        state, faults = _state(info, report, report.cycle, i)
        faults = [*faults, "slack"] if slack[i] else faults
        lines.append({
            "name": module.name,
            "tension": float(instant.tensions[i]),
            "colour": colours[i],
            "marks": [(float(instant.set_points[i]), BLUE)],
            "value": f"{format_number(float(instant.tensions[i]))} N" if instant.active[i] else "LOST",
            "warn": bool(slack[i]) or not instant.active[i],
            "state": state,
            "faults": faults,
        })  # fmt: skip
    return render("run.modules", lines, float(rig.limits.upper.max()) or 1.0)


def _state(info: RunInfo, report: RunSnapshot, cycle: Mapping[str, Any], i: int) -> tuple[list[str], list[str]]:
    """Return the state of a module: driver, brake and limiter; and what is wrong with it."""
    texts = [State(int(cycle["states"][i])).name.lower()]
    if np.isfinite(report.currents[i]):
        texts.append(f"{format_number(float(report.currents[i]))} A")
    texts.append(f"heat {100 * float(np.nan_to_num(cycle['thermal'][i])):.0f} %")
    brake, commanded = int(cycle["brake_states"][i]), bool(cycle["commanded_brakes"][i])
    if brake >= 0:
        as_commanded = commanded is (brake == BrakeState.CLOSED)
        differs = "" if as_commanded else f", commanded {'on' if commanded else 'off'}"
        texts.append(f"brake {BrakeState(brake).name.lower()}{differs}")
    limiter = Limit(int(cycle["limiters"][i]))
    if limiter is not Limit.NONE:
        texts.append(f"limited by {limiter.name.lower()}")
    age = float(cycle["ages"][i])
    link = f"link {1e3 * age:.0f} ms" if np.isfinite(age) else "link silent"
    faults = [link] if age * info.rate > LATE_PERIODS else []
    if not faults:
        texts.append(link)
    if bad := int(report.bad_frames[i]):
        texts.append(format_count(bad, "damaged frame"))
    faults += [f"fault: {(fault.name or '').lower()}" for fault in Fault(int(cycle["faults"][i]))]
    if why := report.lost.get(info.rig.modules[i].name):
        faults.append(why)
    return texts, faults


def times(info: RunInfo, report: RunSnapshot) -> str:
    """Return the latency of the loop, and the times of the latest cycles."""
    latency = None
    if report.cycle is not None:
        delays = report.cycle["delays"][report.cycle["active"]]
        latency = float(np.nanmax(delays)) if np.isfinite(delays).any() else float("nan")
    quantiles = [
        (name, *(float(value) for value in np.percentile(values, [50.0, 99.0])))
        for name, values in (("start jitter", report.start_delays), ("compute time", report.compute_times))
        if len(values)
    ]
    return render("run.times", latency, quantiles, report.missed, report.answers, 1.0 / info.rate)


def events(report: RunSnapshot) -> str:
    """Return the latest events of a run in progress, the newest first."""
    newest = list(report.events)[: -SHOWN_EVENTS - 1 : -1]
    return render("run.events", newest)


def marks_around(marks: Sequence[RunMark], time: float) -> str:
    """Return the events of a log around a time, the latest before it marked."""
    latest = sum(mark.time <= time + 1e-6 for mark in marks) - 1
    first = max(min(latest - LISTED_MARKS // 2, len(marks) - LISTED_MARKS), 0)
    return render("run.events", marks[first : first + LISTED_MARKS], KINDS, latest - first)
