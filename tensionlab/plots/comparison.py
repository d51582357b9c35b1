"""Figure of a comparison of solvers on one rig: statuses, errors and times on a set of forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.style import HALO, add_legend, new_figure
from tensionlab.solvers import is_built_in
from tensionlab.solvers.base import TOLERANCE
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from tensionlab.support.table import STATUS_MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.benchmark.comparison import Comparison, Row

POLICY_LOOK = {
    "force": (BLUE, "o", -0.25),
    "tension": (ORANGE, "s", 0.0),
    "direction": (GREEN, "^", 0.25),
    None: (GREY, "D", 0.0),
}
"""Colour, marker and place within the solver's row."""

COUNTS = ("exact", "nearest_count", "unproven", "failed")
"""Of a row, by `STATUS_MARKS`."""
CABLE = "#C8C8C8"
MAX_DRAWN_FORCES = 200
"""Of a larger set, so many forces are drawn, evenly spread."""

MIN_ERROR_N = 1e-12
"""Errors below are drawn here: rounding, not a difference between solvers."""


def plot_comparison(comparison: Comparison) -> Figure:
    """Draw which forces a rig renders, and how accurate and how fast each solver is.

    Left: desired forces (blue circles) and the error of what the first row's solver rendered (red lines),
    between the directions of the cables. Right, a line per solver: statuses, largest error, largest angle
    error, time of a call. The names of those that do not come with tensionlab are purple.

    Parameters
    ----------
    comparison : Comparison
        From `tensionlab.compare`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> found = tl.compare(rig, directions=[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], solvers=["newton", "closed-form"])
    >>> figure = plots.plot_comparison(found)
    """
    rows, spatial = comparison.rows, comparison.rig.dimension == 3
    names = [*dict.fromkeys(row.solver for row in rows), *comparison.missing]
    alone = [sum(other.solver == row.solver for other in rows) == 1 for row in rows]
    lines = [
        names.index(row.solver) + (0.0 if single else POLICY_LOOK[row.policy][2])
        for row, single in zip(rows, alone, strict=True)
    ]
    count, size = len(comparison.wrenches), np.linalg.norm(comparison.wrenches[0])
    with new_figure((14.5, max(8.0 if spatial else 5.0, 2.0 + 0.42 * len(names)))) as figure:
        parts: Any = figure.subfigures(1, 2, width_ratios=[1.0, 2.5])
        left, right = parts
        policy = f", nearest in {rows[0].policy}" if rows[0].policy else ""
        left.suptitle(f"Rendered by {rows[0].solver}{policy}", fontweight="bold")
        views = [(0, 1), (0, 2)] if spatial else [(0, 1)]
        for axes, view in zip(np.atleast_1d(left.subplots(len(views), 1)), views, strict=True):
            _draw_forces(axes, comparison, view)
        add_legend(left, 3, [
            ("desired force", {"color": BLUE, "marker": "o", "fillstyle": "none", "ls": ""}),
            ("error", {"color": RED}),
            ("cable direction", {"color": CABLE, "linewidth": 1.6}),
        ])  # fmt: skip

        right.suptitle(
            f"{comparison.rig.name}: {count} forces of {size:.3g} N, by solver and policy", fontweight="bold"
        )
        panels = right.subplots(1, 4, sharey=True)
        panels[0].set_yticks(range(len(names)), names)
        for name, label in zip(names, panels[0].get_yticklabels(), strict=True):
            if not is_built_in(name):
                label.set(color=PURPLE, fontweight="bold")
        panels[0].set_ylim(max(len(names), 4) - 0.4, -0.6)
        _draw_statuses(panels[0], rows, lines)
        panels[0].set(xlabel="forces", xlim=(0, count))
        for name in comparison.missing:
            panels[0].text(0.02 * count, names.index(name), "left out", va="center", color=GREY, style="italic")
        errors = [max(row.residual_max, MIN_ERROR_N) for row in rows]
        _draw_points(panels[1], rows, lines, errors)
        panels[1].axvspan(MIN_ERROR_N / 10, TOLERANCE, color="#F2F2F2", zorder=0)
        panels[1].text(TOLERANCE / 2, -0.52, "exact", ha="right", va="top", color=GREY)
        panels[1].set(xscale="log", xlabel="max error (N)", xlim=(MIN_ERROR_N / 10, 10 * np.nanmax([1, *errors])))
        _draw_points(panels[2], rows, lines, [row.angle_max_deg for row in rows])
        # Linear below 1 degree: 0 and 180 degrees on one axis.
        panels[2].set_xscale("symlog", linthresh=1.0)
        panels[2].set(xlabel="max angle error (°)", xlim=(-0.15, 260))
        panels[2].set_xticks([0, 1, 10, 90], ["0", "1", "10", "90"])
        microseconds = [1e6 * row.call_median_s for row in rows]
        _draw_points(panels[3], rows, lines, microseconds)
        for row, line, median in zip(rows, lines, microseconds, strict=True):
            colour = POLICY_LOOK[row.policy][0]
            panels[3].plot([median, 1e6 * row.call_p99_s], [line, line], color=colour, linewidth=1.2)
            panels[3].plot(1e6 * row.batch_s, line, marker="|", color=colour, markersize=7, markeredgewidth=1.6)
        panels[3].set(xscale="log", xlabel="time of a call (µs)")
        for axes in panels:
            axes.tick_params(axis="y", length=0)
            axes.spines["left"].set_visible(False)
            axes.grid(axis="x")
            for border in range(1, len(names)):
                axes.axhline(border - 0.5, color="#DDDDDD", linewidth=0.8, zorder=1)
        add_legend(right, 5, [
            *(
                (mark.word, {"color": mark.colour, "linewidth": 6})
                for key, mark in zip(COUNTS, STATUS_MARKS, strict=True)
                if any(getattr(row, key) for row in rows)
            ),
            *(
                (f"nearest in {name}" if name else "no policy", {"color": colour, "marker": marker, "ls": ""})
                for name, (colour, marker, _) in POLICY_LOOK.items()
                if any(row.policy == name for row in rows)
            ),
            ("one call: median to 99 %", {"color": GREY, "marker": "o", "markevery": [0]}),
            ("each in a batch", {"color": GREY, "marker": "|", "ls": "", "mew": 1.6}),
        ])  # fmt: skip
    return figure


