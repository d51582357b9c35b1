"""Figures of a rig, modules and cables to scale, and of an allocation of its tensions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from tensionlab.errors import ShapeError
from tensionlab.model.bodies import place_bodies, surface_points
from tensionlab.model.pose import place_anchors
from tensionlab.model.pulleys import ways
from tensionlab.plots.style import add_legend, label_points, one_panel
from tensionlab.support.colours import BLUE, BODY, GREY, ORANGE, RED
from tensionlab.support.table import STATUS_MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.allocation import Allocation
    from tensionlab.model.rig import Rig
    from tensionlab.support.arrays import Floats


# Shape of each `Status`, in its order.
MARKERS: list[dict[str, Any]] = [
    {"marker": "o"},
    {"marker": "o", "fillstyle": "none"},
    {"marker": "^"},
    {"marker": "x"},
]
FEW = 50  # fewer wrenches are drawn as larger dots
MAX_DOTS = 2000  # largest number of wrenches drawn for each status, evenly spread
SPREAD = 0.12  # half the height of a row's dots, as a share of the row: spread out, many of the same tension show
LIGHT = np.array([0.6, -0.6, 0.5])  # direction that light comes from
MARGIN_INCHES = 0.5  # above and below a rig in space, for the title and the legend


@overload
def plot_rig(rig: Rig, *, ax: None = None) -> Figure: ...
@overload
def plot_rig(rig: Rig, *, ax: Axes) -> None: ...
def plot_rig(rig: Rig, *, ax: Axes | None = None) -> Figure | None:
    """Draw where a rig's modules stand and how its cables run at home, to scale.

    The rig's vertical axis is upright. Body frames are drawn at rest. ``ax`` is a panel of another figure to draw
    into; for a rig in space with the projection "3d".
    """
    spatial = rig.dimension == 3
    ends = rig.home + rig.attachments @ rig.home_matrix.T
    anchors = place_anchors(rig.modules, rig.anchors, rig.at_rest)
    outlines = body_outlines(rig)
    with one_panel(ax, (7.5, 7.0), "3d" if spatial else None) as (figure, axes):
        everything = np.concatenate([anchors, ends, *outlines])
        floor = frame_panel(axes, everything.min(axis=0), everything.max(axis=0), rig.vertical)
        if spatial:
            feet = anchors.copy()
            feet[:, "xyz".index(rig.vertical)] = floor["xyz".index(rig.vertical)]
            for anchor, foot in zip(anchors, feet, strict=True):  # a thread to the floor shows where it is
                axes.plot(*zip(anchor, foot, strict=True), color="#BBBBBB", linewidth=0.8, linestyle=":")
        draw_bodies(axes, outlines)
        routes = ways(ends, anchors, rig.pulleys_in_world(rig.at_rest))
        for way, end in zip(np.swapaxes(routes, 0, 1), ends, strict=True):
            axes.plot(*way.T, color=GREY, linewidth=1.1)
            axes.plot(*zip(rig.home, end, strict=True), color=RED, linewidth=1.1, alpha=0.5)
        on_body = np.array([module.frame in rig.frames for module in rig.modules])
        for points, marker, colour in (
            (anchors[~on_body], "s", BLUE), (anchors[on_body], "s", ORANGE), (rig.home[None], "o", RED),
        ):  # fmt: skip
            axes.plot(*points.T, linestyle="", marker=marker, markersize=6, color=colour)
        if ax is None:
            figure.suptitle(rig.name, fontweight="bold")
        else:
            axes.set_title(rig.name)
        add_legend(figure, 4, [
            ("module", {"color": BLUE, "marker": "s", "ls": ""}),
            *([("module on a body", {"color": ORANGE, "marker": "s", "ls": ""})] if on_body.any() else []),
            ("cable", {"color": GREY, "linewidth": 1.1}),
            *([("body", {"color": BODY, "marker": "o", "ls": "", "markersize": 9})] if outlines else []),
            ("platform, home" if rig.attachments.any() else "home", {"color": RED, "marker": "o", "ls": ""}),
        ], ax)  # fmt: skip
        _label_anchors(figure, axes, rig, anchors)
    if spatial and ax is None:
        _crop(figure, axes)
    return figure if ax is None else None


def body_outlines(rig: Rig) -> list[Floats]:
    """Return points (k, d) of the surface of each body, with the platform at home and frames at rest."""
    placed = place_bodies(rig.bodies, rig.home, rig.home_matrix, rig.at_rest)
    return [surface_points(body, placed_body) for body, placed_body in zip(rig.bodies, placed, strict=True)]


def draw_bodies(axes: Any, outlines: Sequence[Floats]) -> None:
    """Draw the convex hulls of points (k, d) in an axes of as many dimensions."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Polygon
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
    from scipy.spatial import ConvexHull

    for points in outlines:
        hull = ConvexHull(points)
        if points.shape[1] == 2:
            axes.add_patch(Polygon(points[hull.vertices], facecolor=BODY, edgecolor=GREY, alpha=0.6))
        else:  # faces are lighter the more they are turned to the light
            light = 0.8 + 0.2 * hull.equations[:, :3] @ LIGHT
            colours = light[:, None] * to_rgb(BODY)
            axes.add_collection3d(Poly3DCollection(points[hull.simplices], facecolors=colours, alpha=0.6))


