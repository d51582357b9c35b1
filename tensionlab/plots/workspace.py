"""Figures of workspaces: slices, volumes and shares of a sweep over a grid, and slices of what is proved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError
from tensionlab.plots.rig import frame_panel
from tensionlab.plots.style import CURVES, Entry, add_legend, curve_look, new_figure, one_panel
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE
from tensionlab.support.surfaces import level_surface
from tensionlab.workspace.shares import node_weights, weighted_share
from tensionlab.workspace.sweep.dataset import configuration_names

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.workspace.certified import CertifiedWorkspace


NONE_COLOUR = "#E4E4E4"  # where a value is zero or less
NO_YES = (NONE_COLOUR, GREEN)  # colours of a metric that is 0 or 1
PANEL_WIDTH, HIGHEST_PANEL = 3.3, 3.4  # mean width and largest height of the panels, in inches
NARROWEST = 0.5  # smallest width of a panel, as a share of the widest
COLUMNS = 4  # panels in a row, at most
SLICE_LEGEND: list[Entry] = [
    ("module", {"color": BLUE, "marker": "s", "ls": ""}),
    ("cable at home", {"color": GREY, "linewidth": 0.8}),
    ("zero or less", {"color": NONE_COLOUR, "marker": "s", "markersize": 9, "ls": ""}),
]
PIXELS = 500  # along the longer edge of a slice
PROOF_COLOURS = (NONE_COLOUR, ORANGE, GREEN)  # colours of cells that are outside, undecided and inside
PROOF_LEGEND: list[Entry] = [
    (word, {"color": colour, "marker": "s", "markersize": 9, "ls": ""})
    for word, colour in zip(("proved outside", "undecided", "proved inside"), PROOF_COLOURS, strict=True)
] + [("module", {"color": BLUE, "marker": "s", "ls": ""}), ("home", {"color": GREY, "marker": "+", "ls": ""})]


def plot_slices(swept: xarray.Dataset, metric: str | None = None) -> Figure:
    """Draw metrics over a slice of space for each rig, with the rig in it; a row for each of several metrics.

    In space, a grid with a single point along one axis is drawn as it is; of another, the upright slice that is
    nearest to the home of the first rig. InputError if there is no such variable or no grid.

    Parameters
    ----------
    swept : Dataset
        From `tensionlab.sweep` over a grid.
    metric : str, optional
        Name of the variable; left out: all.
    """
    fields = [read_field(swept, name) for name in ([metric] if metric else map(str, swept.data_vars))]
    field, several, count = fields[0], len(fields) > 1, len(fields[0].names)
    columns = count if several else min(COLUMNS, count)
    rows = len(fields) if several else -(-count // columns)
    windows = slice_windows(fields, several)
    widths, tall = np.ptp(windows[:, 0], axis=1), float(np.ptp(windows[0, 1]))
    scale = min(PANEL_WIDTH / widths.mean(), HIGHEST_PANEL / tall)
    bar_width = 1.8 + 0.045 * max((len(name) for row_field in fields for name, _ in row_field.classes), default=0)
    across = bar_width + scale * widths[:columns].sum() + 0.4 * columns
    size = across, 0.9 + (scale * tall + 0.9 - 0.3 * several) * rows
    with new_figure(size) as figure:
        grid: Any = figure.subplots(
            rows, columns, squeeze=False, sharex="col" if several else False, sharey=several,
            width_ratios=widths[:columns],
        )  # fmt: skip
        for axes in grid.flat[len(fields) * count :]:
            axes.set_axis_off()
        for row_field, panels in zip(fields, grid if several else [grid], strict=True):
            levels = shade_levels([row_field])
            for number, axes in zip(range(count), panels.flat, strict=False):
                shades = draw_slice(axes, row_field, number, levels)
                axes.set(xlim=windows[number, 0], ylim=windows[number, 1])
                if several:
                    axes.label_outer()
            bar = figure.colorbar(shades, ax=panels, shrink=0.85, label=row_field.label)
            if row_field.classes:
                bar.set_ticks(range(len(row_field.classes)), labels=[name for name, _ in row_field.classes])
                bar.ax.tick_params(length=0)
        if title := cut_title(field):
            figure.suptitle(title, fontsize="medium")
        add_legend(figure, 3, SLICE_LEGEND[: 2 if field.classes and not several else 3])
    return figure


def slice_windows(fields: Sequence[Field], several: bool) -> Floats:
    """Return the ends of what is drawn of each rig's slice, (rigs, 2, 2): first across, then along.

    Inside are the rig and all that is above zero. All rigs have the same ends along, and with one metric across.
    """
    first, names = fields[0], list(fields[0].axes)
    shown = [names.index(axis) for axis in _plane(first)[:2]]
    windows = np.empty((len(first.names), 2, 2))
    for number, window in enumerate(windows):
        above = np.any([(_slice(field, number) > 0) | bool(field.modules) for field in fields], axis=0)
        rig = np.concatenate([first.anchors[number], first.ends[number]])[:, shown]
        for part, places in enumerate(first.axes[names[axis]] for axis in shown):
            drawn = places[above.any(axis=part)] if above.any() else places
            drawn = np.append(drawn, rig[:, part])
            window[part] = drawn.min(), drawn.max()
            window[part] += 0.03 * np.ptp(drawn) * np.array([-1.0, 1.0])
    for part in (1,) if several else (0, 1):
        windows[:, part] = windows[:, part, 0].min(), windows[:, part, 1].max()
    width = np.ptp(windows[:, 0], axis=1)
    margin = np.maximum(NARROWEST * width.max() - width, 0.0) / 2.0  # for the titles
    windows[:, 0] += margin[:, None] * [-1.0, 1.0]
    return windows


def _slice(field: Field, number: int) -> Floats:
    """Return the values of one rig in the plane of the slices, (along, across)."""
    names, (across, along, cut) = list(field.axes), _plane(field)
    picture = field.values[number]
    if cut is not None:
        picture = picture.take(_cut_index(field, cut), axis=names.index(cut))
    return np.asarray(picture if names.index(along) < names.index(across) else picture.T)


def draw_slice(axes: Any, field: Field, number: int, levels: Floats) -> Any:
    """Draw a metric over the slice of one rig, and the rig; return the shades, for the colour bar."""
    from matplotlib.colors import ListedColormap

    names = list(field.axes)
    across, along, _ = _plane(field)
    picture = _slice(field, number)
    x, y = field.axes[across], field.axes[along]
    if min(len(x), len(y)) < 2:
        raise InputError(f"a slice needs two positions or more along {across} and {along}; give a smaller step")
    axes.fill_between([x[0], x[-1]], y[0], y[-1], color=NONE_COLOUR, linewidth=0)
    if field.classes:  # each pose its own cell: nothing is known of the space between them
        colours = ListedColormap([colour for _, colour in field.classes])
        ends = {"vmin": -0.5, "vmax": len(field.classes) - 0.5}
        shades = axes.pcolormesh(x, y, picture, shading="nearest", cmap=colours, **ends)
    else:
        above = 2.0 * levels[-1]  # of all shades: where the metric is infinite
        picture = np.nan_to_num(picture, nan=0.0, posinf=above, neginf=0.0)
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
    title = field.names[number]
    if not field.modules:
        share = weighted_share(_slice(field, number) > 0, [node_weights(y), node_weights(x)])
        title += f"\nabove zero in {np.ptp(x) * np.ptp(y) * share:.2g} m²"
    axes.set_title(title, fontsize="medium")
    return shades


def cut_title(field: Field) -> str:
    """Return where the slices cut, such as "z = 0 m"; nothing for a planar rig."""
    cut = _plane(field)[2]
    return "" if cut is None else f"{cut} = {np.round(field.axes[cut][_cut_index(field, cut)], 9) + 0.0:.4g} m"


def _cut_index(field: Field, cut: str) -> int:
    """Return the position along an axis that is nearest to the home of the first rig."""
    return int(np.abs(field.axes[cut] - field.home[list(field.axes).index(cut)]).argmin())


def largest_value(field: Field) -> float:
    """Return the largest finite value, or 1 if none is above zero."""
    return float(field.values[np.isfinite(field.values)].max(initial=0.0)) or 1.0


def shade_levels(fields: list[Field]) -> Floats:
    """Return round steps from nothing to the largest value of all."""
    from matplotlib.ticker import MaxNLocator

    top = max(map(largest_value, fields))
    steps = np.asarray(MaxNLocator(nbins=9, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, top))
    return np.asarray([1e-9 * top, *steps[steps > 1e-6 * top]])


@overload
def plot_shares(swept: xarray.Dataset, metric: str | None = None, *, ax: None = None) -> Figure: ...
@overload
def plot_shares(swept: xarray.Dataset, metric: str | None = None, *, ax: Axes) -> None: ...
def plot_shares(swept: xarray.Dataset, metric: str | None = None, *, ax: Axes | None = None) -> Figure | None:
    """Draw, for each rig, the share of the volume in which a metric has at least each value.

    Parameters and errors as in `plot_slices`, but the metric left out is the first; ``ax`` is a panel of another
    figure. A pose without a value counts as infeasible.
    """
    field = read_field(swept, metric)
    with one_panel(ax, (7.5, 5.0)) as (figure, axes):
        draw_shares(axes, field)
        axes.legend(title="rig", loc="upper right")
    return figure if ax is None else None


def draw_shares(axes: Any, field: Field) -> None:
    """Draw one curve for each rig: the share of its poses against the minimum value there."""
    levels = np.linspace(0.0, largest_value(field), 400)
    for number, name in enumerate(field.names):
        share = 100 * share_above(field, number, levels)
        axes.plot(levels, share, label=name, linewidth=1.8, **curve_look(number))
    axes.set(
        xlabel=f"minimum {field.label}", ylabel="share of the volume (%)", ylim=(0, 101), xlim=(0, levels[-1])
    )
    axes.grid()


def share_above(field: Field, number: int, levels: ArrayLike) -> Floats:
    """Return the share of the box with a value of at least each level, and above zero, of the rig of a number."""
    weights = [node_weights(axis) for axis in field.axes.values()]
    values = np.nan_to_num(field.values[number], nan=-np.inf, posinf=np.inf)
    return np.array([weighted_share((values >= level) & (values > 0), weights) for level in np.atleast_1d(levels)])


def plot_volume(swept: xarray.Dataset, metric: str | None = None, level: float = 0.0) -> Figure:
    """Draw, for each rig, the volume in which a metric is above a level, in its unit, of a sweep over x, y and z.

    Other parameters and errors as in `plot_shares`.
    """
    field = read_field(swept, metric)
    columns = min(3, len(field.names))
    rows = -(-len(field.names) // columns)
    with new_figure((4.6 * columns, 0.8 + 4.2 * rows)) as figure:
        for number in range(len(field.names)):
            axes = figure.add_subplot(rows, columns, number + 1, projection="3d")
            draw_volume(axes, field, number, level)
        figure.suptitle(f"{field.label} above {level:g}", fontsize="medium")
        add_legend(figure, 2, SLICE_LEGEND[:2])
    return figure


def draw_volume(axes: Any, field: Field, number: int, level: float) -> None:
    """Draw the rig of a number, and the volume in which the metric is above a level, in axes in space."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
    from scipy.ndimage import convolve1d

    if len(field.axes) != 3 or min(len(axis) for axis in field.axes.values()) < 2:
        raise InputError("a volume needs a sweep over a grid with several x, y and z")
    anchors = field.anchors[number]
    ends = np.array([[axis[0], axis[-1]] for axis in field.axes.values()])
    corners = np.concatenate([ends.T, anchors])
    frame_panel(axes, corners.min(axis=0), corners.max(axis=0), field.up)
    values = field.values[number]
    if field.yes_or_no and level == 0.0:
        # The border is somewhere between a pose that is in and one that is out: half way, without the steps of the
        # grid, which a weighted mean of neighbours takes away.
        level = 0.5
        for axis in range(3):
            values = convolve1d(np.nan_to_num(values), [0.25, 0.5, 0.25], axis, mode="nearest")
    if surface := level_surface(values, tuple(field.axes.values()), level):
        triangles = surface[0][surface[1]]
        colours = _shaded(triangles, "xyz".index(field.up))
        axes.add_collection3d(Poly3DCollection(triangles, facecolors=colours, alpha=0.55))
    for anchor, end in zip(anchors, field.ends[number], strict=True):
        axes.plot(*zip(anchor, end, strict=True), color=GREY, linewidth=0.8)
    axes.plot(*anchors.T, linestyle="", marker="s", markersize=5, color=BLUE)
    share = share_above(field, number, level)[0]
    axes.set_title(f"{field.names[number]}: {100 * share:.0f} % of the box", fontsize="medium")