def _draw_forces(axes: Axes, comparison: Comparison, view: tuple[int, int]) -> None:
    """Draw desired forces, errors and cable directions, seen along the third axis."""
    rig = comparison.rig
    count = len(comparison.wrenches)
    shown = np.unique(np.linspace(0, count - 1, min(count, MAX_DRAWN_FORCES)).astype(int))
    wrenches = comparison.wrenches[shown]
    desired, rendered = wrenches[:, view], comparison.allocations[0].wrench[shown][:, view]
    reach = float(np.linalg.norm(wrenches, axis=1).max())
    labels: dict[tuple[int, int], list[str]] = {}
    for module, direction in zip(rig.modules, comparison.structure[list(view)].T, strict=True):
        length = float(np.linalg.norm(direction))
        # A cable that runs along the line of sight is a point; any other runs out of the cloud of forces.
        tip = direction * (1.25 * reach / length if length > 0.1 else 0.0)
        axes.plot([0, tip[0]], [0, tip[1]], color=CABLE, linewidth=1.6, zorder=1)
        x, y = (round(part) for part in 20 * tip / reach)
        labels.setdefault((x, y), []).append(module.name)
    for (x, y), together in labels.items():
        axes.annotate(
            ", ".join(together), (x * reach / 20, y * reach / 20), xytext=(0.2 * x, 0.2 * y or 9),
            textcoords="offset points", va="center" if abs(y) < 20 else "bottom" if y > 0 else "top",
            ha="center" if abs(x) < 8 else "left" if x > 0 else "right",
            color="#444444", fontsize=8.5, zorder=5, bbox=HALO,
        )  # fmt: skip
    near = np.full(len(desired), True)
    if rig.dimension == 3:
        near = wrenches[:, 3 - sum(view)] >= -1e-9 * reach
        axes.set_title("from the front (along −z)" if view == (0, 1) else "from above (along −y)")
    for half, alpha in ((~near, 0.4), (near, 1.0)):
        axes.plot(
            *desired[half].T, linestyle="", marker="o", markersize=4.2, fillstyle="none", color=BLUE,
            markeredgewidth=0.9, alpha=alpha, zorder=3,
        )  # fmt: skip
    missed = np.linalg.norm(rendered - desired, axis=1) > TOLERANCE
    for start, end in zip(desired[missed], rendered[missed], strict=True):
        axes.plot([start[0], end[0]], [start[1], end[1]], color=RED, linewidth=1.3, zorder=4)
    axes.set(aspect="equal", xlim=(-1.75 * reach, 1.75 * reach), ylim=(-1.5 * reach, 1.5 * reach))
    axes.set(xlabel=f"{'xyz'[view[0]]} (N)", ylabel=f"{'xyz'[view[1]]} (N)")
    axes.grid()
    if view == (0, 2):
        axes.invert_yaxis()  # seen from above, x points right and z towards the viewer's feet


def _draw_statuses(axes: Axes, rows: Sequence[Row], lines: Sequence[float]) -> None:
    """Draw the statuses of each row as a bar."""
    for row, line in zip(rows, lines, strict=True):
        start = 0
        for key, mark in zip(COUNTS, STATUS_MARKS, strict=True):
            axes.barh(line, getattr(row, key), left=start, height=0.2, color=mark.colour)
            start += getattr(row, key)


def _draw_points(axes: Axes, rows: Sequence[Row], lines: Sequence[float], values: Sequence[float]) -> None:
    """Draw one marker for each row."""
    for row, line, value in zip(rows, lines, values, strict=True):
        colour, marker, _ = POLICY_LOOK[row.policy]
        axes.plot(value, line, marker=marker, color=colour, markersize=5, linestyle="", zorder=3)
