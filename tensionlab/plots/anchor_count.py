"""What the number of modules buys, in one picture: slices of published rigs and of a room, and the curves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensionlab.plots.field import read_field
from tensionlab.plots.style import add_legend, new_figure
from tensionlab.plots.workspace import SLICE_LEGEND, cut_title, draw_shares, draw_slice, shade_levels

if TYPE_CHECKING:
    import xarray


def plot_anchor_count(published: list[xarray.Dataset], room: xarray.Dataset, path: str | Path) -> None:
    """Draw slices of published rigs and of rigs in one room, and the force that each share of the room allows.

    Parameters
    ----------
    published : list of Dataset
        From `tensionlab.sweep`, one rig in each, with the same measure.
    room : Dataset
        Several rigs over the same grid.
    path : path
        The suffix chooses the format: png, pdf or svg.
    """
    singles, many = [read_field(swept) for swept in published], read_field(room)
    levels = shade_levels([*singles, many])
    with new_figure(path, (15.0, 9.4), dpi=105) as figure:
        parts: Any = figure.subfigures(3, 1, height_ratios=(1.15, 0.65, 0.9))
        top, middle, bottom = parts
        panels: Any = top.subplots(1, len(singles))
        top.suptitle(f"Published rigs, {cut_title(singles[0])}", fontsize="medium", fontweight="bold")
        for axes, field in zip(panels, singles, strict=True):
            shades = draw_slice(axes, field, 0, levels)
        top.colorbar(shades, ax=panels, label=many.label)
        rooms: Any = middle.subplots(1, len(many.names), sharey=True)
        middle.suptitle(f"One room, {cut_title(many)}", fontsize="medium", fontweight="bold")
        for number, axes in enumerate(rooms):
            draw_slice(axes, many, number, levels)
            axes.label_outer()
        middle.colorbar(shades, ax=rooms, label=many.label)
        curves: Any = bottom.subplots()
        draw_shares(curves, many)
        curves.legend(title="modules in the room")
        add_legend(figure, 3, SLICE_LEGEND)
