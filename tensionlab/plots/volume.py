"""Figures of volumes: where a metric of a sweep is above a level, before and after a search for a layout."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from tensionlab.errors import InputError
from tensionlab.plots.rig import frame_panel, plot_rig
from tensionlab.plots.style import add_legend, new_figure, one_panel, panel_legend
from tensionlab.plots.workspace import SLICE_LEGEND, Field, draw_shares, read_field, require_one, share_above
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREY, ORANGE
from tensionlab.support.surfaces import level_surface

ON_FRONT: dict[str, Any] = {"color": BLUE, "marker": "o", "linewidth": 1.4, "drawstyle": "steps-post"}
# Looks of layouts that others beat, or do not.
OFF_FRONT: dict[str, Any] = {"color": GREY, "marker": "o", "linestyle": "", "fillstyle": "none"}

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.workspace.layout.results import LayoutSearch
    from tensionlab.workspace.layout.space import Space
    from tensionlab.workspace.poses import Grid


@overload
def plot_volume(
    swept: xarray.Dataset, level: float = 0.0, metric: str | None = None, *, ax: None = None
) -> Figure: ...
@overload
def plot_volume(swept: xarray.Dataset, level: float = 0.0, metric: str | None = None, *, ax: Axes) -> None: ...
def plot_volume(
    swept: xarray.Dataset, level: float = 0.0, metric: str | None = None, *, ax: Axes | None = None
) -> Figure | None:
    """Draw, for each rig, the volume in which a metric is above a level.

    Parameters and errors as in `plot_slices`, the panel with the projection "3d"; also an `InputError` for a sweep
    that is not over a grid in space.

    Parameters
    ----------
    swept : Dataset
        From `tensionlab.sweep` over a grid.
    level : float
        Of the metric, in its unit.
    metric : str, optional
        Name of the variable; left out: the first.
    ax : Axes, optional
        Panel of another figure to draw into.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> grid = tl.workspace.box([-1.0, 1.0], [0.0, 2.0], [-1.0, 1.0], step=0.5)
    >>> swept = tl.sweep(tl.load_rig("bartels2026-validation"), grid, "capacity-margin")
    >>> figure = plots.plot_volume(swept, level=0.5)
    """
    field = read_field(swept, metric)
    if ax is not None:
        require_one(field)
        with one_panel(ax, (0.0, 0.0), "3d") as (_, axes):
            draw_volume(axes, field, 0, level)
            axes.set_title(_volume_title(field, 0, level))
        return None
    columns = min(3, len(field.names))
    rows = -(-len(field.names) // columns)
    with new_figure((4.6 * columns, 0.8 + 4.2 * rows)) as figure:
        for number in range(len(field.names)):
            axes = figure.add_subplot(rows, columns, number + 1, projection="3d")
            draw_volume(axes, field, number, level)
            axes.set_title(_volume_title(field, number, level), fontsize="medium")
        figure.suptitle(f"{field.label} above {level:g}", fontsize="medium")
        add_legend(figure, 2, SLICE_LEGEND[:2])
    return figure


def _volume_title(field: Field, number: int, level: float) -> str:
    part = share_above(field, number, level)[0]
    return f"{field.names[number]}: {100 * part:.0f} % of the box"


def draw_volume(axes: Any, field: Field, number: int, level: float) -> None:
    """Draw the rig of this number, and the volume in which the metric is above a level, in axes in space."""
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    if len(field.axes) != 3 or min(len(axis) for axis in field.axes.values()) < 2:
        raise InputError("a volume needs a sweep over a grid with several x, y and z")
    anchors = field.anchors[number]
    ends = np.array([[axis[0], axis[-1]] for axis in field.axes.values()])
    low, high = np.minimum(ends[:, 0], anchors.min(axis=0)), np.maximum(ends[:, 1], anchors.max(axis=0))
    axes.view_init(elev=18, azim=-62, vertical_axis=field.up)
    axes.set_box_aspect(high - low, zoom=0.78)
    for letter, a, b in zip("xyz", low, high, strict=True):
        axes.set(**{f"{letter}lim": (a, b), f"{letter}label": f"{letter} (m)"})
    shares = (high - low) / (high - low).max()
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), shares, strict=True):
        axis.set_pane_color("white")
        axis.labelpad = 8
        axis.set_major_locator(MaxNLocator(nbins=max(1, round(4 * share))))
    if field.yes_or_no and level == 0.0:
        level = 0.5  # half way: the border is somewhere between a pose that is in and one that is out
    if surface := level_surface(field.values[number], tuple(field.axes.values()), level):
        triangles = surface[0][surface[1]]
        colours = _shaded(triangles, "xyz".index(field.up))
        axes.add_collection3d(Poly3DCollection(triangles, facecolors=colours, alpha=0.55))
    for anchor, end in zip(anchors, field.ends[number], strict=True):
        axes.plot(*zip(anchor, end, strict=True), color=GREY, linewidth=0.8)
    axes.plot(*anchors.T, linestyle="", marker="s", markersize=5, color=BLUE)


def _shaded(triangles: Floats, up: int) -> Floats:
    """Return colours of triangles, lighter where they face up."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1)
    light = 0.55 + 0.45 * np.abs(normal[:, up]) / np.where(length > 0, length, 1.0)
    return np.clip(np.array([0.0, 0.62, 0.45]) * light[:, None] + 0.25 * light[:, None] ** 3, 0.0, 1.0)


