"""Figure of a rig: modules and cables to scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.pulleys import ways
from tensionlab.plots.style import HALO, one_panel, panel_legend
from tensionlab.support.colours import BLUE, GREY, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.model.rig import Rig
    from tensionlab.support.arrays import Floats


MARGIN_INCHES = 0.5  # above and below a rig in space, for the title and the legend


def plot_rig(rig: Rig, *, ax: Axes | None = None) -> Figure:
    """Draw where a rig's modules stand and how its cables run at home, to scale.

    The rig's vertical axis is upright. Body frames are drawn at the origin of the world, a planar rig in its
    plane. With ``ax``, a panel of another figure is drawn into, which for a rig in space has the projection "3d".

    Parameters
    ----------
    rig : Rig
        What is drawn.
    ax : Axes, optional
        Panel of another figure to draw into.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> figure = plots.plot_rig(tl.load_rig("seven-modules"))
    >>> plots.save_figure(figure, "rig.png")
    """
    spatial = rig.dimension == 3
    ends = rig.home + rig.attachments
    with one_panel(ax, (7.5, 7.0), "3d" if spatial else None) as (figure, axes):
        everything = np.concatenate([rig.anchors, ends])
        low, high = everything.min(axis=0), everything.max(axis=0)
        floor = frame_panel(axes, low, high, rig.vertical)
        if spatial:
            up = "xyz".index(rig.vertical)
            for anchor in rig.anchors:  # a thread to the floor shows where an anchor is
                foot = anchor.copy()
                foot[up] = floor[up]
                axes.plot(*zip(anchor, foot, strict=True), color="#BBBBBB", linewidth=0.8, linestyle=":")
        for way, end in zip(np.swapaxes(ways(ends, rig.anchors, rig.pulleys), 0, 1), ends, strict=True):
            axes.plot(*way.T, color=GREY, linewidth=1.1)
            axes.plot(*zip(rig.home, end, strict=True), color=RED, linewidth=1.1, alpha=0.5)
        on_body = np.array([module.frame in rig.frames for module in rig.modules])
        axes.plot(*rig.anchors[~on_body].T, linestyle="", marker="s", markersize=6, color=BLUE)
        axes.plot(*rig.anchors[on_body].T, linestyle="", marker="s", markersize=6, color=ORANGE)
        axes.plot(*([part] for part in rig.home), linestyle="", marker="o", markersize=6, color=RED)
        _label_anchors(axes, rig)
        if ax is None:
            figure.suptitle(rig.name, fontweight="bold")
        else:
            axes.set_title(rig.name)
        panel_legend(figure, ax, 4, [
            ("module", {"color": BLUE, "marker": "s", "ls": ""}),
            *([("module on a body", {"color": ORANGE, "marker": "s", "ls": ""})] if on_body.any() else []),
            ("cable", {"color": GREY, "linewidth": 1.1}),
            ("platform, home" if rig.attachments.any() else "home", {"color": RED, "marker": "o", "ls": ""}),
        ])  # fmt: skip
    if spatial and ax is None:
        _crop(figure, axes)
    return figure


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


def _label_anchors(axes: Any, rig: Rig) -> None:
    """Write the modules' names next to their anchors, one label where they nearly coincide."""
    from mpl_toolkits.mplot3d import proj3d  # type: ignore[import-untyped]

    points = np.vstack([rig.anchors, rig.home])
    if rig.dimension == 3:
        x, y, _ = proj3d.proj_transform(*points.T, axes.get_proj())
        points = np.column_stack([x, y])
    points, home = points[:-1], points[-1]
    near = 0.05 * float(np.ptp(points, axis=0).max())
    left = list(range(rig.m))
    while left:
        together = [index for index in left if np.linalg.norm(points[index] - points[left[0]]) <= near]
        left = [index for index in left if index not in together]
        place = points[together].mean(axis=0)
        outward = (place - home) / (np.linalg.norm(place - home) + 1e-12)
        axes.annotate(
            ", ".join(rig.modules[index].name for index in together), place, xytext=10 * outward,
            textcoords="offset points", color="#222222", zorder=10, bbox=HALO,
            ha="center" if abs(outward[0]) < 0.5 else "left" if outward[0] > 0 else "right",
            va="center" if abs(outward[1]) < 0.5 else "bottom" if outward[1] > 0 else "top",
        )  # fmt: skip
