"""Portraits of solvers: what each makes of one rig of four cables in a plane, inside and beyond what is feasible.

The rig is small enough to be drawn whole: a wrench has two components, so all of them are a picture. Two of its
cables run nearly side by side and the fourth is weak, which is where solvers differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import tensionlab as tl
from tensionlab.plots.style import new_figure
from tensionlab.support.colours import BLUE, GREY, RED

ANCHORS = ((1.2, 1.1), (0.8, 0.6), (0.2, -1.3), (-1.1, 0.5))
LOWER, UPPER = 1.0, (10.0, 10.0, 10.0, 4.0)
ALONG_X, ALONG_Y = np.linspace(-6.0, 20.0, 157), np.linspace(-11.0, 16.0, 163)  # forces of the map, in N
# Along which the force grows in the second panel.
DIRECTION = np.array([np.cos(np.radians(60.0)), np.sin(np.radians(60.0))])
SIZES = np.linspace(0.0, 18.0, 721)
PATH_FORCE = (4.0, 3.0)
# Of the hand in the third panel, in m, with a constant force in N.
PATH = np.stack([np.linspace(-0.4, 0.4, 801), np.zeros(801)], axis=1)
DIGITS = 6  # values are rounded to so many, so that no processor's last digit is seen
RENDERED, NEAREST, MISSED, NOTHING = "#B9D7EA", "#D8D8D8", RED, "#F7F0DE"
CABLES = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
DASHES = ("-", "--", "-.", ":")

# Solvers that have a portrait.
PORTRAYED = (
    "newton", "dykstra", "pseudoinverse:middle", "closed-form", "puncture", "polygon:centroid", "least-sum",
    "minimax", "safe", "analytic-centre", "slack", "spidar",
)  # fmt: skip
# What the third panel shows in place of the tensions along a path.
THIRD = {"dykstra": "iterations", "closed-form": "error", "slack": "error", "spidar": "error"}


def demonstration_rig() -> tl.Rig:
    """Return the rig of all portraits."""
    modules = [
        tl.Module(f"cable {number}", np.array(anchor), LOWER, upper)
        for number, (anchor, upper) in enumerate(zip(ANCHORS, UPPER, strict=True), start=1)
    ]
    return tl.Rig("four cables in a plane", "planar-point", tuple(modules), np.zeros(2))


@dataclass(frozen=True)
class Portrait:
    """What one solver answers, with the exact solver's answers beside it."""

    solver: str
    feasible: Any
    status: Any
    line: tl.Allocation
    least_error: Any
    line_edge: float
    path: tl.Allocation
    outline: Any


def portrait(solver: str) -> Portrait:
    """Have a solver answer all wrenches of the map, of the line and of the path."""
    rig = demonstration_rig()
    W, limits = rig.structure_matrix(rig.home), rig.limits
    wrenches = np.stack(np.meshgrid(ALONG_X, ALONG_Y), axis=-1)
    feasible = tl.allocate(W, wrenches, limits).status == tl.Status.EXACT
    line = SIZES[:, None] * DIRECTION
    exact = tl.allocate(W, line, limits)
    reached = exact.status == tl.Status.EXACT
    return Portrait(
        solver,
        feasible,
        tl.allocate(W, wrenches, limits, solver).status,
        tl.allocate(W, line, limits, solver),
        exact.residual,
        float(SIZES[reached].max()),
        tl.allocate(rig.structure_matrix(PATH), np.array(PATH_FORCE), limits, solver),
        tl.workspace.vertices(W, limits),
    )


def draw_portrait(found: Portrait) -> Any:
    """Draw the map, the line and the path of one solver."""
    with new_figure((7.6, 3.2), dpi=130) as figure:
        maps, line, third = figure.subplots(1, 3, width_ratios=(1.0, 1.2, 1.2))
        draw_map(maps, found)
        draw_tensions(line, SIZES, found.line, "force along the arrow (N)")
        line.axvspan(found.line_edge, SIZES[-1], color="#EEEEEE", zorder=0)
        line.annotate("infeasible", (found.line_edge + 0.2, 0.2), color=GREY, fontsize=8)
        line.set_title("As the force grows")
        what = THIRD.get(found.solver)
        if what is None:
            draw_tensions(third, PATH[:, 0], found.path, "hand along x (m)")
            third.set_title("As the hand moves")
        else:
            draw_third(third, found, what)
        handles, labels = line.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=2)
        figure.legend(handles=patches(found), loc="outside lower left", ncols=2)
    return figure