def plot_layouts(around: xarray.Dataset, target: xarray.Dataset, level: float) -> Figure:
    """Draw rigs side by side: the volume above a level around a target, and the curves for the target itself.

    Both data sets are of the same rigs and metric, from `tensionlab.sweep`: over a grid of all that is drawn, and
    over one of the target alone.

    Parameters
    ----------
    around, target : Dataset
        Over a grid of all that is drawn, and over one of the target alone.
    level : float
        Of the metric, in its unit.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> grid = tl.workspace.box([-1.0, 1.0], [0.0, 2.0], [-1.0, 1.0], step=0.5)
    >>> swept = tl.sweep(tl.load_rig("bartels2026-validation"), grid, "capacity-margin")
    >>> hand = tl.workspace.box([-0.1, 0.1], [0.2, 0.4], [-0.1, 0.1], step=0.1)
    >>> target = tl.sweep(tl.load_rig("bartels2026-validation"), hand, "capacity-margin")
    >>> figure = plots.plot_layouts(swept, target, level=0.5)
    """
    wide, narrow = read_field(around), read_field(target)
    count = len(wide.names)
    with new_figure((4.4 * count + 4.8, 4.9)) as figure:
        widths = [1.0] * count + [0.95]
        grid: Any = figure.add_gridspec(1, count + 1, width_ratios=widths)
        for number, name in enumerate(wide.names):
            axes: Any = figure.add_subplot(grid[number], projection="3d")
            draw_volume(axes, wide, number, level)
            ends = ((axis[0], axis[-1]) for axis in narrow.axes.values())
            _draw_edges(axes, np.array(list(product(*ends))), ORANGE)
            axes.set_title(name, fontsize="medium")
        curves: Any = figure.add_subplot(grid[count])
        draw_shares(curves, narrow)
        curves.set_ylabel("share of the target (%)")
        curves.legend()
        figure.suptitle(f"{wide.label} above {level:g}, and in the target", fontsize="medium")
        target_look: tuple[str, dict[str, Any]] = ("target", {"color": ORANGE, "linewidth": 1.4})
        add_legend(figure, 3, [*SLICE_LEGEND[:2], target_look])
    return figure


@overload
def plot_front(found: LayoutSearch, *, ax: None = None) -> Figure: ...
@overload
def plot_front(found: LayoutSearch, *, ax: Axes) -> None: ...
def plot_front(found: LayoutSearch, *, ax: Axes | None = None) -> Figure | None:
    """Draw the score of the layouts that a search found against their number of modules.

    The line joins those that no other beats with as many modules or fewer. With ``ax``, a panel of another figure
    is drawn into.

    Parameters
    ----------
    found : LayoutSearch
        From `tensionlab.workspace.search_layout`.
    ax : Axes, optional
        Panel of another figure to draw into.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> space = tl.workspace.Space(tl.workspace.room([3.0, 2.4, 4.0]), counts=(4, 5))
    >>> hand = tl.workspace.box([-0.2, 0.2], [1.0, 1.4], [-0.2, 0.2], step=0.2)
    >>> found = tl.workspace.search_layout(space, hand, tl.workspace.Objective(), generations=1, starts=1)
    >>> figure = plots.plot_front(found)
    """
    with one_panel(ax, (6.5, 4.2)) as (figure, axes):
        for layouts, look in ((found.layouts, OFF_FRONT), (found.front, ON_FRONT)):
            axes.plot([each.rig.m for each in layouts], [each.score for each in layouts], clip_on=False, **look)
        axes.set_xticks([each.rig.m for each in found.layouts])
        axes.set(xlabel="modules", ylabel="score", title=f"score: {found.describe()}")
        axes.set_ylim(bottom=min(0.0, *(each.score for each in found.layouts)))
        axes.grid(axis="y")
        looks = [("best with as many modules or fewer", ON_FRONT), ("no better than with fewer", OFF_FRONT)]
        panel_legend(figure, ax, 2, looks[: 1 + (len(found.front) < len(found.layouts))])
    return figure if ax is None else None


