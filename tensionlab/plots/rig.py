"""A rig to scale: where its modules stand and how its cables run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.style import BLUE, GREY, HALO, ORANGE, RED, add_legend, new_figure

if TYPE_CHECKING:
    from tensionlab.model.rig import Rig


def plot_rig(rig: Rig, path: str | Path) -> None:
    """Draw where a rig's modules stand and how its cables run at home, to scale.

    The axis that the rig says is vertical, y if it does not say.
    Body frames are drawn at the origin of the world, and a planar rig in its plane.

    Parameters
    ----------
    rig : Rig
    path : path
        The suffix chooses the format: png, pdf or svg.

    Raises
    ------
    ShapeError
        If the suffix is no such format.
    """
    spatial = rig.dimension == 3
    ends = rig.home + rig.attachments
    with new_figure(path, (7.5, 7.0)) as figure:
        axes: Any = figure.add_subplot(projection="3d" if spatial else None)
        everything = np.concatenate([rig.anchors, ends])
        low, high = everything.min(axis=0), everything.max(axis=0)
        # Room for the names between the anchors and the axes.
        margin = np.full(rig.dimension, (0.2 if spatial else 0.1) * float((high - low).max()))
        if spatial:
            up = "xyz".index(rig.vertical)
            margin[up] /= 4
        for name, lowest, highest in zip("xyz", low - margin, high + margin, strict=False):
            axes.set(**{f"{name}lim": (lowest, highest), f"{name}label": f"{name} (m)"})
        if spatial:
            axes.view_init(elev=18, azim=-62, vertical_axis="xyz"[up])  # before the aspect, which depends on it
            axes.set_box_aspect(high - low + 2 * margin, zoom=0.85)
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.set_pane_color("white")
                axis.labelpad = 10
                axes.locator_params(nbins=4)
            for anchor in rig.anchors:  # a thread to the floor shows where an anchor is
                foot = anchor.copy()
                foot[up] = low[up] - margin[up]
                axes.plot(*zip(anchor, foot, strict=True), color="#BBBBBB", linewidth=0.8, linestyle=":")
        else:
            axes.set_aspect("equal")
            axes.grid()
        for anchor, end in zip(rig.anchors, ends, strict=True):
            axes.plot(*zip(anchor, end, strict=True), color=GREY, linewidth=1.1)
            axes.plot(*zip(rig.home, end, strict=True), color=RED, linewidth=1.1, alpha=0.5)
        riding = np.array([module.frame in rig.frames for module in rig.modules])
        axes.plot(*rig.anchors[~riding].T, linestyle="", marker="s", markersize=6, color=BLUE)
        axes.plot(*rig.anchors[riding].T, linestyle="", marker="s", markersize=6, color=ORANGE)
        axes.plot(*([part] for part in rig.home), linestyle="", marker="o", markersize=6, color=RED)
        _label_anchors(axes, rig)
        figure.suptitle(rig.name, fontweight="bold")
        add_legend(figure, 4, [
            ("module", {"color": BLUE, "marker": "s", "ls": ""}),
            *([("module on a body", {"color": ORANGE, "marker": "s", "ls": ""})] if riding.any() else []),
            ("cable", {"color": GREY, "linewidth": 1.1}),
            ("platform, home" if rig.attachments.any() else "home", {"color": RED, "marker": "o", "ls": ""}),
        ])  # fmt: skip


def _label_anchors(axes: Any, rig: Rig) -> None:
    """Write the modules' names beside their anchors, one label where they nearly coincide."""
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
