"""What the page of a run says, as HTML: how it is, forces, modules, loop times and events."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from tensionlab.hardware.log.shared_run import Condition, RunInfo, RunReport
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.hardware.runner.statistics import DEMAND_STOPPED, DURATION_REACHED
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREEN, GREY, ORANGE, RED, ramp
from tensionlab.support.formatting import format_count, format_duration, format_number
from tensionlab.viewer.instant import BESIDE_COLOUR, ENLARGED, Instant
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.stop import StopOutcome
from tensionlab.viewer.words import box, number, rows, vector

SHOWN_EVENTS = 20
SILENT_S = 3.0
"""A page that hears nothing from its server for so long says so itself."""
SHOWN_DECIMALS = 3
"""Of components in N: a text that changes its length from cycle to cycle cannot be read."""
DECIMALS = 4
"""Of errors in N: modules measure no finer."""
LATE_PERIODS = 3.0
"""Telemetry that is older than so many cycles is marked."""
SMALL = "font-size:12px;margin:.3em .75em"


def heading(condition: Condition, age: float, info: RunInfo | None, report: RunReport | None) -> str:
    """Return how the run is, as HTML, and for how long it has been so if that is not as it should be."""
    if info is None:
        return box(GREY, "WAITING", "for the run to answer") if condition != "gone" else _gone("")
    who = (
        '<div style="opacity:.65;white-space:nowrap;overflow:hidden;text-overflow:ellipsis">'
        f"process {info.pid}: {escape(info.program)}</div>"
    )
    if condition == "gone":
        return _gone(who)
    if condition == "waiting":
        return box(GREY, "WAITING", f"for news of the run{who}")
    if condition == "arming":
        return box(ORANGE, "ARMING", f"modules are armed, and slack cables reeled in{who}")
    if condition == "stale":
        return box(RED, f"STALE for {age:.1f} s", f"no newer cycle has come; what is shown is old{who}")
    assert report is not None
    if condition == "ended":
        return _ended(report)
    assert report.cycle is not None
    cycles = format_count(report.cycles, "cycle")
    now = f"{float(report.cycle['time']):.1f} s, {cycles} at {info.rate:g} Hz, {info.solver}"
    if report.lost:
        return box(ORANGE, f"LIVE, {format_count(len(report.lost), 'module')} lost", now + who)
    return box(GREEN, "LIVE", now + who)


def _gone(who: str) -> str:
    return box(RED, "GONE", f"its process has ended without a word; its modules release as their links close{who}")


def _ended(report: RunReport) -> str:
    lines = [escape(report.ended) or "for a reason that nobody knows"]
    lines += [f"lost: {escape(name)}: {escape(why)}" for name, why in report.lost.items()]
    lines += [
        f"<b>{escape(name)} did not confirm that it has stopped</b>: {escape(why)}"
        for name, why in report.unconfirmed.items()
    ]
    well = report.ended in (DURATION_REACHED, DEMAND_STOPPED) or report.ended.startswith("signal")
    colour = RED if report.unconfirmed or report.lost or report.emergency or not well else GREY
    confirmed = "" if report.unconfirmed else "; all modules have confirmed that they stopped"
    return box(colour, "ENDED", f"{format_count(report.cycles, 'cycle')}{confirmed}<br>{'<br>'.join(lines)}")


def style() -> str:
    """Return the style of parts that are not renewed, as HTML.

    What `renewed` wraps fades by itself, so nothing looks live where the page's server is gone.
    """
    return (
        "<style>@keyframes tensionlab-fade{to{opacity:.3}}"
        "@keyframes tensionlab-hide{to{max-height:0;opacity:0}}"
        "@keyframes tensionlab-show{to{max-height:20em;opacity:1}}</style>"
    )


def renewed(html: str, beat: int, *, fresh: bool) -> str:
    """Return HTML that is faint if not fresh, or not replaced for `SILENT_S`; ``beat`` is always another."""
    look = f"animation:tensionlab-fade 0s {SILENT_S:g}s forwards" if fresh else "opacity:.45"
    return f'<div data-beat="{beat}" style="{look}">{html}</div>'


def renewed_heading(html: str, beat: int) -> str:
    """Return a heading in whose place browsers show that they hear nothing, if not replaced for `SILENT_S`."""
    text = (
        "This page hears nothing from its server: what it shows is old, and its button may stop nothing. "
        "<code>tensionlab estop</code> in a terminal stops all modules."
    )
    hides, shows = (
        f"overflow:hidden;animation:tensionlab-{what} 0s {SILENT_S:g}s forwards" for what in ("hide", "show")
    )
    return (
        f'<div data-beat="{beat}" style="{hides}">{html}</div>'
        f'<div style="max-height:0;opacity:0;{shows}">{box(RED, "NO NEWS", text)}</div>'
    )


def phases(scenery: Scenery | None, time: float) -> str:
    """Return which scenario is played, and its phases at a time, as HTML; nothing without one."""
    if scenery is None:
        return ""
    names = ", ".join(escape(phase.name) for phase in scenery.active_phases(time)) or "none"
    return f'<div style="{SMALL}">{escape(scenery.title)}, phase: <b>{names}</b></div>'


def forces(rig: Rig, instant: Instant) -> str:
    """Return desired, commanded and measured wrench, as HTML."""
    d = rig.dimension
    wrenches: list[tuple[str, str, Floats]] = [
        (name, colour, getattr(instant, name)) for name, colour in FORCE_COLOURS.items()
    ]
    if instant.beside is not None:
        wrenches.append((escape(instant.beside.solver), BESIDE_COLOUR, instant.beside.wrench))
    lines = []
    for name, colour, wrench in wrenches:
        known = bool(np.isfinite(wrench).all())
        size = _force(wrench[:d]) if known else "–"
        more = vector(np.round(wrench, SHOWN_DECIMALS)) if known else "taut cables"
        lines.append((f'<span style="color:{colour}">■</span> {name}', size, more))
    if np.isfinite(instant.desired).all():
        error = np.round(instant.measured - instant.desired, DECIMALS)
        lines.append(("measured − desired", _force(error[:d]), vector(error)))
    notes = [f"arrows of forces: 1 m is {1.0 / (ENLARGED * force_scale(rig)):g} N"]
    if rig.n > d:
        notes.append("vectors in N and N·m")
    return f'{rows(lines)}<div style="{SMALL};opacity:.65">{"; ".join(notes)}</div>'


def _force(components: Floats) -> str:
    return f"{number(float(np.linalg.norm(components)))} N"


def modules(info: RunInfo, report: RunReport, instant: Instant, *, fresh: bool = True) -> str:
    """Return each module's tension as a bar with its set-point, and below it how the module is, as HTML."""
    assert report.cycle is not None
    rig = info.rig
    most = float(rig.limits.upper.max()) or 1.0
    colours = ramp(np.where(instant.active & fresh, instant.tensions, np.nan), rig.limits.lower, rig.limits.upper)
    slack = instant.slack(rig)
    lines = []
    for i, module in enumerate(rig.modules):
        lost = not instant.active[i]
        share = _share(instant.tensions[i], most)
        mark = _mark(instant.set_points[i], most, BLUE)
        if instant.beside is not None and not lost:
            mark += _mark(instant.beside.tensions[i], most, BESIDE_COLOUR)
        bar = (
            '<div style="position:relative;height:10px;background:rgba(128,128,128,.2);border-radius:2px">'
            f'<div style="width:{share:.1f}%;height:100%;background:rgb({",".join(map(str, colours[i]))});'
            f'border-radius:2px"></div>{mark}</div>'
        )
        value = "LOST" if lost else f"{format_number(float(instant.tensions[i]))} N"
        look = f"color:{RED}" if lost or slack[i] else ""
        name = "overflow:hidden;text-overflow:ellipsis;white-space:nowrap"
        lines.append(
            f'<div style="{name}">{escape(module.name)}</div>{bar}'
            f'<div style="text-align:right;white-space:nowrap;{look}"><b>{value}</b></div>'
            f'<div style="grid-column:1/4;opacity:.8;font-size:11px;margin-bottom:4px">'
            f"{_state(info, report, i, slack=bool(slack[i]))}</div>"
        )
    grid = "display:grid;grid-template-columns:minmax(4em,8em) 1fr auto;gap:2px 8px;align-items:center;"
    return f'<div style="{grid}{SMALL}">{"".join(lines)}</div>'