def draw_map(axes: Any, found: Portrait) -> None:
    """Draw which wrenches the solver renders, and the edge of those that are feasible."""
    from matplotlib.colors import ListedColormap

    exact = found.status == tl.Status.EXACT
    kinds = np.select([exact, found.feasible, found.status == tl.Status.NEAREST], [0, 2, 1], 3)
    axes.imshow(
        kinds, extent=(*ALONG_X[[0, -1]], *ALONG_Y[[0, -1]]), origin="lower",
        interpolation="nearest", vmin=0, vmax=3, cmap=ListedColormap([RENDERED, NEAREST, MISSED, NOTHING]),
    )  # fmt: skip
    axes.plot(*np.vstack([found.outline, found.outline[:1]]).T, color="#222222", linewidth=1.0)
    axes.annotate("", 0.9 * SIZES[-1] * DIRECTION, (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": "#222222"})
    share = np.count_nonzero(exact & found.feasible) / np.count_nonzero(found.feasible)
    axes.set(xlabel="force along x (N)", ylabel="along y (N)", title=f"Renders {words(share)}")


def words(share: float) -> str:
    """Write a share, with 100 % only for all."""
    return f"{100 * share:.0f} %" if share in (0.0, 1.0) else f"{min(99.9, 100 * share):.1f} %"


def patches(found: Portrait) -> list[Any]:
    """Return what the legend of the map shows: only kinds that are in it."""
    from matplotlib.patches import Patch

    exact, nearest = found.status == tl.Status.EXACT, found.status == tl.Status.NEAREST
    kinds = [
        ("rendered", RENDERED, exact.any()),
        ("feasible, but missed", MISSED, (found.feasible & ~exact).any()),
        ("certified infeasible", NEAREST, nearest.any()),
        ("infeasible, no promise", NOTHING, (~found.feasible & ~nearest).any()),
    ]
    return [Patch(facecolor=colour, edgecolor="#888888", label=word) for word, colour, there in kinds if there]


def draw_tensions(axes: Any, across: Any, allocation: tl.Allocation, label: str) -> None:
    """Draw the tension of each cable, and dots where the answer is not exact."""
    tensions = np.round(allocation.tensions, DIGITS)
    for cable, (colour, dashes) in enumerate(zip(CABLES, DASHES, strict=True)):
        axes.plot(across, tensions[:, cable], dashes, color=colour, label=f"cable {cable + 1}")
    axes.set(xlabel=label, ylabel="tension (N)", ylim=(0.0, 10.8), xlim=(across[0], across[-1]))


def draw_third(axes: Any, found: Portrait, what: str) -> None:
    """Draw the iterations or the error of the wrench along the line of the second panel."""
    if what == "iterations":
        axes.semilogy(SIZES, np.maximum(found.line.iterations, 1), color=BLUE)
        axes.set(ylabel="iterations", title="Iterations")
    else:
        axes.semilogy(SIZES, np.maximum(found.line.residual, 1e-12), color=BLUE, label=found.solver)
        axes.semilogy(SIZES, np.maximum(found.least_error, 1e-12), ":", color="#222222", label="least possible")
        axes.legend(loc="lower right")
        axes.semilogy(SIZES, tl.solvers.base.TOLERANCE * np.maximum(1.0, SIZES), "--", color=GREY, linewidth=0.8)
        axes.annotate("EXACT below", (0.3, 1.2e-7), color=GREY, fontsize=8)
        axes.set(ylabel="error of the wrench (N)", title="Error")
    axes.axvspan(found.line_edge, SIZES[-1], color="#EEEEEE", zorder=0)
    axes.set(xlabel="force along the arrow (N)", xlim=(SIZES[0], SIZES[-1]))
