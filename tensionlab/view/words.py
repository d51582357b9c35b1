"""What the panel says of a state, as HTML and as text."""

from __future__ import annotations

from html import escape

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.display import short, status_mark
from tensionlab.solvers.base import Status
from tensionlab.view.evaluation import Evaluation
from tensionlab.view.scene import force_scale, tension_colours
from tensionlab.view.state import State
from tensionlab.view.volume import VALUE_RAMP, Volume
from tensionlab.workspace import metrics

POLICY_WORDS = {
    "force": "the nearest wrench is rendered",
    "tension": "the tensions nearest to equilibrium are taken",
    "direction": "the longest wrench in the desired direction is rendered",
}
"""What is done where the desired wrench is infeasible, by policy."""
AT_LIMIT_N = 1e-6
ZERO = 1e-9


def status(state: State, found: Evaluation) -> str:
    """Return the status, the forces and the margin, as HTML."""
    if found.allocation is None:
        return _box("#D55E00", "no answer", escape(found.problem))
    word, colour, more = "EXACT", "#009E73", "the desired force is rendered"
    code = Status(int(found.allocation.status))
    if code is Status.NEAREST:
        word, colour = "NEAREST", "#D55E00"
        more = "certified infeasible: " + POLICY_WORDS.get(str(found.nearest), "another wrench is rendered")
        if found.nearest == "direction" and np.isfinite(found.allocation.scale):
            more += f", {100 * float(found.allocation.scale):.3g} % of it"
    elif code is not Status.EXACT:
        word, colour, more = code.name, "#D55E00", status_mark(int(code)).word
    return _box(colour, word, more) + _rows(_lines(state, found)) + _scale(state)


def _lines(state: State, found: Evaluation) -> list[tuple[str, str, str]]:
    """Return what is said of the wrench and the margin: name, value and note of each line."""
    assert found.allocation is not None
    assert found.rendered is not None
    d, turns = state.rig.dimension, state.rig.n > state.rig.dimension
    lines = []
    for name, part, unit in (("force", slice(0, d), "N"), ("torque", slice(d, None), "N·m"))[: 1 + turns]:
        for which, wrench in (("desired", state.wrench), ("rendered", found.rendered)):
            length = _number(float(np.linalg.norm(wrench[part])))
            lines.append((f"{which} {name}", f"{length} {unit}", _vector(wrench[part])))
    note = "N and N·m together" if turns else ""
    lines.append(("error", f"{_number(float(found.allocation.residual))} N", note))
    if found.certificate is not None:
        proof = f"along {_vector(found.certificate.direction)}; desired {_number(found.certificate.desired)} N"
        lines.append(("at most", f"{_number(found.certificate.reach)} N", proof))
    beside = "" if found.ghost_margin is None else f"; {found.ghost_margin:.3g} N of {_ghost_name(state)}"
    lines.append(("capacity margin", f"{found.margin:.3g} N", "at the hand" + beside))
    return lines


def _ghost_name(state: State) -> str:
    same = state.ghost is not None and state.ghost.name == state.rig.name
    return "the other" if same or state.ghost is None else state.ghost.name


def _rows(lines: list[tuple[str, str, str]]) -> str:
    """Return a table of names, values and notes."""
    rows = "".join(
        f'<tr><td style="white-space:nowrap">{name}</td>'
        f'<td style="text-align:right;padding:0 .8em;white-space:nowrap"><b>{value}</b></td>'
        f'<td style="opacity:.65">{escape(note)}</td></tr>'
        for name, value, note in lines
    )
    return f'<table style="font-size:12px;line-height:1.45;margin:.3em .6em 0">{rows}</table>'


def _scale(state: State) -> str:
    return (
        '<div style="font-size:11px;opacity:.65;margin:0 .75em .4em">'
        f"arrows of forces: 1 m is {1.0 / force_scale(state.rig):g} N</div>"
    )


def tensions(state: State, found: Evaluation) -> str:
    """Return each module's tension as a bar between zero and the largest limit, as HTML."""
    if found.allocation is None:
        return ""
    most = float(state.rig.limits.upper.max()) or 1.0
    rows = []
    colours = tension_colours(state.rig, found)
    for module, tension, colour in zip(state.rig.modules, found.allocation.tensions, colours, strict=True):
        at = ""
        if tension <= module.lower + AT_LIMIT_N:
            at = "lower limit"
        elif tension >= module.upper - AT_LIMIT_N:
            at = "upper limit"
        left, width = 100 * module.lower / most, 100 * max(module.upper - module.lower, 0.0) / most
        bar = (
            '<div style="position:relative;height:10px;background:rgba(128,128,128,.15);border-radius:2px">'
            f'<div style="position:absolute;left:{left:.2f}%;width:{width:.2f}%;height:100%;'
            'background:rgba(128,128,128,.25)"></div>'
            f'<div style="position:absolute;left:0;width:{100 * tension / most:.2f}%;height:100%;'
            f'background:rgb({",".join(map(str, colour))});border-radius:2px"></div></div>'
        )
        rows.append(
            '<div style="overflow:hidden;text-overflow:ellipsis;white-space:nowrap">'
            f"{escape(module.name)}</div>{bar}"
            f'<div style="text-align:right;white-space:nowrap"><b>{short(float(tension))} N</b> '
            f'<span style="opacity:.65">{at}</span></div>'
        )
    grid = "display:grid;grid-template-columns:minmax(4em,8em) 1fr auto;gap:3px 8px;align-items:center;"
    grid += "font-size:12px;margin:.3em .75em"
    return f'<div style="{grid}">{"".join(rows)}</div>'


def _number(value: float) -> str:
    """Return a number in three digits; what is zero but for rounding is 0."""
    return "0" if abs(value) < ZERO else f"{value:.3g}"


def _vector(values: Floats) -> str:
    return f"({', '.join(_number(float(each)) for each in values)})" if len(values) > 1 else ""


def _box(colour: str, word: str, more: str) -> str:
    return (
        f'<div style="margin:.2em .75em;border-left:5px solid {colour};padding:.15em .6em">'
        f'<b style="font-size:16px">{word}</b><div style="font-size:12px">{more}</div></div>'
    )


def problem(text: str) -> str:
    """Return what was refused and why, as HTML; nothing if nothing was."""
    return _box("#D55E00", "not done", escape(text)) if text else ""


def share(state: State, volume: Volume, ghost: Volume | None = None) -> str:
    """Return in which share of the box the metric is above the level, as HTML."""
    metric = metrics.make(state.metric)
    unit = "" if metric.unit == "1" else f" {metric.unit}"
    low, high = volume.extent
    across = " x ".join(f"{float(np.ptp(axis)):.3g}" for axis in volume.axes)
    beside = "" if ghost is None else f"; {100 * ghost.share(state.level):.1f} % with {escape(_ghost_name(state))}"
    ramp = ""
    if state.display == "slices":
        colours = f"background:linear-gradient(90deg,{','.join(VALUE_RAMP)})"
        ramp = (
            f'<div style="display:flex;gap:.5em;align-items:center"><span>{low:.3g}</span>'
            f'<div style="flex:1;height:8px;{colours}"></div><span>{high:.3g}{unit}</span></div>'
        )
    return (
        f'<div style="font-size:12px;margin:0 .75em .5em">{ramp}'
        f"<b>{100 * volume.share(state.level):.1f} %</b> of the box of {across} m "
        f"has a {escape(metric.title)} above {state.level:.3g}{unit}; "
        f"it is from {low:.3g} to {high:.3g}{unit}{beside}."
        f'<div style="opacity:.65">{escape(metrics.description(metric))}</div></div>'
    )