def _share(tension: float, most: float) -> float:
    """Return how far along its bar a tension is, in %."""
    return 100.0 * min(max(float(np.nan_to_num(tension)) / most, 0.0), 1.0)


def _mark(tension: float, most: float, colour: str) -> str:
    """Return a mark across a bar at a tension; nothing for NaN."""
    if np.isnan(tension):
        return ""
    return (
        f'<div style="position:absolute;left:calc({_share(tension, most):.1f}% - 1px);width:2px;height:14px;'
        f'top:-2px;background:{colour}"></div>'
    )


def _state(info: RunInfo, report: RunReport, index: int, *, slack: bool) -> str:
    """Return how a module is: driver, brake, limiter, link and faults."""
    cycle: Mapping[str, Floats] = report.cycle or {}
    state, limit = State(int(cycle["states"][index])), Limit(int(cycle["limiters"][index]))
    faults = [each.name or "" for each in Fault(int(cycle["faults"][index]))]
    brake = int(cycle["brake_states"][index])
    words = [state.name.lower()]
    if np.isfinite(report.currents[index]):
        words.append(f"{format_number(float(report.currents[index]))} A")
    words.append(f"heat {100 * float(np.nan_to_num(cycle['thermal'][index])):.0f} %")
    commanded = bool(cycle["commanded_brakes"][index])
    if brake >= 0:
        closed = "" if commanded is (brake == BrakeState.CLOSED) else f", commanded {'on' if commanded else 'off'}"
        words.append(f"brake {BrakeState(brake).name.lower()}{closed}")
    if limit is not Limit.NONE:
        words.append(f"limited by {limit.name.lower()}")
    age = float(cycle["ages"][index])
    link = f"link {1e3 * age:.0f} ms" if np.isfinite(age) else "link silent"
    words.append(_marked(link) if age * info.rate > LATE_PERIODS else link)
    if bad := int(report.bad_frames[index]):
        words.append(format_count(bad, "damaged frame"))
    if slack:
        words.append(_marked("slack"))
    words += [_marked(f"fault: {each.lower()}") for each in faults]
    if why := report.lost.get(info.rig.modules[index].name):
        words.append(_marked(why))
    return " · ".join(words)


