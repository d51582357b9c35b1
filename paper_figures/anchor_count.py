"""Sweeps that show what the number of modules changes: published rigs, and three to eight modules in one room."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.files import load_rig
from tensionlab.model.layouts import LIMITS, box_corners
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig
from tensionlab.plots.style import add_legend, new_figure
from tensionlab.plots.workspace import (
    SLICE_LEGEND,
    Field,
    cut_title,
    draw_shares,
    draw_slice,
    read_field,
    shade_levels,
    share_above,
)
from tensionlab.support.arrays import Floats
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep import sweep

if TYPE_CHECKING:
    import xarray

# Along X, Y and Z, in m; Y is up, the floor is y = 0, and the Y axis runs through its middle.
ROOM = (4.0, 2.5, 4.0)
METRIC = "capacity-margin"  # without a force to hold, the force that a point rig renders in every direction
LARGEST_SHOWN_N = 6.0  # beyond, no share is above 3 %
POINTS = 61  # of a grid, along the longest edge of its box


def room_rigs() -> list[Rig]:
    """Return rigs of three to eight modules in the room.

    Corners of the room, or of the largest triangle in it that is even about the middle; half of the modules on the
    floor and half on the ceiling, as far as that goes.
    """
    x, z = ROOM[0] / 2, ROOM[2] / 2
    corners = [(x, z), (-x, z), (-x, -z), (x, -z)]
    triangle = [(x, z), (-x, z), (0.0, -z)]
    mirrored = [(a, -b) for a, b in triangle]
    middle = [(0.0, 0.0)]
    return [
        _room_rig("3: triangle on the floor", triangle, []),
        _room_rig("4: every other corner", corners[::2], corners[1::2]),
        _room_rig("5: floor corners, top", corners, middle),
        _room_rig("6: two triangles", triangle, mirrored),
        _room_rig("7: triangle, ceiling corners", triangle, corners),
        _room_rig("8: all corners", corners, corners),
    ]


def sweep_room(points: int = POINTS) -> xarray.Dataset:
    """Sweep the force that the rigs of the room render in every direction, all over it."""
    low, high = np.array([-ROOM[0] / 2, 0.0, -ROOM[2] / 2]), np.array([ROOM[0] / 2, ROOM[1], ROOM[2] / 2])
    return sweep(room_rigs(), _grid(low, high, points), METRIC)


def sweep_published(points: int = POINTS) -> list[xarray.Dataset]:
    """Sweep the same metric for published rigs, each in the box of its anchors."""
    big = load_rig("spidar-big")
    eight = replace(
        box_corners(2 * np.abs(big.anchors[0]), (big.modules[0].lower, big.modules[0].upper)),
        name="spidar-big, 8 wires",
    )
    rigs = [
        load_rig("bartels2026-validation"),
        load_rig("cube-8"),
        replace(big, name="spidar-big, 4 wires"),
        eight,
    ]
    return [sweep(rig, _grid(rig.anchors.min(axis=0), rig.anchors.max(axis=0), points), METRIC) for rig in rigs]


def plot_anchor_count(published: list[xarray.Dataset], room: xarray.Dataset) -> Any:
    """Draw slices of published rigs, one a data set, and of rigs in one room, and what each share of it allows.

    All are from `tensionlab.sweep`, with the same metric.

    Parameters
    ----------
    published : list of Dataset
        One for each rig, from `tensionlab.sweep`.
    room : Dataset
        Of rigs in one room.
    """
    singles, many = [read_field(swept) for swept in published], read_field(room)
    levels = shade_levels([*singles, many])
    with new_figure((12.0, 7.8), dpi=110) as figure:
        figure.suptitle(_finding(many), fontweight="bold")
        above, below = figure.subfigures(2, 1, height_ratios=(1.0, 1.05))  # type: ignore[misc]
        left, right = above.subfigures(1, 2, width_ratios=(2.2, 1.0))
        rooms: Any = left.subplots(2, 3, sharex=True, sharey=True)
        for number, axes in enumerate(rooms.flat):
            shades = draw_slice(axes, many, number, levels)
            axes.label_outer()
        curves: Any = right.subplots()
        draw_shares(curves, many)
        curves.set_xlim(0.0, LARGEST_SHOWN_N)
        handles, _ = curves.get_legend_handles_labels()
        curves.legend(handles=handles[::-1], title="modules", labels=[name[0] for name in many.names][::-1])
        curves.set_title("One room, by its modules")
        panels: Any = below.subplots(1, len(singles))
        for axes, field in zip(panels, singles, strict=True):
            draw_slice(axes, field, 0, levels)
        below.colorbar(shades, ax=panels, label=many.label, orientation="horizontal", shrink=0.5, aspect=50)
        add_legend(figure, 3, SLICE_LEGEND)
    return figure


def _finding(room: Field) -> str:
    """Return the title: how much of the room the fewest useful and the most modules serve."""
    shares = [100.0 * float(share_above(room, number, 1.0)[0]) for number in range(len(room.names))]
    fewest = next(number for number, share in enumerate(shares) if share > 0.0)
    few, many = (room.names[number][0] for number in (fewest, -1))
    return (
        f"{many} modules render 1 N in every direction in {shares[-1]:.0f} % of a room, "
        f"{few} in {shares[fewest]:.0f} %, fewer nowhere (slices: {cut_title(room)})"
    )


def _grid(low: Floats, high: Floats, points: int) -> Grid:
    """Return an even grid with so many points along the longest edge, and one in the middle of every edge."""
    counts = [2 * max(1, round((points - 1) / 2 * edge / (high - low).max())) + 1 for edge in high - low]
    return Grid(*(np.linspace(a, b, count) for a, b, count in zip(low, high, counts, strict=True)))


def _room_rig(name: str, floor: list[tuple[float, float]], ceiling: list[tuple[float, float]]) -> Rig:
    lower, upper = LIMITS
    places = [(x, 0.0, z) for x, z in floor] + [(x, ROOM[1], z) for x, z in ceiling]
    modules = [
        Module(name=str(number), anchor=np.array(place), lower=lower, upper=upper)
        for number, place in enumerate(places, 1)
    ]
    home = np.array([0.0, ROOM[1] / 2, 0.0])
    return Rig(name=name, kind="point", modules=tuple(modules), home=home, up="y")
