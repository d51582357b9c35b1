"""Figures of a search for a layout: the score of each number of modules, and where the best layout has them."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from tensionlab.plots.rig import frame_panel, plot_rig
from tensionlab.plots.style import add_legend, new_figure, one_panel
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREY, ORANGE
from tensionlab.workspace.layout.objective import as_targets
from tensionlab.workspace.poses import PoseList

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.workspace.layout.objective import Targets
    from tensionlab.workspace.layout.results import LayoutSearch
    from tensionlab.workspace.layout.space import Space

ON_FRONT: dict[str, Any] = {"color": BLUE, "marker": "o", "linewidth": 1.4, "drawstyle": "steps-post"}
OFF_FRONT: dict[str, Any] = {"color": GREY, "marker": "o", "linestyle": "", "fillstyle": "none"}


@overload
def plot_front(found: LayoutSearch, *, ax: None = None) -> Figure: ...
@overload
def plot_front(found: LayoutSearch, *, ax: Axes) -> None: ...
def plot_front(found: LayoutSearch, *, ax: Axes | None = None) -> Figure | None:
    """Draw the score of the layouts that a search found against their number of modules.

    The line joins those that none with as many modules or fewer surpasses; ``ax`` is as in `plot_rig`.
    """
    with one_panel(ax, (6.5, 4.2)) as (figure, axes):
        for layouts, look in ((found.layouts, OFF_FRONT), (found.front, ON_FRONT)):
            counts, scores = zip(*((layout.rig.m, layout.score) for layout in layouts), strict=True)
            axes.plot(counts, scores, clip_on=False, **look)
        axes.set_xticks([layout.rig.m for layout in found.layouts])
        axes.set(xlabel="modules", ylabel="score", title=f"score: {found.describe()}")
        axes.set_ylim(bottom=min(0.0, *(layout.score for layout in found.layouts)))
        axes.grid(axis="y")
        looks = [("best with as many modules or fewer", ON_FRONT), ("no better than with fewer", OFF_FRONT)]
        add_legend(figure, 2, looks[: 1 + (len(found.front) < len(found.layouts))], ax)
    return figure if ax is None else None


def plot_search(space: Space, target: Targets, found: LayoutSearch) -> Figure:
    """Draw a search for a layout: where modules might stand, where the best layout has them, and the score.

    ``found`` is what `tensionlab.workspace.search_layout` returned of the space and the target. The last panel,
    that of `plot_front`, is there where several numbers of modules were searched for.

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
        space_axes: Any = figure.add_subplot(1, panels, 1, **projection)
        outlines = [
            corner + np.array(list(product((0.0, 1.0), repeat=len(surface.edges)))) @ edges[: len(surface.edges)]
            for surface, corner, edges in zip(
                (*space.surfaces, *space.attachments), space.placed.corners, space.placed.edges, strict=True
            )
        ]
        outlines = [outline @ image.T for outline in outlines for image in space.images]
        first = len(space.surfaces) * len(space.images)
        outlines[first:] = [outline + best.rig.home for outline in outlines[first:]]
        everything = np.concatenate([*outlines, space.placed.fixed[:, 0], best.rig.home[None]])
        frame_panel(space_axes, everything.min(axis=0), everything.max(axis=0), best.rig.vertical)
        for outline in outlines:
            _draw_edges(space_axes, outline, BLUE)
            if len(outline) == 4 and space.dimension == 3:
                from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

                space_axes.add_collection3d(Poly3DCollection([outline[[0, 1, 3, 2]]], facecolors=BLUE, alpha=0.1))
        space_axes.plot(*space.placed.fixed[:, 0].T, linestyle="", marker="s", markersize=6, color=BLUE)
        space_axes.set_title("where modules may stand" + " and cables end" * bool(space.attachments))
        layout_axes: Any = figure.add_subplot(1, panels, 2, **projection)
        plot_rig(best.rig, ax=layout_axes)
        layout_axes.get_legend().remove()
        for axes, poses in product((space_axes, layout_axes), as_targets(target, space.dimension, turns=True)):
            positions = poses.arrays()[0]
            if isinstance(poses, PoseList):
                axes.plot(*positions.T, color=ORANGE, linewidth=1.4)
                continue
            box = list(product(*zip(positions.min(axis=0), positions.max(axis=0), strict=True)))
            _draw_edges(axes, np.array(box), ORANGE)
        if panels == 3:
            front = figure.add_subplot(1, panels, 3)
            plot_front(found, ax=front)
            front.set_title("what each further module adds")
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