def _marked(text: str) -> str:
    return f'<span style="color:{RED}">{escape(text)}</span>'


def times(info: RunInfo, report: RunReport, start_delays: Floats, compute_times: Floats) -> str:
    """Return the latency of the loop, and what cycles lately took, as HTML; times are in s."""
    lines = []
    if report.cycle is not None:
        delays = report.cycle["delays"][report.cycle["active"]]
        worst = float(np.nanmax(delays)) if np.isfinite(delays).any() else float("nan")
        lines.append(f"loop latency {format_duration(worst)} (set-point to telemetry, slowest module)")
    for name, values in (("start jitter", start_delays), ("compute time", compute_times)):
        if len(values):
            middle, high = np.percentile(values, [50.0, 99.0])
            lines.append(f"{name} {format_duration(float(middle))} median, {format_duration(float(high))} p99")
    missed = f"{format_count(report.missed, 'deadline')} missed"
    lines.append(_marked(missed) if report.missed else missed)
    lines.append(escape(report.answers))
    period = f"; a cycle has {format_duration(1.0 / info.rate)}"
    return f'<div style="{SMALL}">{"<br>".join(lines)}{period}</div>'


def events(report: RunReport) -> str:
    """Return the latest events, the newest first, as HTML."""
    cell = "padding-right:.8em;white-space:nowrap;vertical-align:top"
    lines = "".join(
        f'<tr><td style="text-align:right;{cell}">{event.time:.2f} s</td>'
        f'<td style="{cell}"><b>{escape(event.kind)}</b></td>'
        f"<td>{escape(event.text)}</td></tr>"
        for event in list(report.events)[: -SHOWN_EVENTS - 1 : -1]
    )
    return f'<div style="{SMALL}">{f"<table>{lines}</table>" if lines else "none yet"}</div>'


def stopping() -> str:
    """Return what is said while a stop goes on, as HTML."""
    return box(ORANGE, "STOPPING", "waiting for the modules to confirm it ...")


def stopped(outcome: StopOutcome) -> str:
    """Return what came of a stop, as HTML."""
    lines = "<br>".join(escape(each) for each in outcome.lines)
    if outcome.confirmed:
        return box(GREEN, "STOPPED", lines)
    return box(RED, "NOT STOPPED", f"{lines}<br>Cut the power of modules that still pull.")
