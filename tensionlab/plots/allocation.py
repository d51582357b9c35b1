"""Figure of an allocation: the tensions of each cable between its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import ShapeError
from tensionlab.plots.style import one_panel, panel_legend
from tensionlab.support.colours import GREY
from tensionlab.support.table import STATUS_MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.allocation import Allocation
    from tensionlab.model.rig import Rig

MARKERS: tuple[dict[str, Any], ...] = (
    {"marker": "o"},
    {"marker": "o", "fillstyle": "none"},
    {"marker": "^"},
    {"marker": "x"},
)  # shape of each `Status`, in its order
FEW = 50  # fewer wrenches are drawn as larger dots
MAX_DOTS = 2000  # largest number of wrenches drawn for each status, evenly spread
SPREAD = 0.12  # half the height of a row's dots, as a share of the row: spread out, many of the same tension show


def plot_allocation(allocation: Allocation, rig: Rig, *, ax: Axes | None = None) -> Figure:
    """Draw the tensions of each cable between its limits, a row a cable, by status.

    One wrench is one dot a cable, several are a cloud of dots for each status. With ``ax``, a panel of another
    figure is drawn into.

    Parameters
    ----------
    allocation : Allocation
        Of one wrench or of many.
    rig : Rig
        Whose modules they are.
    ax : Axes, optional
        Panel of another figure to draw into.

    Raises
    ------
    ShapeError
        If the rig has another number of cables.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> result = tl.allocate(rig.structure_matrix(rig.home), [1.0, 0.5, 1.0], rig.limits)
    >>> figure = plots.plot_allocation(result, rig)
    """
    if allocation.tensions.shape[-1] != rig.m:
        raise ShapeError(f"the allocation has {allocation.tensions.shape[-1]} cables, and {rig.name} has {rig.m}")
    tensions, status = allocation.tensions.reshape(-1, rig.m), np.ravel(allocation.status)
    there, few = np.unique(status), len(tensions) < FEW
    with one_panel(ax, (7.5, 1.4 + 0.45 * rig.m)) as (figure, axes):
        for row, module in enumerate(rig.modules):
            axes.plot(
                [module.lower, module.upper], [row, row], color=GREY, linewidth=0.8, marker="|", markersize=14
            )
        for place, each in enumerate(there):
            index = np.flatnonzero(status == each)
            index = index[np.linspace(0, len(index) - 1, min(len(index), MAX_DOTS)).astype(int)]
            height = 0.6 * ((place + 0.5) / len(there) - 0.5) * (len(there) > 1)
            # The golden ratio spreads any number of dots evenly.
            spread = SPREAD * (2 * np.modf(0.618034 * np.arange(len(index)))[0] - 1) * (len(index) > 1)
            for row in range(rig.m):
                axes.plot(
                    tensions[index, row], row + height + spread, linestyle="", color=STATUS_MARKS[each].colour,
                    markersize=6 if few else 3, alpha=1.0 if few else 0.5, zorder=3, **MARKERS[each],
                )  # fmt: skip
        axes.set_title(f"{rig.name}: {len(tensions):,} wrenches" if len(tensions) > 1 else rig.name)
        axes.set_yticks(range(rig.m), [module.name for module in rig.modules])
        axes.set(xlabel="tension (N)", ylim=(rig.m - 0.4, -0.6), xlim=(0.0, 1.03 * rig.limits.upper.max()))
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x")
        words = [
            (STATUS_MARKS[each].word, {"color": STATUS_MARKS[each].colour, "ls": "", **MARKERS[each]})
            for each in there
        ]
        limits = ("limits", {"color": GREY, "linewidth": 0.8, "marker": "|", "markersize": 10})
        panel_legend(figure, ax, 1 + len(words), [*words, limits])
    return figure
