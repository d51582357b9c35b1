"""A benchmark in four pictures: who is fast, who is accurate, whose worst case is bad, and whose tensions jump."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.benchmark.entries import WRAPPERS
from tensionlab.benchmark.report import newton as force
from tensionlab.benchmark.statistics import jumps, maximum, profile, quantile
from tensionlab.errors import ShapeError
from tensionlab.plots.accuracy import ACCURACY, LOOKS, SIZE, Dot, draw_dots, kind, say_kinds, short_name
from tensionlab.plots.style import BLUE, add_legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.arrays import Floats
    from tensionlab.benchmark.results import Results, Row

SLOWEST = 1e4
"""Ratios above are not drawn."""
COLUMNS = 4
"""Small pictures beside each other."""


def plot_profile(results: Results, path: str | Path) -> None:
    """Draw for which share of the problems each contestant is within so many times the fastest.

    Dolan and Moré's performance profile, over all sets within reach, of answers to 1e-6 N. One small picture for
    each solver, with newton and, in grey, all the others.
    """
    lines = _pooled(results)
    labels = list(lines)
    seconds = np.column_stack([lines[label].seconds for label in labels])
    solved = np.column_stack([lines[label].error <= ACCURACY for label in labels])
    ratios = dict(zip(labels, profile(seconds, solved, np.isfinite(seconds)), strict=True))
    panels = list(dict.fromkeys(lines[label].name for label in labels))

    def draw(axes: Axes, name: str) -> None:
        for label, own in ratios.items():
            if not own.size:
                continue
            mine, newton = lines[label].name == name, lines[label].kind == "newton"
            colour = LOOKS[lines[label].kind][1] if mine or newton else "#D8D8D8"
            width, front = (1.8, 3) if mine else (1.1, 2 if newton else 1)
            reached = own[np.isfinite(own)]
            x = np.concatenate([[1.0], reached, [SLOWEST]])
            y = np.append(np.arange(len(reached) + 1), len(reached)) / len(own)
            axes.step(x, y, where="post", color=colour, linewidth=width, zorder=front)
        axes.set(xscale="log", xlim=(1, SLOWEST), ylim=(0, 1.03), title=name)

    with new_figure(path, (9.0, 0.9 + 1.75 * -(-len(panels) // COLUMNS))) as figure:
        _grid(figure, panels, draw, "time / fastest time", "share of problems")
        say_kinds(figure, [lines[label].kind for label in labels], marked=False)


def plot_accuracy(results: Results, path: str | Path) -> None:
    """Draw how long each contestant takes and how accurate it is, over all sets within reach.

    Across: the median call. Up: the error that 99 % of its answers do not exceed, of the wrench and the limits.
    A line leads from a peer's default settings to its tight ones.
    """
    dots = []
    for line in _pooled(results).values():
        error = quantile(np.where(np.isfinite(line.seconds), line.error, np.nan), 0.99)
        time = quantile(line.seconds, 0.5)
        dots.append(Dot(line.name, line.kind, time, error if line.missing <= 0.01 else np.inf))
    words = "median time of a call (µs)", "error that 99 % of the answers keep (N)"
    with new_figure(path, SIZE) as figure:
        draw_dots(figure, dots, *words)


def plot_worst(results: Results, path: str | Path) -> None:
    """Draw the median, the 99.9 % quantile and the worst time of each contestant, over all sets within reach."""
    lines = sorted(_pooled(results).values(), key=lambda line: quantile(line.seconds, 0.999))
    with new_figure(path, (7.5, 1.3 + 0.22 * len(lines))) as figure:
        axes = figure.add_subplot()
        for place, line in enumerate(lines):
            median, slow = (1e6 * quantile(line.seconds, share) for share in (0.5, 0.999))
            worst = 1e6 * float(np.nanmax(line.seconds))
            _, colour, marker = LOOKS[line.kind]
            axes.plot([median, worst], [place, place], color=colour, linewidth=0.9)
            axes.plot(
                [median, slow], [place, place], color=colour, linewidth=4.5, solid_capstyle="butt", alpha=0.45
            )
            axes.plot(median, place, marker=marker, color=colour, markersize=5.5)
            axes.plot(worst, place, marker="|", color=colour, markersize=8, markeredgewidth=1.6)
        axes.set_yticks(range(len(lines)), [line.label for line in lines])
        axes.set_ylim(len(lines) - 0.4, -0.6)
        axes.set(xscale="log", xlabel="time of a call (µs): median, 99.9 % (bar), worst (tick)")
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x")
        say_kinds(figure, [line.kind for line in lines])


def plot_continuity(results: Results, path: str | Path) -> None:
    """Draw the tensions of all cables along the first trajectory of the results, one small picture a solver.

    Peers are drawn at their defaults. A gap is where there is no answer.

    Raises
    ------
    ShapeError
        If there is no trajectory in the results.
    """
    rows = [row for row in results.rows if row.path_mm and row.setting != "tight" and _drawable(row)]
    if not rows:
        raise ShapeError("no trajectory in these results; measure the set `trajectory`")
    alone = [row.nearest is None or sum(other.label == row.label for other in rows) == 1 for row in rows]
    names = [
        short_name(row.label).removesuffix(", default") + ("" if single else f", {row.nearest}")
        for row, single in zip(rows, alone, strict=True)
    ]
    panels = dict(zip(names, rows, strict=True))
    highest = max(float(np.nanmax(row.path_tensions)) for row in rows)

    def draw(axes: Axes, name: str) -> None:
        row = panels[name]
        way, reachable = np.array(row.path_mm), np.array(row.path_reachable)
        tensions = np.array(row.path_tensions).reshape(len(way), -1)
        axes.fill_between(way, 0, 2 * highest, where=~reachable, color="#EEEEEE", linewidth=0, step="mid")
        axes.plot(way, tensions, linewidth=1.0)
        axes.set(xlim=(way[0], way[-1]), ylim=(0, 1.05 * highest))
        axes.set_title(name, fontsize=8.5, pad=14)
        jump = f"largest jump {force(maximum(jumps(tensions, way)))} N/mm"
        axes.text(0.0, 1.04, jump, transform=axes.transAxes, fontsize=8, color="#555555")

    with new_figure(path, (9.5, 0.7 + 1.6 * -(-len(panels) // COLUMNS))) as figure:
        _grid(figure, list(panels), draw, "path (mm)", "tension (N)")
        add_legend(figure, 2, [
            ("a cable each", {"color": BLUE, "linewidth": 1.0}),
            ("out of reach", {"color": "#EEEEEE", "linewidth": 8}),
        ])  # fmt: skip


def _drawable(row: Row) -> bool:
    """Whether there are tensions along the trajectory that no other picture shows."""
    alone = row.solver.partition(":")[0] not in WRAPPERS or row.setting != "proved"
    return alone and bool(np.isfinite(row.path_tensions).any())


class _Line:
    """One contestant over the problems of all sets within reach: times, errors, how often it had no answer."""

    def __init__(self, rows: Sequence[Row]) -> None:
        first = rows[0]
        self.label = short_name(first.label)
        self.name = self.label.partition(",")[0]
        self.kind = kind(first)
        self.seconds: Floats = np.concatenate([np.array(row.call_s) for row in rows])
        errors = [np.maximum(row.errors, row.violations) for row in rows]
        self.error: Floats = np.concatenate(errors)
        tried = sum(row.tried for row in rows)
        self.missing = sum(row.refused + row.failed for row in rows) / max(1, tried)


def _pooled(results: Results) -> dict[str, _Line]:
    """Those who answered anything in the sets within reach (or, without any such set, in all)."""
    names = [name for name, about in results.sets.items() if about["reachable"] == "all"] or list(results.sets)
    rows: dict[str, dict[str, Row]] = {}
    for row in results.rows:
        if row.problem_set in names and row.call_s:
            rows.setdefault(short_name(row.label), {}).setdefault(row.problem_set, row)
    there = {label: list(each.values()) for label, each in rows.items() if len(each) == len(names)}
    lines = {label: _Line(each) for label, each in there.items()}
    drawn = {label: line for label, line in lines.items() if np.isfinite(line.seconds).any()}
    if not drawn:
        raise ShapeError("no answers in these results that could be drawn")
    return drawn


def _grid(figure: Any, names: Sequence[str], draw: Callable[[Axes, str], None], across: str, up: str) -> None:
    """Small pictures of one scale, the axes named once."""
    count = -(-len(names) // COLUMNS)
    grid = figure.subplots(count, COLUMNS, sharex=True, sharey=True, squeeze=False)
    for place, axes in enumerate(grid.flat):
        if place >= len(names):
            axes.set_visible(False)
            continue
        draw(axes, names[place])
        axes.grid()
        if place + COLUMNS >= len(names):
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(across)
        if place % COLUMNS == 0:
            axes.set_ylabel(up)
