"""Figures of proved workspaces: slices through their cells."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import InputError
from tensionlab.plots.style import Entry, add_legend, new_figure
from tensionlab.plots.workspace import NONE_COLOUR, PANEL_WIDTH
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tensionlab.workspace.certified import CertifiedWorkspace

PIXELS = 500  # along the longer edge of a slice
COLOURS = (NONE_COLOUR, ORANGE, GREEN)  # colours of cells that are outside, undecided and inside
LEGEND: list[Entry] = [
    (word, {"color": colour, "marker": "s", "markersize": 9, "ls": ""})
    for word, colour in zip(("proved outside", "undecided", "proved inside"), COLOURS, strict=True)
] + [("module", {"color": BLUE, "marker": "s", "ls": ""}), ("home", {"color": GREY, "marker": "+", "ls": ""})]


def plot_certified(proved: CertifiedWorkspace) -> Figure:
    """Draw what is proved in slices through the home, or where the region is nearest to it.

    One slice across each axis of space; one alone where the region is a plane.

    Parameters
    ----------
    proved : CertifiedWorkspace
        From `tensionlab.workspace.certify`.

    Raises
    ------
    InputError
        If the region is a line.

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
    planes = list(combinations(wide, 2))[::-1]
    with new_figure((max(5.0, 1.0 + PANEL_WIDTH * len(planes)), 1.4 + PANEL_WIDTH)) as figure:
        panels: Any = figure.subplots(1, len(planes), squeeze=False)[0]
        for panel, plane in zip(panels, planes, strict=True):
            _draw_slice(panel, proved, *sorted(plane, key=lambda axis: "xyz"[axis] == rig.vertical))
        bounds = f"{proved.volume.describe()} {proved.unit}"
        figure.suptitle(f"{rig.name}: {bounds} inside\nrequired: {proved.required}", fontsize="medium")
        add_legend(figure, 3 if len(planes) == 1 else len(LEGEND), LEGEND)
    return figure


def _draw_slice(panel: Any, proved: CertifiedWorkspace, across: int, along: int) -> None:
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
        cmap=ListedColormap(COLOURS),
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