def frame_panel(axes: Any, low: Floats, high: Floats, vertical: str) -> Floats:
    """Frame what is between two corners (d,), with room for names; return the lowest corner shown."""
    spatial = low.size == 3
    margin = np.full(low.size, (0.2 if spatial else 0.1) * float((high - low).max()))
    if spatial:
        margin["xyz".index(vertical)] /= 4
    low, high = low - margin, high + margin
    for name, lowest, highest in zip("xyz", low, high, strict=False):
        axes.set(**{f"{name}lim": (lowest, highest), f"{name}label": f"{name} (m)"})
    if not spatial:
        axes.set_aspect("equal")
        axes.grid()
        return low
    axes.view_init(elev=18, azim=-62, vertical_axis=vertical)  # before the aspect, which depends on it
    axes.set_box_aspect(high - low, zoom=0.85)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color("white")
        axis.labelpad = 10
        axes.locator_params(nbins=4)
    return low


def _crop(figure: Figure, axes: Any) -> None:
    """Leave out what a panel in space has white above and below: it is square, however flat the rig is."""
    figure.draw_without_rendering()  # projects what is drawn
    width, height = figure.get_size_inches()
    parts = [*axes.lines, *axes.texts, axes.xaxis, axes.yaxis, axes.zaxis]
    boxes = [box for part in parts if (box := part.get_tightbbox()) is not None]
    bottom, top = min(box.y0 for box in boxes) / figure.dpi, max(box.y1 for box in boxes) / figure.dpi
    shorter = top - bottom + 2 * MARGIN_INCHES
    if shorter < height:
        left, low, across, along = axes.get_position(original=True).bounds
        place = [left, (low * height - bottom + MARGIN_INCHES) / shorter, across, along * height / shorter]
        figure.set_size_inches(width, shorter)
        axes.set_position(np.round(place, 6))


def _label_anchors(figure: Figure, axes: Any, rig: Rig, anchors: Floats) -> None:
    """Write the modules' names next to their anchors."""
    from mpl_toolkits.mplot3d import proj3d  # type: ignore[import-untyped]

    points = np.vstack([anchors, rig.home])
    if rig.dimension == 3:
        figure.draw_without_rendering()  # the projection follows the size
        points = np.column_stack(proj3d.proj_transform(*points.T, axes.get_proj())[:2])
    *places, home = points
    names = {module.name: [tuple(place)] for module, place in zip(rig.modules, places, strict=True)}
    cables = [tuple(home + share * (place - home)) for place in places for share in (0.0, 0.3, 0.6, 0.8, 0.9)]
    label_points(figure, axes, names | {"": cables})


@overload
def plot_allocation(allocation: Allocation, rig: Rig, *, ax: None = None) -> Figure: ...
@overload
def plot_allocation(allocation: Allocation, rig: Rig, *, ax: Axes) -> None: ...
def plot_allocation(allocation: Allocation, rig: Rig, *, ax: Axes | None = None) -> Figure | None:
    """Draw the tensions of each cable between its limits, one row per cable, by status.

    One wrench is one dot in each row, several are a cloud of dots for each status. ``ax`` is as in `plot_rig`.
    ShapeError if the rig has another number of cables.
    """
    if allocation.tensions.shape[-1] != rig.m:
        raise ShapeError(f"the allocation has {allocation.tensions.shape[-1]} cables, and {rig.name} has {rig.m}")
    tensions, status = allocation.tensions.reshape(-1, rig.m), np.ravel(allocation.status)
    present, few = np.unique(status), len(tensions) < FEW
    with one_panel(ax, (7.5, 1.4 + 0.45 * rig.m)) as (figure, axes):
        for row, module in enumerate(rig.modules):
            span = [module.lower, module.upper]
            axes.plot(span, [row, row], color=GREY, linewidth=0.8, marker="|", markersize=14)
        for place, code in enumerate(present):
            index = np.flatnonzero(status == code)
            index = index[np.linspace(0, len(index) - 1, min(len(index), MAX_DOTS)).astype(int)]
            height = 0.6 * ((place + 0.5) / len(present) - 0.5) * (len(present) > 1)
            # The golden ratio spreads any number of dots evenly.
            spread = SPREAD * (2 * np.modf(0.618034 * np.arange(len(index)))[0] - 1) * (len(index) > 1)
            for row in range(rig.m):
                axes.plot(
                    tensions[index, row], row + height + spread, linestyle="", color=STATUS_MARKS[code].colour,
                    markersize=6 if few else 3, alpha=1.0 if few else 0.5, zorder=3, **MARKERS[code],
                )  # fmt: skip
        axes.set_title(f"{rig.name}: {len(tensions):,} wrenches" if len(tensions) > 1 else rig.name)
        axes.set_yticks(range(rig.m), [module.name for module in rig.modules])
        axes.set(xlabel="tension (N)", ylim=(rig.m - 0.4, -0.6), xlim=(0.0, 1.03 * rig.limits.upper.max()))
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x")
        looks = [(STATUS_MARKS[code], MARKERS[code]) for code in present]
        entries = [(mark.word, {"color": mark.colour, "ls": "", **marker}) for mark, marker in looks]
        limits = ("limits", {"color": GREY, "linewidth": 0.8, "marker": "|", "markersize": 10})
        add_legend(figure, 1 + len(entries), [*entries, limits], ax)
    return figure if ax is None else None
