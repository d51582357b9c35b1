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
from tensionlab.view.volume import Volume
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
    d, unit = state.rig.dimension, "N" if state.rig.n == state.rig.dimension else "N (and N·m)"
    rendered = found.allocation.wrench - (state.exerted - state.wrench)
    lines = [
        ("desired", f"{_number(float(np.linalg.norm(state.wrench[:d])))} N", _vector(state.wrench)),
        ("rendered", f"{_number(float(np.linalg.norm(rendered[:d])))} N", _vector(rendered)),
        ("error", f"{_number(float(found.allocation.residual))} {unit}", ""),
        ("capacity margin", f"{found.margin:.3g} N", "at the hand"),
    ]
    rows = "".join(
        f'<tr><td>{name}</td><td style="text-align:right;padding:0 .8em;white-space:nowrap"><b>{value}</b></td>'
        f'<td style="opacity:.65">{note}</td></tr>'
        for name, value, note in lines
    )
    scale = f"1 m in the picture is {short(1.0 / force_scale(state.rig))} N"
    return (
        _box(colour, word, more)
        + f'<table style="font-size:12px;margin:.3em .6em 0">{rows}</table>'
        + (f'<div style="font-size:11px;opacity:.65;margin:0 .75em .4em">{scale}</div>')
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
    """Return a number in few digits; what is zero but for rounding is 0."""
    return "0" if abs(value) < ZERO else short(value)


def _vector(values: Floats) -> str:
    return f"({', '.join(_number(float(each)) for each in values)})"


def _box(colour: str, word: str, more: str) -> str:
    return (
        f'<div style="margin:.2em .75em;border-left:5px solid {colour};padding:.15em .6em">'
        f'<b style="font-size:16px">{word}</b><div style="font-size:12px">{more}</div></div>'
    )


def problem(text: str) -> str:
    """Return what was refused and why, as HTML; nothing if nothing was."""
    return _box("#D55E00", "not done", escape(text)) if text else ""


def share(state: State, volume: Volume) -> str:
    """Return in which share of the box the metric is above the level, as HTML."""
    metric = metrics.make(state.metric)
    unit = "" if metric.unit == "1" else f" {metric.unit}"
    low, high = volume.extent
    across = " x ".join(f"{float(np.ptp(axis)):.3g}" for axis in volume.axes)
    return (
        f'<div style="font-size:12px;margin:0 .75em"><b>{100 * volume.share(state.level):.1f} %</b> of the box '
        f"of {across} m has a {escape(metric.title)} above {state.level:.3g}{unit}; "
        f"it is from {low:.3g} to {high:.3g}{unit}."
        f'<div style="opacity:.65">{escape(metrics.description(metric))}</div></div>'
    )
