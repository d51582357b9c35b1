"""What the panel says of a state, as HTML and as text."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_duration, format_number
from tensionlab.support.table import STATUS_MARKS
from tensionlab.viewer.evaluation import Evaluation
from tensionlab.viewer.scene import force_scale, tension_colours
from tensionlab.viewer.solver_study import STATUS_COLOURS, Answer
from tensionlab.viewer.state import State
from tensionlab.viewer.volume import VALUE_RAMP, Volume
from tensionlab.workspace import metrics
from tensionlab.workspace.layout.task import LayoutTask
from tensionlab.workspace.volume import describe_step

POLICY_WORDS = {
    "force": "the nearest wrench is rendered",
    "tension": "the tensions nearest to equilibrium are taken",
    "direction": "the longest wrench in the desired direction is rendered",
}
"""What is done where the desired wrench is infeasible, by policy."""
STATUS_WORDS = {
    Status.EXACT: "exact",
    Status.NEAREST: "certified infeasible",
    Status.UNPROVEN: "unproven",
    Status.FAILED: "failed",
}
AT_LIMIT_N = 1e-6
ZERO = 1e-9


def status(state: State, found: Evaluation) -> str:
    """Return the status, the forces and the margin, as HTML."""
    if found.allocation is None:
        return box("#D55E00", "no answer", escape(found.problem))
    word, colour, more = "EXACT", "#009E73", "the desired force is rendered"
    code = Status(int(found.allocation.status))
    if code is Status.NEAREST:
        word, colour = "NEAREST", "#D55E00"
        more = "certified infeasible: " + POLICY_WORDS.get(str(found.policy), "another wrench is rendered")
        if found.policy == "direction" and np.isfinite(found.allocation.scale):
            more += f", {100 * float(found.allocation.scale):.3g} % of it"
    elif code is not Status.EXACT:
        word, colour, more = code.name, "#D55E00", STATUS_MARKS[code].word
    return box(colour, word, more) + rows(_lines(state, found)) + _scale(state)


def _lines(state: State, found: Evaluation) -> list[tuple[str, str, str]]:
    """Return what is said of the wrench and the margin: name, value and note of each line."""
    assert found.allocation is not None
    assert found.rendered is not None
    d, turns = state.rig.dimension, state.rig.n > state.rig.dimension
    lines = []
    for name, part, unit in (("force", slice(0, d), "N"), ("torque", slice(d, None), "N·m"))[: 1 + turns]:
        for which, wrench in (("desired", state.wrench), ("rendered", found.rendered)):
            length = number(float(np.linalg.norm(wrench[part])))
            lines.append((f"{which} {name}", f"{length} {unit}", vector(wrench[part])))
    note = "N and N·m together" if turns else ""
    lines.append(("error", f"{number(float(found.allocation.residual))} N", note))
    if found.certificate is not None:
        proof = f"along {vector(found.certificate.direction)}; desired {number(found.certificate.desired)} N"
        lines.append(("at most", f"{number(found.certificate.reach)} N", proof))
    beside = "" if found.ghost_margin is None else f"; {found.ghost_margin:.3g} N of {_ghost_name(state)}"
    lines.append(("capacity margin", f"{found.margin:.3g} N", "at the hand" + beside))
    return lines


def _ghost_name(state: State) -> str:
    same = state.ghost is not None and state.ghost.name == state.rig.name
    return "the other" if same or state.ghost is None else state.ghost.name


def rows(lines: list[tuple[str, str, str]]) -> str:
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
            f'<div style="text-align:right;white-space:nowrap"><b>{format_number(float(tension))} N</b> '
            f'<span style="opacity:.65">{at}</span></div>'
        )
    grid = "display:grid;grid-template-columns:minmax(4em,8em) 1fr auto;gap:3px 8px;align-items:center;"
    grid += "font-size:12px;margin:.3em .75em"
    return f'<div style="{grid}">{"".join(rows)}</div>'


def number(value: float) -> str:
    """Return it in three digits; what is zero but for rounding is 0."""
    return "0" if abs(value) < ZERO else f"{value:.3g}"


def vector(values: Floats) -> str:
    """Return numbers in three digits, in brackets; nothing for one alone."""
    return f"({', '.join(number(float(each)) for each in values)})" if len(values) > 1 else ""


def box(colour: str, word: str, more: str) -> str:
    """Return a word beside a bar of a colour, with HTML below."""
    return (
        f'<div style="margin:.2em .75em;border-left:5px solid {colour};padding:.15em .6em">'
        f'<b style="font-size:16px">{word}</b><div style="font-size:12px">{more}</div></div>'
    )


def problem(text: str) -> str:
    """Return what was refused and why, as HTML; nothing if nothing was."""
    return box("#D55E00", "not done", escape(text)) if text else ""


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
        f"<b>{100 * volume.share(state.level):.1f} %</b> of the box of {across} m, "
        f"evaluated at positions {describe_step(volume.axes)}, "
        f"has a {escape(metric.title)} above {state.level:.3g}{unit}; "
        f"it is from {low:.3g} to {high:.3g}{unit}{beside}."
        f'<div style="opacity:.65">{escape(metrics.description(metric))}</div></div>'
    )


SOLVER_HEADINGS = ("solver", "now", "error", "|t|", "max t", "time", "exact", "jump")
"""Of the comparison of solvers; errors, tensions and jumps are in N."""


def solver_table(answers: Sequence[Answer], colours: Sequence[str]) -> str:
    """Return what solvers answer to the desired wrench and along the study, as HTML."""
    if not answers:
        return note("Choose solvers to compare with the one of the tab Hand.")
    rows = [_solver_cells(each) for each in answers]
    look = "text-align:right;padding:1px 0 1px 6px;white-space:nowrap"
    head = "".join(f'<th style="{look};font-weight:600">{word}</th>' for word in SOLVER_HEADINGS)
    body = "".join(
        f'<tr><td style="white-space:nowrap"><span style="color:{colours[i % len(colours)]}">■</span> '
        f"{escape(answers[i].solver)}</td>"
        + "".join(f'<td style="{look}" colspan="{span}">{text}</td>' for text, span in cells)
        + "</tr>"
        for i, cells in enumerate(rows)
    )
    legend = " ".join(f"{_dot(status)} {words}" for status, words in STATUS_WORDS.items())
    return (
        f'<div style="font-size:11px;margin:.2em .75em"><table style="width:100%"><tr>{head}</tr>{body}</table>'
        f'<div style="opacity:.8;margin:.3em 0">{legend}; in the picture, by the first solver. Errors, tensions '
        "and jumps are in N; jumps are from one problem to the next.</div></div>"
    )


def _solver_cells(each: Answer) -> list[tuple[str, int]]:
    """Return the cells of a solver after its name, and over how many columns each goes."""
    if each.now is None or each.study is None:
        return [(escape(each.problem), len(SOLVER_HEADINGS) - 1)]
    exact = each.study.counts()[Status.EXACT]
    tensions = each.now.tensions
    texts = (
        _dot(Status(int(each.now.status))),
        "0" if each.now.residual < ZERO else format_number(float(each.now.residual)),
        format_number(float(np.linalg.norm(tensions))),
        format_number(float(tensions.max())),
        format_duration(each.seconds),
        f"{exact}/{len(each.study.status)}",
        format_number(each.jump),
    )
    return [(text, 1) for text in texts]


def _dot(status: Status) -> str:
    return f'<span style="color:{STATUS_COLOURS[status]}" title="{STATUS_WORDS[status]}">●</span>'


def solver_bars(state: State, answers: Sequence[Answer], colours: Sequence[str]) -> str:
    """Return the tensions of solvers side by side, module by module, between zero and the largest limit."""
    known = [(i, each.now) for i, each in enumerate(answers) if each.now is not None]
    if not known:
        return ""
    most = float(state.rig.limits.upper.max()) or 1.0
    cells = []
    for number, module in enumerate(state.rig.modules):
        bars = "".join(
            f'<div style="height:5px;width:{100 * float(now.tensions[number]) / most:.2f}%;'
            f'background:{colours[i % len(colours)]}" title="{escape(answers[i].solver)} '
            f'{format_number(float(now.tensions[number]))} N"></div>'
            for i, now in known
        )
        left, width = 100 * module.lower / most, 100 * (module.upper - module.lower) / most
        limits = (
            f'<div style="position:absolute;left:{left:.2f}%;width:{width:.2f}%;height:100%;'
            'background:rgba(128,128,128,.2)"></div>'
        )
        cells.append(
            f'<div style="overflow:hidden;text-overflow:ellipsis;white-space:nowrap">{escape(module.name)}</div>'
            f'<div style="position:relative">{limits}<div style="position:relative">{bars}</div></div>'
        )
    key = " ".join(
        f'<span style="white-space:nowrap"><span style="color:{colours[i % len(colours)]}">■</span> '
        f"{escape(answers[i].solver)}</span>"
        for i, _ in known
    )
    grid = "display:grid;grid-template-columns:minmax(4em,8em) 1fr;gap:4px 8px;align-items:center"
    return f'<div style="font-size:12px;margin:.3em .75em">{key}<div style="{grid}">{"".join(cells)}</div></div>'


def space(task: LayoutTask | None, rig: Rig) -> str:
    """Return what a space file is about, as HTML."""
    if task is None:
        return note("With a space, anchors that are dragged stay on its walls, and layouts can be searched for.")
    names = ", ".join(surface.name for surface in task.space.surfaces)
    counts = " or ".join(map(str, task.space.counts))
    return note(f"{task.name}: {counts} modules on {names}. Score: {task.objective.describe(rig)}.")


def note(text: str) -> str:
    """Return a remark, as HTML."""
    return f'<div style="font-size:12px;opacity:.65;margin:.2em .75em">{escape(text)}</div>'
