"""What the page of a log says, as HTML: the time, the timeline, events, and another solver's answer."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from tensionlab.allocation import Allocation
from tensionlab.hardware.log.reader import Run
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREEN, GREY, ORANGE
from tensionlab.support.formatting import format_count, format_number
from tensionlab.viewer.instant import BESIDE_COLOUR
from tensionlab.viewer.live_words import DECIMALS, SMALL
from tensionlab.viewer.playback import Playback
from tensionlab.viewer.run_marks import KINDS, Band, Mark
from tensionlab.viewer.words import STATUS_WORDS, box, note, number, rows, vector

BINS = 400
"""Of the curves in the timeline: about as many as it has pixels."""
CURVES_PIXELS, ROW_PIXELS, TICKS_PIXELS = 46, 15, 12
"""Heights of the parts of the timeline."""
MIN_ERROR_N = 0.01
"""Between the desired wrench and the demanded one, from which on they are not the same."""
LISTED = 14
"""Events around the time that is shown."""


def heading(run: Run, state: Playback, index: int) -> str:
    """Return the status of the cycle that is shown, and where in the run it is."""
    status = Status(int(run.status[index]))
    colour = GREEN if status is Status.EXACT else ORANGE
    words = "the desired force is rendered" if status is Status.EXACT else STATUS_WORDS[status]
    word = status.name
    if status is Status.EXACT and not np.allclose(run.demanded[index], run.desired[index], atol=MIN_ERROR_N):
        words = "what the loop can render stably of the desired force is rendered"
    if not np.isfinite(run.desired[index]).all():
        colour, word, words = GREY, "NO FORCE", "no force is desired: all cables are at their lower limits"
    elif run.fallback_used[index]:
        colour, words = ORANGE, f"{run.setup.solver} left it unproven: newton's answer was sent"
    where = f"{state.time:.2f} s of {state.end:.2f} s, cycle {run.cycle[index]} at {run.setup.rate:g} Hz"
    cut = "" if run.complete else "<br>cut off: the log was never closed, so its last moments may be missing"
    return box(colour, word, f"{words}<br>{where}, {escape(run.setup.solver)}{cut}")


def timeline(state: Playback, shown: Sequence[Mark], bands: Sequence[Band], curves: str) -> str:
    """Return the run over time: phases, sizes of forces, marks of events, and the time that is shown."""
    span = max(state.end - state.begin, 1e-9)

    def at(time: float) -> float:
        return 100.0 * min(max((time - state.begin) / span, 0.0), 1.0)

    phases = "".join(
        f'<div style="position:absolute;left:{at(band.begin):.2f}%;top:{band.row * ROW_PIXELS}px;'
        f"width:calc({at(band.end) - at(band.begin):.2f}% - 2px);height:{ROW_PIXELS - 2}px;padding-left:3px;"
        "background:rgba(128,128,128,.22);border-radius:2px;overflow:hidden;box-sizing:border-box;"
        f'white-space:nowrap;text-overflow:ellipsis">{escape(band.name)}</div>'
        for band in bands
    )
    height = ROW_PIXELS * (1 + max((band.row for band in bands), default=-1))
    ticks = "".join(
        f'<div style="position:absolute;left:calc({at(mark.time):.2f}% - 1px);width:2px;height:{TICKS_PIXELS}px;'
        f'background:{KINDS[mark.kind]}"></div>'
        for mark in shown
    )
    cursor = (
        f'<div style="position:absolute;left:calc({at(state.time):.3f}% - 1px);top:0;bottom:0;width:2px;'
        'background:currentColor"></div>'
    )
    return (
        f'<div style="position:relative;margin:.3em .75em 0">'
        f'<div style="position:relative;height:{height}px;font-size:10px">{phases}</div>{curves}'
        f'<div style="position:relative;height:{TICKS_PIXELS}px">{ticks}</div>{cursor}</div>'
    )


def curves(run: Run) -> str:
    """Return the sizes of the desired and of the measured force over time, as SVG, each in a part of `BINS`."""
    d = run.rig.dimension
    measured = np.linalg.norm(run.structure[:, :d] @ np.nan_to_num(run.measured)[..., None], axis=(1, 2))
    sizes = {"desired": np.linalg.norm(run.desired[:, :d], axis=1), "measured": measured}
    most = max((float(np.nanmax(each)) for each in sizes.values() if np.isfinite(each).any()), default=0.0) or 1.0
    lines = "".join(
        f'<path d="{_path(run.time, each / most)}" fill="none" stroke="{FORCE_COLOURS[name]}" stroke-width="1.2" '
        'vector-effect="non-scaling-stroke"/>'
        for name, each in sizes.items()
    )
    legend = " ".join(f'<span style="color:{FORCE_COLOURS[name]}">■</span> {name}' for name in sizes)
    return (
        f'<svg viewBox="0 0 1 1" preserveAspectRatio="none" style="display:block;width:100%;'
        f'height:{CURVES_PIXELS}px;background:rgba(128,128,128,.08)">{lines}</svg>'
        f'<div style="position:absolute;right:0;margin-top:-{CURVES_PIXELS}px;font-size:10px;opacity:.8;'
        f'padding:1px 4px">{legend} force, up to {format_number(most)} N</div>'
    )


def _path(time: Floats, share: Floats) -> str:
    """Return a line through the largest share (K,) in each part of the time, broken where there is none."""
    span = max(float(time[-1] - time[0]), 1e-9)
    part = np.minimum((BINS * (time - time[0]) / span).astype(np.int64), BINS - 1)
    most = np.full(BINS, -np.inf)
    known = np.isfinite(share)
    np.maximum.at(most, part[known], share[known])
    words, begun = [], False
    for index in np.unique(part).tolist():
        there = bool(np.isfinite(most[index]))
        if there:
            words.append(f"{'L' if begun else 'M'}{(index + 0.5) / BINS:.4f} {1.0 - 0.96 * most[index]:.3f}")
        begun = there
    return "".join(words)


def events(shown: Sequence[Mark], time: float) -> str:
    """Return the events around a time, the latest before it marked, as HTML."""
    if not shown:
        return note("There are none.")
    latest = sum(mark.time <= time + 1e-6 for mark in shown) - 1
    first = max(min(latest - LISTED // 2, len(shown) - LISTED), 0)
    cell = "padding-right:.8em;white-space:nowrap;vertical-align:top"
    lines = "".join(
        f'<tr style="{"background:rgba(128,128,128,.25)" if index == latest else ""}">'
        f'<td style="text-align:right;{cell}">{mark.time:.2f} s</td>'
        f'<td style="{cell};color:{KINDS[mark.kind]}"><b>{mark.kind}</b></td><td>{escape(mark.text)}</td></tr>'
        for index, mark in list(enumerate(shown))[first : first + LISTED]
    )
    more = len(shown) - LISTED
    last = f"; {format_count(more, 'event')} more" if more > 0 else ""
    return (
        f'<div style="{SMALL}"><table style="border-collapse:collapse">{lines}</table>'
        f'<div style="opacity:.65">those around {time:.2f} s{last}</div></div>'
    )


def answer(run: Run, index: int, solver: str, found: Allocation | None) -> str:
    """Return what was done in a cycle beside what another solver answers, None where no force was desired."""
    if found is None:
        return note("No force was desired: no solver was asked.")
    d = run.rig.dimension
    done = run.structure[index] @ np.nan_to_num(run.chosen[index])
    apart = found.wrench - done
    size = float(np.linalg.norm(apart[:d]))
    answers = (("the run", run.status[index], run.residual[index]), (solver, found.status, found.residual))
    lines = [
        (escape(who), STATUS_WORDS[Status(int(status))], f"error {number(round(float(residual), DECIMALS))} N")
        for who, status, residual in answers
    ]
    lines.append(("difference of force", f"{number(round(size, DECIMALS))} N", vector(np.round(apart, DECIMALS))))
    cells = ("module", run.setup.solver, "sent", solver, "difference")
    look = "text-align:right;padding:1px 0 1px 8px;white-space:nowrap"
    colours = ("", "", BLUE, BESIDE_COLOUR, "")
    head = "".join(
        f'<th style="{look if place else "text-align:left"};font-weight:600;'
        f'{f"border-bottom:2px solid {colour}" if colour else ""}">{escape(word)}</th>'
        for place, (word, colour) in enumerate(zip(cells, colours, strict=True))
    )
    body = ""
    for i, module in enumerate(run.rig.modules):
        chosen, sent, other = float(run.chosen[index, i]), float(run.commanded[index, i]), float(found.tensions[i])
        values = (
            format_number(chosen),
            format_number(sent),
            format_number(other),
            number(round(other - chosen, DECIMALS)),
        )
        if not np.isfinite(sent):  # a spring, or lost: no solver is asked for it
            values = ("–", "–", "–", "–")
        body += (
            f'<tr><td style="white-space:nowrap">{escape(module.name)}</td>'
            + "".join(f'<td style="{look}">{value}</td>' for value in values)
            + "</tr>"
        )
    return (
        f'{rows(lines)}<div style="{SMALL}"><table style="width:100%"><tr>{head}</tr>{body}</table>'
        '<div style="opacity:.65;margin-top:.3em">tensions in N: as chosen, as sent after the limit on their '
        "change, and as the other solver would choose them, at the same pose and limits; its marks in the bars "
        "and the arrow of its force are pink</div></div>"
    )