def _shaded(triangles: Floats, up: int) -> Floats:
    """Return colours of triangles, lighter where they face up."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1)
    light = 0.55 + 0.45 * np.abs(normal[:, up]) / np.where(length > 0, length, 1.0)
    return np.clip(np.array([0.0, 0.62, 0.45]) * light[:, None] + 0.25 * light[:, None] ** 3, 0.0, 1.0)


@dataclass(frozen=True)
class Field:
    """One metric over a grid, for each of several rigs."""

    values: Floats  # (rigs, *grid); NaN where a cable has no length
    axes: dict[str, Floats]  # coordinates along each axis of the grid, in m
    names: list[str]  # rigs
    anchors: list[Floats]  # of each rig, (m, d), in m
    ends: list[Floats]  # of its cables, with the platform at home, (m, d), in m
    home: Floats  # of the first rig, (d,), in m
    label: str  # metric, with its unit
    up: str  # axis that points up
    modules: Sequence[str] = ()  # names of the modules whose numbers the values are; none for other metrics

    @property
    def classes(self) -> list[tuple[str, str]]:
        """Name and colour of each value, where there are few: modules, or no and yes."""
        if self.modules:
            return [(name, CURVES[number % len(CURVES)]) for number, name in enumerate(self.modules)]
        return list(zip(("no", "yes"), NO_YES, strict=True)) if self.yes_or_no else []

    @property
    def yes_or_no(self) -> bool:
        """Whether the metric is 0 or 1, such as whether something is feasible."""
        known = self.values[~np.isnan(self.values)]
        return bool(known.size and np.isin(known, (0.0, 1.0)).all())


def read_field(swept: xarray.Dataset, metric: str | None = None) -> Field:
    """Return a metric of a sweep over a grid of positions, the first if none is named, with the rigs."""
    if metric is None:
        metric = str(next(iter(swept.data_vars)))
    if metric not in swept.data_vars:
        known = ", ".join(str(name) for name in swept.data_vars)
        raise InputError(f'the sweep has no metric "{metric}"; it has {known}')
    values = swept[metric]
    axes = {name: swept[name].to_numpy() for name in "xyz" if name in values.dims}
    configurations = swept["kind"].dims
    other = [str(name) for name in values.dims if name not in axes and name not in configurations]
    if other or len(axes) < 2:
        raise InputError(f"figures need a sweep over a grid of positions; this one has the axes {values.dims}")
    anchors, ends = (
        points.transpose(*configurations, "module", "axis").to_numpy().reshape(-1, *points.shape[-2:])
        for points in (swept["anchor"], swept["attachment"] + swept["home"])
    )
    there = ~np.isnan(anchors).any(axis=-1)
    ups = {str(up) for up in np.atleast_1d(swept["up"].to_numpy()).ravel()}
    attributes = values.attrs
    modules: Sequence[str] = ()
    if attributes.get("better") == "none":
        rows = swept["module_name"].transpose(*configurations, "module").to_numpy().reshape(-1, len(there[0]))
        modules = [str(name) for name in (rows[0] if (rows == rows[0]).all() else range(len(rows[0])))]
    unit = "" if attributes["units"] == "1" else f" ({attributes['units']})"
    return Field(
        values=values.transpose(*configurations, *axes).to_numpy().reshape(-1, *(len(a) for a in axes.values())),
        axes=axes,
        names=configuration_names(swept),
        anchors=[points[own] for points, own in zip(anchors, there, strict=True)],
        ends=[points[own] for points, own in zip(ends, there, strict=True)],
        home=swept["home"].transpose(*configurations, "axis").to_numpy().reshape(-1, len(swept["axis"]))[0],
        label=f"{attributes['long_name']}{unit}",
        up=(ups.pop().strip("-") or "y") if len(ups) == 1 else list(axes)[-1],
        modules=modules,
    )


def _plane(field: Field) -> tuple[str, str, str | None]:
    """Return the two axes of the slices, and the one they cut."""
    names = list(field.axes)
    if len(names) == 2:
        return names[0], names[1], None
    single = [name for name in names if len(field.axes[name]) == 1]
    cut = (single or [name for name in names if name != field.up])[-1]
    first, second = (name for name in names if name != cut)
    return (second, first, cut) if first == field.up else (first, second, cut)


def plot_certified(proved: CertifiedWorkspace) -> Figure:
    """Draw what is proved in slices through the home, or where the region is nearest to it.

    One slice across each axis of space; one alone where the region is a plane. InputError if it is a line.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> region = [[-0.4, 0.4], [0.0, 1.6], [-0.4, 0.4]]
    >>> proved = tl.workspace.certify(tl.load_rig("bartels2026-validation"), region, ([0.0, 0.0, 0.0], 1.0), 0.05)
    >>> figure = plots.plot_certified(proved)
    """
    rig, extent = proved.rig, proved.subdivision.extent
    wide = [axis for axis in range(rig.dimension) if extent[axis] > 0]
    if len(wide) < 2:
        raise InputError(f"the region is a line along {'xyz'[wide[0]]}; figures need an extent along two axes")
    planes = [sorted(plane, key=lambda axis: "xyz"[axis] == rig.vertical) for plane in combinations(wide, 2)][::-1]
    widths, heights = extent[planes].T
    scale = min(PANEL_WIDTH * len(planes) / widths.sum(), 1.25 * HIGHEST_PANEL / heights.max())  # of all panels
    size = max(5.6, 0.5 + 0.9 * len(planes) + scale * widths.sum()), 2.5 + scale * heights.max()
    with new_figure(size) as figure:
        panels: Any = figure.subplots(1, len(planes), squeeze=False, width_ratios=widths)[0]
        for panel, plane in zip(panels, planes, strict=True):
            _draw_proved_slice(panel, proved, *plane)
        bounds = f"{proved.volume.describe()} {proved.unit}"
        title = f"{rig.name}: {proved.required}, proved in {bounds}"
        figure.suptitle(title, fontsize="medium", fontweight="bold")
        add_legend(figure, 3 if len(planes) == 1 else len(PROOF_LEGEND), PROOF_LEGEND)
    return figure


def _draw_proved_slice(panel: Any, proved: CertifiedWorkspace, across: int, along: int) -> None:
    """Draw what is proved in a plane of two axes."""
    from matplotlib.colors import ListedColormap

    cells, home = proved.subdivision, proved.rig.home
    low, high = cells.low, cells.low + cells.extent
    shown = [across, along]
    through = np.clip(home, low, high)
    counts = np.ceil(PIXELS * cells.extent / cells.extent[shown].max()).astype(int)
    points = np.broadcast_to(through, (counts[along], counts[across], len(home))).copy()
    for axis, view in ((across, np.s_[None, :]), (along, np.s_[:, None])):
        points[..., axis] = (low[axis] + cells.extent[axis] * (np.arange(counts[axis]) + 0.5) / counts[axis])[view]
    ends = [(low[axis], high[axis]) for axis in shown]
    panel.imshow(
        proved.at(points) + 1,
        origin="lower",
        extent=(*ends[0], *ends[1]),
        cmap=ListedColormap(PROOF_COLOURS),
        vmin=0,
        vmax=2,
        interpolation="nearest",
    )
    modules = proved.anchors[((proved.anchors >= low - 1e-9) & (proved.anchors <= high + 1e-9)).all(axis=1)]
    if len(modules):  # of none, unclipped, the layout does not know the size
        panel.plot(*modules[:, shown].T, linestyle="", marker="s", markersize=5, color=BLUE, clip_on=False)
    panel.plot(*home[shown], linestyle="", marker="+", markersize=8, color=GREY)
    panel.set(xlabel=f"{'xyz'[across]} (m)", ylabel=f"{'xyz'[along]} (m)", xlim=ends[0], ylim=ends[1])
    cut = [f"{'xyz'[axis]} = {through[axis]:.4g} m" for axis in range(len(home)) if axis not in shown]
    panel.set_title(", ".join(cut), fontsize="medium")