def plot_search(space: Space, target: Grid, found: LayoutSearch) -> Figure:
    """Draw a search for a layout: where modules might stand, where the best layout has them, and what each buys.

    The last panel, that of `plot_front`, is there where several numbers of modules were searched for.

    Parameters
    ----------
    space : Space
        With the surfaces.
    target : Grid
        Positions of the hand.
    found : LayoutSearch
        From `tensionlab.workspace.search_layout`, of both.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> space = tl.workspace.Space(tl.workspace.room([3.0, 2.4, 4.0]), counts=(4,), up="y")
    >>> hand = tl.workspace.box([-0.2, 0.2], [1.0, 1.4], [-0.2, 0.2], step=0.2)
    >>> found = tl.workspace.search_layout(space, hand, tl.workspace.Objective(), generations=1, starts=1)
    >>> figure = plots.plot_search(space, hand, found)
    """
    panels, best = 2 + (len(found.layouts) > 1), found.best
    projection: Any = {"projection": "3d"} if space.dimension == 3 else {}
    with new_figure((5.6 * panels, 5.0)) as figure:
        before: Any = figure.add_subplot(1, panels, 1, **projection)
        outlines = [
            corner + np.array(list(product((0.0, 1.0), repeat=len(surface.edges)))) @ edges[: len(surface.edges)]
            for surface, corner, edges in zip(
                space.surfaces, space.placed.corners, space.placed.edges, strict=True
            )
        ]
        everything = np.concatenate([*outlines, space.placed.fixed])
        frame_panel(before, everything.min(axis=0), everything.max(axis=0), best.rig.vertical)
        for outline in outlines:
            _draw_edges(before, outline, BLUE)
            if len(outline) == 4 and space.dimension == 3:
                from mpl_toolkits.mplot3d.art3d import Poly3DCollection

                before.add_collection3d(Poly3DCollection([outline[[0, 1, 3, 2]]], facecolors=BLUE, alpha=0.1))
        before.plot(*space.placed.fixed.T, linestyle="", marker="s", markersize=6, color=BLUE)
        before.set_title("where modules may stand")
        after: Any = figure.add_subplot(1, panels, 2, **projection)
        plot_rig(best.rig, ax=after)
        after.get_legend().remove()
        positions = target.arrays()[0].reshape(-1, space.dimension)
        box = list(product(*zip(positions.min(axis=0), positions.max(axis=0), strict=True)))
        for axes in (before, after):
            _draw_edges(axes, np.array(box), ORANGE)
        if panels == 3:
            front = figure.add_subplot(1, panels, 3)
            plot_front(found, ax=front)
            front.set_title("what each further module buys")
        figure.suptitle(f"score: {found.describe()}", fontsize="medium")
        add_legend(figure, 4, [
            ("module", {"color": BLUE, "marker": "s", "ls": ""}),
            ("edge of a surface", {"color": BLUE, "linewidth": 1.4}),
            ("cable at home", {"color": GREY, "linewidth": 1.1}),
            ("target", {"color": ORANGE, "linewidth": 1.4}),
        ])  # fmt: skip
    return figure


def _draw_edges(axes: Any, corners: Floats, colour: str) -> None:
    """Draw the edges of a box, a rectangle or a line, from its corners (2**k, d) in the order of `product`."""
    for a, b in product(range(len(corners)), repeat=2):
        if a < b and (a ^ b).bit_count() == 1:
            axes.plot(*zip(corners[a], corners[b], strict=True), color=colour, linewidth=1.4)
