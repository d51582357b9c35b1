"""Where, and how well, rigs can pull: slices, the volume within reach, and force against share of volume.

All are drawn from what `tensionlab.sweep` returns over a grid.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError
from tensionlab.plots.field import Field, read_field
from tensionlab.plots.style import BLUE, GREEN, GREY, ORANGE, RED, add_legend, new_figure
from tensionlab.plots.surface import level_surface

if TYPE_CHECKING:
    import xarray

NONE = "#E4E4E4"
"""Where a value is zero or less."""
PANEL = 3.3
"""Width of a panel, in inches."""
COLUMNS = 4
"""Panels in a row, at most."""
CURVES = (BLUE, ORANGE, GREEN, RED, "#CC79A7", "#56B4E9", "#000000", "#B8860B")
DASHES = ("-", "--", ":")
SLICE_LEGEND: list[tuple[str, dict[str, Any]]] = [
    ("module", {"color": BLUE, "marker": "s", "ls": ""}),
    ("cable at home", {"color": GREY, "linewidth": 0.8}),
    ("zero or less", {"color": NONE, "marker": "s", "markersize": 9, "ls": ""}),
]


def plot_slices(swept: xarray.Dataset, path: str | Path, measure: str | None = None) -> None:
    """Draw a measure over a slice of space for each rig, with the rig in it.

    In space the slice is the one that the grid is, where one axis has one point only; else the upright one through
    the middle.

    Parameters
    ----------
    swept : Dataset
        From `tensionlab.sweep` over a grid.
    path : path
        The suffix chooses the format: png, pdf or svg.
    measure : str or None
        Name of the variable; None for the first.

    Raises
    ------
    ShapeError
        If there is no such variable or no grid, or the suffix is no such format.
    """
    field = read_field(swept, measure)
    columns = min(COLUMNS, len(field.names))
    rows = -(-len(field.names) // columns)
    levels = shade_levels([field])
    with new_figure(path, (1.6 + PANEL * columns, 1.0 + _height(field) * rows)) as figure:
        grid: Any = figure.subplots(rows, columns, squeeze=False)
        for axes in grid.flat[len(field.names) :]:
            axes.set_axis_off()
        for number, axes in zip(range(len(field.names)), grid.flat, strict=False):
            shades = draw_slice(axes, field, number, levels)
        figure.colorbar(shades, ax=grid, shrink=0.85, label=field.label)
        if title := cut_title(field):
            figure.suptitle(title, fontsize="medium")
        add_legend(figure, 3, SLICE_LEGEND)


def plot_measures(swept: xarray.Dataset, path: str | Path) -> None:
    """Draw every measure of a sweep, a row each, over a slice of space for each rig, a column each.

    Parameters and errors as in `plot_slices`.
    """
    fields = [read_field(swept, str(name)) for name in swept.data_vars]
    rigs = len(fields[0].names)
    with new_figure(path, (1.6 + PANEL * rigs, 1.0 + (_height(fields[0]) - 0.3) * len(fields))) as figure:
        grid: Any = figure.subplots(len(fields), rigs, squeeze=False, sharex=True, sharey=True)
        for row, field in zip(grid, fields, strict=True):
            levels = shade_levels([field])
            for number, axes in enumerate(row):
                shades = draw_slice(axes, field, number, levels)
                axes.label_outer()
            figure.colorbar(shades, ax=row, shrink=0.85, label=field.label)
        if title := cut_title(fields[0]):
            figure.suptitle(title, fontsize="medium")
        add_legend(figure, 3, SLICE_LEGEND)


def draw_slice(axes: Any, field: Field, number: int, levels: Floats) -> Any:
    """Draw a measure over the slice of one rig, and the rig. Returns the shades, for the colour bar."""
    names, middle = list(field.axes), _middle(field)
    across, along, cut = _plane(field)
    picture = field.values[number]
    if cut is not None:
        picture = picture.take(middle[cut], axis=names.index(cut))
    picture = np.nan_to_num(picture if names.index(along) < names.index(across) else picture.T, nan=0.0)
    x, y = field.axes[across], field.axes[along]
    if min(len(x), len(y)) < 2:
        raise ShapeError(f"a slice needs two positions or more along {across} and {along}; give a smaller step")
    axes.fill_between([x[0], x[-1]], y[0], y[-1], color=NONE, linewidth=0)
    shades = axes.contourf(x, y, picture, levels=levels, cmap="viridis", extend="max")
    if (picture > 0).any():
        axes.contour(x, y, picture, levels=levels[:1], colors="black", linewidths=0.8)
    shown = [names.index(across), names.index(along)]
    anchors = field.anchors[number][:, shown]
    for anchor, end in zip(anchors, field.ends[number][:, shown], strict=True):
        axes.plot(*zip(anchor, end, strict=True), color="white", linewidth=2.0, alpha=0.6)
        axes.plot(*zip(anchor, end, strict=True), color=GREY, linewidth=0.8)
    axes.plot(*anchors.T, linestyle="", marker="s", markersize=5, color=BLUE, clip_on=False)
    axes.set(xlabel=f"{across} (m)", ylabel=f"{along} (m)", aspect="equal")
    axes.set_title(field.names[number], fontsize="medium")
    return shades


def cut_title(field: Field) -> str:
    """Where the slices cut; nothing in the plane."""
    cut = _plane(field)[2]
    return "" if cut is None else f"{cut} = {np.round(field.axes[cut][_middle(field)[cut]], 9) + 0.0:.4g} m"


def shade_levels(fields: list[Field]) -> Floats:
    """Round steps from nothing to the largest value of all."""
    from matplotlib.ticker import MaxNLocator

    top = max(float(np.nanmax(field.values, initial=0.0)) for field in fields) or 1.0
    steps = np.asarray(MaxNLocator(nbins=9, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, top))
    return np.asarray([1e-9 * top, *steps[steps > 1e-6 * top]])


def plot_volume(swept: xarray.Dataset, path: str | Path, level: float = 0.0, measure: str | None = None) -> None:
    """Draw, for each rig, the volume in which a measure is above a level.

    Parameters and errors as in `plot_slices`; also a `ShapeError` for a sweep that is not over a grid in space.
    """
    field = read_field(swept, measure)
    columns = min(3, len(field.names))
    rows = -(-len(field.names) // columns)
    with new_figure(path, (4.6 * columns, 0.8 + 4.2 * rows)) as figure:
        for number, name in enumerate(field.names):
            axes: Any = figure.add_subplot(rows, columns, number + 1, projection="3d")
            draw_volume(axes, field, number, level)
            part = share_above(field.values[number], np.array([level]))[0]
            axes.set_title(f"{name}: {100 * part:.0f} % of the box", fontsize="medium")
        figure.suptitle(f"{field.label} above {level:g}", fontsize="medium")
        add_legend(figure, 2, SLICE_LEGEND[:2])


def draw_volume(axes: Any, field: Field, number: int, level: float) -> None:
    """Draw the rig of this number, and the volume in which the measure is above a level, in axes in space."""
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    if len(field.axes) != 3 or min(len(axis) for axis in field.axes.values()) < 2:
        raise ShapeError("a volume needs a sweep over a grid with several x, y and z")
    anchors = field.anchors[number]
    ends = np.array([[axis[0], axis[-1]] for axis in field.axes.values()])
    low, high = np.minimum(ends[:, 0], anchors.min(axis=0)), np.maximum(ends[:, 1], anchors.max(axis=0))
    axes.view_init(elev=18, azim=-62, vertical_axis=field.up)
    axes.set_box_aspect(high - low, zoom=0.9)
    for letter, a, b in zip("xyz", low, high, strict=True):
        axes.set(**{f"{letter}lim": (a, b), f"{letter}label": f"{letter} (m)"})
    shares = (high - low) / (high - low).max()
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), shares, strict=True):
        axis.set_pane_color("white")
        axis.set_major_locator(MaxNLocator(nbins=max(1, round(4 * share))))
    triangles = level_surface(field.values[number], tuple(field.axes.values()), level)  # type: ignore[arg-type]
    if len(triangles):
        colours = _shaded(triangles, "xyz".index(field.up))
        axes.add_collection3d(Poly3DCollection(triangles, facecolors=colours, alpha=0.55))
    for anchor, end in zip(anchors, field.ends[number], strict=True):
        axes.plot(*zip(anchor, end, strict=True), color=GREY, linewidth=0.8)
    axes.plot(*anchors.T, linestyle="", marker="s", markersize=5, color=BLUE)


def plot_shares(swept: xarray.Dataset, path: str | Path, measure: str | None = None) -> None:
    """Draw, for each rig, in which share of the volume a measure is at least so large.

    Parameters and errors as in `plot_slices`. A pose without a value counts as one where nothing can be done.
    """
    field = read_field(swept, measure)
    with new_figure(path, (7.5, 5.0)) as figure:
        axes: Any = figure.add_subplot()
        draw_shares(axes, field)
        axes.legend(title="rig", loc="upper right")


def draw_shares(axes: Any, field: Field) -> None:
    """Draw one curve for each rig: the share of its poses against the least value there."""
    top = float(np.nanmax(field.values, initial=0.0))
    levels = np.linspace(0.0, top if top > 0 else 1.0, 400)
    for number, name in enumerate(field.names):
        look = {"color": CURVES[number % len(CURVES)], "linestyle": DASHES[number // len(CURVES) % len(DASHES)]}
        axes.plot(levels, 100 * share_above(field.values[number], levels), label=name, linewidth=1.8, **look)
    axes.set(
        xlabel=f"at least: {field.label}", ylabel="share of the volume (%)", ylim=(0, 101), xlim=(0, levels[-1])
    )
    axes.grid()


def share_above(values: Floats, levels: Floats) -> Floats:
    """In which share of all poses is the value at least each level, and above zero?"""
    known = np.sort(np.where(np.isfinite(values) & (values > 0), values, -np.inf).ravel())
    return np.asarray(1.0 - np.searchsorted(known, np.maximum(levels, 1e-300), side="left") / known.size)


def _middle(field: Field) -> dict[str, int]:
    """Index of the middle of each axis."""
    return {name: len(axis) // 2 for name, axis in field.axes.items()}


def _height(field: Field) -> float:
    """How high is the panel of a slice, in inches?"""
    width, height = (float(np.ptp(field.axes[name])) for name in _plane(field)[:2])
    return min(max(PANEL * height / width if width > 0 else PANEL, 1.8), 5.5) + 0.7


def _plane(field: Field) -> tuple[str, str, str | None]:
    """The two axes of the pictures, and the one they cut."""
    names = list(field.axes)
    if len(names) == 2:
        return names[0], names[1], None
    single = [name for name in names if len(field.axes[name]) == 1]
    cut = (single or [name for name in names if name != field.up])[-1]
    first, second = (name for name in names if name != cut)
    return (second, first, cut) if first == field.up else (first, second, cut)


def _shaded(triangles: Floats, up: int) -> Floats:
    """Colours of triangles, lighter where they face up."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1)
    light = 0.55 + 0.45 * np.abs(normal[:, up]) / np.where(length > 0, length, 1.0)
    return np.clip(np.array([0.0, 0.62, 0.45]) * light[:, None] + 0.25 * light[:, None] ** 3, 0.0, 1.0)
