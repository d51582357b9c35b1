"""Before and after a search for a layout: where the modules stand, and what that does to the target."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.field import Field, read_field
from tensionlab.plots.style import ORANGE, add_legend, new_figure
from tensionlab.plots.workspace import SLICE_LEGEND, draw_shares, draw_volume

if TYPE_CHECKING:
    import xarray


def plot_layouts(around: xarray.Dataset, target: xarray.Dataset, path: str | Path, level: float) -> None:
    """Draw rigs side by side: what is within reach around a target, and the curves for the target itself.

    Parameters
    ----------
    around, target : Dataset
        The same rigs and the same measure, from `tensionlab.sweep`: over a grid of all that is drawn, and over one
        of the target alone.
    path : path
        The suffix chooses the format: png, pdf or svg.
    level : float
        The volume above it is drawn.
    """
    wide, narrow = read_field(around), read_field(target)
    count = len(wide.names)
    with new_figure(path, (4.4 * count + 4.8, 4.9)) as figure:
        widths = [1.0] * count + [0.95]
        grid: Any = figure.add_gridspec(1, count + 1, width_ratios=widths)
        for number, name in enumerate(wide.names):
            axes: Any = figure.add_subplot(grid[number], projection="3d")
            draw_volume(axes, wide, number, level)
            _draw_box(axes, narrow)
            axes.set_title(name, fontsize="medium")
        curves: Any = figure.add_subplot(grid[count])
        draw_shares(curves, narrow)
        curves.set_ylabel("share of the target (%)")
        curves.legend()
        figure.suptitle(f"{wide.label} above {level:g}, and in the target", fontsize="medium")
        target_look: tuple[str, dict[str, Any]] = ("target", {"color": ORANGE, "linewidth": 1.4})
        add_legend(figure, 3, [*SLICE_LEGEND[:2], target_look])


def _draw_box(axes: Any, field: Field) -> None:
    """Draw the twelve edges of the grid's box."""
    ends = [(axis[0], axis[-1]) for axis in field.axes.values()]
    corners = np.array(list(product(*ends)))
    for a, b in product(range(8), repeat=2):
        if a < b and np.count_nonzero(corners[a] != corners[b]) == 1:
            axes.plot(*zip(corners[a], corners[b], strict=True), color=ORANGE, linewidth=1.4)
