"""How long solvers take against how accurate they are: of a run with all of its evidence, or of its summary."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.plots.labels import label_points
from tensionlab.plots.style import BLUE, GREEN, GREY, ORANGE, RED, add_legend, new_figure

if TYPE_CHECKING:
    from tensionlab.benchmark.results import Results, Row

ACCURACY = 1e-6
"""An answer counts as one from here on, in N, as the interface judges."""
FLOOR = 1e-16
"""Errors below are drawn here, in N: rounding."""
NO_ANSWER = 1e3
"""Where a contestant is drawn, in N, whose errors are larger, or that gave too few answers."""
SIZE = (8.0, 6.2)
"""Of the picture, in inches."""
LOOKS = {
    "newton": ("newton", BLUE, "o"),
    "house": ("tensionlab, others", GREEN, "s"),
    "default": ("peer, default settings", ORANGE, "o"),
    "tight": ("peer, tight settings", RED, "D"),
}
"""Name, colour and marker of each kind of contestant."""


class Dot(NamedTuple):
    """A contestant: its name, its kind in `LOOKS`, its time in s and its error in N (infinite: no answer)."""

    name: str
    kind: str
    time: float
    error: float


def plot_summary(results: Results, path: str | Path) -> None:
    """Draw how long each contestant takes and how wrong it is at worst, in the sets within reach.

    Needs no evidence for single problems. Across: the median call, as the geometric mean over the sets. Up: the
    largest error of all, of the wrench or the limits. Those that did not answer all problems are at the top.
    """
    sets = [name for name, about in results.sets.items() if about["reachable"] == "all"]
    rows: dict[str, dict[str, Row]] = {}
    for row in results.rows:
        if row.problem_set in sets and np.isfinite(row.median_s):
            rows.setdefault(row.label, {}).setdefault(row.problem_set, row)
    dots = []
    for label, each in rows.items():
        if len(each) < len(sets):
            continue
        answered = all(row.refused + row.failed == 0 for row in each.values())
        error = max(max(row.error_max, row.violation_max) for row in each.values())
        time = float(np.exp(np.mean([np.log(row.median_s) for row in each.values()])))
        first = next(iter(each.values()))
        name = short_name(label).partition(",")[0]
        dots.append(Dot(name, kind(first), time, error if answered else np.inf))
    with new_figure(path, SIZE) as figure:
        draw_dots(figure, dots, "typical time of a call (µs)", "largest error of all answers (N)")


def draw_dots(figure: Any, dots: Sequence[Dot], across: str, up: str) -> None:
    """Draw contestants as dots with names; a line leads from a peer's default settings to its tight ones."""
    axes = figure.add_subplot()
    points: dict[str, list[tuple[float, float]]] = {}
    for name, look, time, error in dots:
        place = (1e6 * time, NO_ANSWER if not error <= NO_ANSWER else max(error, FLOOR))
        _, colour, marker = LOOKS[look]
        axes.plot(*place, marker=marker, color=colour, linestyle="", markersize=6.5, zorder=3)
        points.setdefault(name, []).append(place)
    for ends in points.values():
        axes.plot(*zip(*ends, strict=True), color="#BBBBBB", linewidth=1.0, zorder=2)
    axes.axhline(ACCURACY, color=GREY, linewidth=0.8, linestyle=":", zorder=1)
    axes.annotate("exact from here on down", (0, ACCURACY), xycoords=("axes fraction", "data"), xytext=(3, -3),
                  textcoords="offset points", va="top", fontsize=8, color=GREY)  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel=across, ylim=(FLOOR, 10 * NO_ANSWER), ylabel=up)
    ticks = 10.0 ** np.arange(-15, 1, 3)
    powers = [f"$10^{{{round(np.log10(tick))}}}$" for tick in ticks]
    axes.set_yticks([*ticks, NO_ANSWER], [*powers, "over $10^3$,\nor none"], parse_math=True)
    axes.minorticks_off()
    axes.grid()
    times = [time for ends in points.values() for time, _ in ends]
    axes.set_xlim(min(times) / 1.6, 1.6 * max(times))
    ticks = np.outer(10.0 ** np.arange(-1, 7), [1, 2, 5]).ravel()
    ticks = ticks[(ticks > min(times) / 1.6) & (ticks < 1.6 * max(times))]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    say_kinds(figure, [dot.kind for dot in dots])
    label_points(figure, axes, points)


def say_kinds(figure: Any, kinds: Sequence[str], marked: bool = True) -> None:
    """Say which colour is which kind of contestant."""
    shown = [LOOKS[kind] for kind in LOOKS if kind in kinds]
    add_legend(figure, len(shown), [
        (name, {"color": colour, "marker": marker, "ls": ""} if marked else {"color": colour, "linewidth": 1.8})
        for name, colour, marker in shown
    ])  # fmt: skip


def kind(row: Row) -> str:
    """Of which kind in `LOOKS` is a contestant?"""
    return row.setting if row.setting != "proved" else "newton" if row.solver == "newton" else "house"


def short_name(label: str) -> str:
    """What is a contestant called in pictures? Peers without qpsolvers, but for the one that is there twice."""
    short = label.removeprefix("qpsolvers:")
    return short.replace("daqp", "daqp (qpsolvers)") if short != label else short
