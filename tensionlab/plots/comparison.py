"""Figures of a comparison of solvers: statuses, errors and times on a set of forces, or along a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.module import KINDS
from tensionlab.plots.style import CURVES, Entry, add_legend, curve_look, label_points, new_figure
from tensionlab.plots.validation import DESIRED, VIEWS, draw_forces
from tensionlab.solvers import is_built_in
from tensionlab.solvers.base import TOLERANCE, Status
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from tensionlab.support.table import STATUS_MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.benchmark.comparison import Comparison, Score
    from tensionlab.support.arrays import Floats

POLICY_LOOK = {
    "force": (BLUE, "o", -0.25),
    "tension": (ORANGE, "s", 0.0),
    "direction": (GREEN, "^", 0.25),
    None: (GREY, "D", 0.0),
}  # colour, marker and place within the solver's row
# Fields of a score with the number of wrenches of each `Status`.
COUNTS = ("exact", "nearest_count", "unproven", "failed")
CABLE = "#C8C8C8"
INFEASIBLE = "#EEEEEE"
MAX_DRAWN_FORCES = 200  # largest number of forces that are drawn, evenly spread
MAX_DRAWN_SOLVERS = 8  # largest number of solvers that are drawn along a trajectory
MIN_ERROR_N = 1e-12  # errors below are drawn here: rounding, not a difference between solvers


def plot_comparison(comparison: Comparison) -> Figure:
    """Draw how accurate, how fast and, along a trajectory, how smooth each solver of a comparison is.

    Of forces at one position, above: desired forces (blue circles) and the error of what the first row's solver
    rendered (red lines), between the directions of the cables. Below, a line per solver: statuses, largest error,
    time of a call. The names of those that do not come with tensionlab are purple.

    Along a trajectory, above: the tension of each module, a panel for each of the first `MAX_DRAWN_SOLVERS`
    solvers with its own policy; grey where the wrench is infeasible. Below: the error of each solver, and the
    largest step of its tensions from one sample to the next.
    """
    return _plot_trajectory(comparison) if comparison.along_trajectory else _plot_forces(comparison)


def _plot_forces(comparison: Comparison) -> Figure:
    rows, spatial = comparison.rows, comparison.rig.dimension == 3
    names = [*dict.fromkeys(row.solver for row in rows), *comparison.missing]
    heights = [4.2, 1.3 + 0.4 * max(len(names), 2)]
    with new_figure((9.6, 0.3 + sum(heights))) as figure:
        figure.suptitle(_forces_finding(comparison), fontweight="bold")
        above, below = figure.subfigures(2, 1, height_ratios=heights)  # type: ignore[misc]
        views = list(VIEWS)[: 1 + spatial]
        panels = np.atleast_1d(above.subplots(1, len(views)))
        tips = [_draw_forces(axes, comparison, view) for axes, view in zip(panels, views, strict=True)]
        policy = f", nearest in {rows[0].policy}" if rows[0].policy else ""
        add_legend(above, 3, [
            DESIRED,
            (f"error of {rows[0].solver}{policy}", {"color": RED}),
            ("cable direction", {"color": CABLE, "linewidth": 1.6}),
        ])  # fmt: skip
        _draw_solvers(below, comparison, names)
        add_legend(below, 5, _solver_legend(rows))
        for axes, names_at in zip(panels, tips, strict=True):
            label_points(figure, axes, names_at)
    return figure


def _forces_finding(comparison: Comparison) -> str:
    """Return the title: how many forces some solver renders exactly, and how many are proved impossible."""
    count, unit = len(comparison.wrenches), KINDS[comparison.rig.kind].force_unit
    size = f"{np.linalg.norm(comparison.wrenches[0]):.3g} {unit}"
    exact, impossible = (max(getattr(row, key) for row in comparison.rows) for key in COUNTS[:2])
    finding = f"{exact} exact" + (f", {impossible} proved impossible" if impossible else "")
    return f"{comparison.rig.name}, {count} forces of {size}: {finding}"


def _draw_solvers(part: Any, comparison: Comparison, names: Sequence[str]) -> None:
    """Draw statuses, errors and times, a line per solver."""
    rows, count = comparison.rows, len(comparison.wrenches)
    alone = [sum(other.solver == row.solver for other in rows) == 1 for row in rows]
    lines = [
        names.index(row.solver) + (0.0 if single else POLICY_LOOK[row.policy][2])
        for row, single in zip(rows, alone, strict=True)
    ]
    panels = part.subplots(1, 3, sharey=True)
    statuses, errors, times = panels
    statuses.set_yticks(range(len(names)), names)
    for name, label in zip(names, statuses.get_yticklabels(), strict=True):
        if not is_built_in(name):
            label.set(color=PURPLE, fontweight="bold")
    statuses.set_ylim(len(names) - 0.4, -0.6)
    for name in comparison.missing:
        statuses.text(0.02 * count, names.index(name), "left out", va="center", color=GREY, style="italic")
    largest = [max(row.residual_max, MIN_ERROR_N) for row in rows]
    for row, line, error in zip(rows, lines, largest, strict=True):
        start = 0
        for key, mark in zip(COUNTS, STATUS_MARKS, strict=True):
            statuses.barh(line, getattr(row, key), left=start, height=0.2, color=mark.colour)
            start += getattr(row, key)
        colour, marker, _ = POLICY_LOOK[row.policy]
        dot = {"marker": marker, "color": colour, "markersize": 5, "linestyle": "", "zorder": 3}
        errors.plot(error, line, **dot)
        times.plot(1e6 * row.call_median_s, line, **dot)
        times.plot(1e6 * np.array([row.call_median_s, row.call_p99_s]), [line, line], color=colour, linewidth=1.2)
        times.plot(1e6 * row.batch_s, line, marker="|", color=colour, markersize=7, markeredgewidth=1.6)
    errors.axvspan(MIN_ERROR_N / 10, TOLERANCE, color="#F2F2F2", zorder=0)
    errors.text(TOLERANCE / 2, -0.52, "exact", ha="right", va="top", color=GREY)
    statuses.set(xlabel="forces", xlim=(0, count))
    label = f"max error ({KINDS[comparison.rig.kind].force_unit})"
    errors.set(xscale="log", xlabel=label, xlim=(MIN_ERROR_N / 10, 10 * np.nanmax([1, *largest])))
    times.set(xscale="log", xlabel="time of a call (µs)")
    for axes in panels:
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x")
        for border in range(1, len(names)):
            axes.axhline(border - 0.5, color="#DDDDDD", linewidth=0.8, zorder=1)


def _solver_legend(rows: Sequence[Score]) -> list[Entry]:
    """Return the entries for the statuses and policies that occur, and for times."""
    statuses: list[Entry] = [
        (mark.word, {"color": mark.colour, "linewidth": 6})
        for key, mark in zip(COUNTS, STATUS_MARKS, strict=True)
        if any(getattr(row, key) for row in rows)
    ]
    policies: list[Entry] = [
        (f"nearest in {name}" if name else "no policy", {"color": colour, "marker": marker, "ls": ""})
        for name, (colour, marker, _) in POLICY_LOOK.items()
        if any(row.policy == name for row in rows)
    ]
    return [
        *statuses,
        *policies,
        ("one call: median to 99 %", {"color": GREY, "marker": "o", "markevery": [0]}),
        ("each in a batch", {"color": GREY, "marker": "|", "ls": "", "mew": 1.6}),
    ]


def _draw_forces(
    axes: Axes, comparison: Comparison, view: tuple[int, int]
) -> dict[str, list[tuple[float, float]]]:
    """Draw desired forces, errors and cable directions, seen along the third axis; return where cables end."""
    rig = comparison.rig
    count = len(comparison.wrenches)
    shown = np.unique(np.linspace(0, count - 1, min(count, MAX_DRAWN_FORCES)).astype(int))
    wrenches = comparison.wrenches[shown]
    reach = float(np.linalg.norm(wrenches, axis=1).max())
    tips = {"": [tuple(place) for place in wrenches[:, view]]}
    for module, direction in zip(rig.modules, comparison.structure[list(view)].T, strict=True):
        length = float(np.linalg.norm(direction))
        # A cable that runs along the line of sight is a point; any other runs out of the cloud of forces.
        tip = direction * (1.25 * reach / length if length > 0.1 else 0.0)
        axes.plot([0, tip[0]], [0, tip[1]], color=CABLE, linewidth=1.6, zorder=1)
        tips[module.name] = [(float(tip[0]), float(tip[1]))]
    missed = comparison.allocations[0].residual[shown] > TOLERANCE
    rendered = np.where(missed[:, None], comparison.allocations[0].wrench[shown], np.nan)
    draw_forces(axes, wrenches, rendered, view)
    axes.set(xlim=(-1.75 * reach, 1.75 * reach), ylim=(-1.5 * reach, 1.5 * reach))
    if view == (0, 2):
        axes.invert_yaxis()
    return tips


def _plot_trajectory(comparison: Comparison) -> Figure:
    drawn = dict(list(comparison.own_policies.items())[:MAX_DRAWN_SOLVERS])
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(comparison.position, axis=0), axis=1)))
    label = "length of the path (m)"
    if comparison.times is not None:
        length, label = comparison.times, "time (s)"
    elif not length[-1]:
        length, label = np.arange(len(length), dtype=np.float64), "sample"
    infeasible = np.any([allocation.status == Status.NEAREST for allocation in comparison.allocations], axis=0)
    columns = 1 if len(drawn) == 1 else 2
    count = -(-len(drawn) // columns)
    with new_figure((12.0, 1.0 + 1.9 * count + 4.2)) as figure:
        figure.suptitle(_finding(comparison, list(drawn.values())), fontweight="bold")
        above, below = figure.subfigures(2, 1, height_ratios=[0.6 + 1.9 * count, 4.2])  # type: ignore[misc]
        panels: Any = above.subplots(count, columns, sharex=True, sharey=True, squeeze=False)
        for axes in panels.flat[len(drawn) :]:
            axes.set_visible(False)
        for index, (axes, (name, number)) in enumerate(zip(panels.flat, drawn.items(), strict=False)):
            _draw_tensions(axes, comparison, number, length, infeasible)
            policy = comparison.rows[number].policy
            title = f"{name}, nearest in {policy}" if policy and infeasible.any() else name
            axes.set_title(title, color=CURVES[index % len(CURVES)])
        for axes in panels[:, 0]:
            axes.set_ylabel("tension (N)")
        add_legend(above, 6, [
            *((module.name, _line(index)) for index, module in enumerate(comparison.rig.modules)),
            ("limits", {"color": GREY, "linestyle": "--", "linewidth": 0.9}),
            *([("infeasible", {"color": INFEASIBLE, "linewidth": 8})] if infeasible.any() else []),
        ])  # fmt: skip
        error, step = below.subplots(2, 1, sharex=True)
        for index, number in enumerate(drawn.values()):
            allocation = comparison.allocations[number]
            error.plot(length, np.fmax(allocation.residual, MIN_ERROR_N), **_line(index))
            step.plot(length[1:], np.abs(np.diff(allocation.tensions, axis=0)).max(axis=1), **_line(index))
        error.axhspan(MIN_ERROR_N / 10, TOLERANCE, color="#F2F2F2", zorder=0)
        error.text(length[0], TOLERANCE, " exact", va="top", color=GREY, fontsize=8)
        error.set(yscale="log", ylabel="error (N)", ylim=(MIN_ERROR_N / 3, None))
        step.set(xlabel=label, ylabel="step of a tension (N)", xlim=(length[0], length[-1]), ylim=(0.0, None))
        for axes in (error, step):
            axes.grid()
        add_legend(below, 4, [(name, _line(index)) for index, name in enumerate(drawn)])
    return figure


def _finding(comparison: Comparison, drawn: Sequence[int]) -> str:
    """Return the title: which share of the trajectory is rendered, and who jumps."""
    rows = [comparison.rows[number] for number in drawn]
    exact = max(rows, key=lambda row: row.exact)
    finding = f"{comparison.title}, of which {exact.solver} renders {exact.exact}"
    jumps = dict.fromkeys(f"{row.solver} by {row.jump:.2g} N" for row in rows if row.jump > 0.0)
    finding += f"\n{'jumps while feasible: ' + ', '.join(jumps) if jumps else 'no jumps while feasible'}"
    return finding


def _line(index: int) -> dict[str, Any]:
    """Return the look of one of several curves."""
    return {**curve_look(index), "linewidth": 1.3}


def _draw_tensions(axes: Axes, comparison: Comparison, number: int, length: Floats, infeasible: Any) -> None:
    """Draw the tension of each module along a trajectory, between the limits."""
    rig, tensions = comparison.rig, comparison.allocations[number].tensions
    top = 1.08 * float(np.nanmax(tensions, initial=float(rig.limits.upper.max())))
    axes.fill_between(length, 0.0, top, where=infeasible, color=INFEASIBLE, linewidth=0, step="mid", zorder=0)
    for limit in np.unique([rig.limits.lower, rig.limits.upper]):
        axes.axhline(limit, color=GREY, linestyle="--", linewidth=0.9, zorder=1)
    for index, line in enumerate(tensions.T):
        axes.plot(length, line, **_line(index))
    axes.set(xlim=(length[0], length[-1]), ylim=(0.0, top))
    axes.grid()
