"""Layout of a scenario to scale, seen from the side: floor, person, modules, cables, paths, surfaces and brakes.

Drawn in a cabinet projection: what lies across the view keeps its lengths and angles, and depth goes up to the
right, shortened. So sizes can be read off, and parts behind one another are still seen apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.haptics.effects import Plane
from tensionlab.plots.rig import body_outlines, draw_bodies
from tensionlab.plots.style import Entry
from tensionlab.scenarios.scenery import ScenerySurface, scenery, standing_person
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.model.rig import Rig
    from tensionlab.scenarios import Scenario

DEPTH = (0.40, 0.25)  # right and up, for each metre of depth
FLOOR_COLOUR, SURFACE_COLOUR = "#DDDDDD", "#56B4E9"
TILE_M = 0.5  # side of a tile of the floor, in m
PATCH_M = 0.25  # half the side of the patch that is drawn for a wall, in m
ARC = np.radians(np.linspace(-16.0, 16.0, 33))  # angles of the arc that marks the end of a reach
LOOKS: dict[str, dict[str, Any]] = {
    "module in the room": {"color": BLUE, "marker": "s", "linestyle": "", "markersize": 9},
    "module on the body": {"color": ORANGE, "marker": "s", "linestyle": "", "markersize": 9},
    "cable": {"color": "#333333", "linewidth": 1.3},
    "held point": {"color": RED, "marker": "o", "linestyle": "", "markersize": 9},
    "its path": {"color": RED, "linewidth": 1.4, "alpha": 0.55},
    "virtual surface": {"color": SURFACE_COLOUR, "linewidth": 2.4},
    "where brakes hold": {"color": GREEN, "linewidth": 2.4},
}
View = Callable[[Floats], Floats]  # projection of points (..., d) to the figure, (..., 2)


def view_of(rig: Rig) -> View:
    """Return the projection that shows x to the right and what is up upwards."""
    across, upwards, deep = (1.0, 0.0), (0.0, 1.0), np.array(DEPTH)
    vectors = {
        "x": [upwards, across, -deep],
        "y": [across, upwards, -deep],
        "z": [across, deep, upwards],
    }["xyz"[up_of(rig)]]
    axes = np.array(vectors[: rig.dimension])
    return lambda points: np.asarray(points @ axes)


def up_of(rig: Rig) -> int:
    """Return the index of the axis that is up."""
    return "xyz".index(rig.vertical) if rig.dimension == 3 else 1


class Moment(NamedTuple):
    """Places at one moment in the world: held point (d,), anchors (m, d), origins of the body frames (d,)."""

    held: Floats
    anchors: Floats
    bodies: Mapping[str, Floats]


def origin_of(scenario: Scenario, moment: Moment) -> Floats:
    """Return the origin of the coordinates of effects and brakes."""
    return np.zeros_like(moment.held) if scenario.frame is None else moment.bodies[scenario.frame]


def scene_legend(scenarios: Sequence[Scenario]) -> list[Entry]:
    """Return the entries that the legend of these scenarios needs."""
    on_body = [module.frame in scenario.rig.frames for scenario in scenarios for module in scenario.rig.modules]
    surfaces = [
        surface for scenario in scenarios for phase in scenery(scenario).phases for surface in phase.surfaces
    ]
    needed = {
        "virtual surface": any(surface.kind == "plane" and not surface.brakes for surface in surfaces),
        "module in the room": not all(on_body),
        "module on the body": any(on_body),
        "where brakes hold": any(surface.brakes for surface in surfaces),
    }
    return [(name, look) for name, look in LOOKS.items() if needed.get(name, True)]


def draw_scene(
    axes: Axes, scenario: Scenario, moment: Moment, path: Floats
) -> dict[str, list[tuple[float, float]]]:
    """Draw a scenario's layout at one moment, and the path (K, d) of the held point.

    Return the names of points, for `tensionlab.plots.style.label_points`.
    """
    rig, seen, view, up = scenario.rig, scenery(scenario), view_of(scenario.rig), up_of(scenario.rig)
    axes.set_aspect("equal")
    axes.axis("off")
    held_name = seen.held_name(rig)
    if rig.dimension == 3:
        feet = [] if scenario.feet is None else [np.array(scenario.feet)]
        _draw_floor(axes, view, up, np.array([*moment.anchors, *path, moment.held, *feet]))
        if feet:
            places = [(scenario.labels.get(name, name), place) for name, place in moment.bodies.items()]
            bodies, at_rest = standing_person(feet[0], rig.up or "y", [(held_name, moment.held), *places])
            parts = body_outlines(replace(rig, bodies=bodies, rest=(*rig.rest, at_rest)))
            draw_bodies(axes, [view(points) for points in parts])
    origin, names = origin_of(scenario, moment), {}
    drawn = [path[:: max(1, len(path) // 20)]]
    phases_of: dict[ScenerySurface, list[str]] = {}
    for phase in seen.phases:
        for surface in phase.surfaces:
            phases_of.setdefault(surface, []).append(phase.name)
    # From behind: balls, planes, brakes.
    for surface in sorted(phases_of, key=lambda each: (each.brakes, not each.brakes and each.kind == "plane")):
        near = moment.held if surface.brakes else path.mean(axis=0)
        outline = _draw_surface(axes, view, up, surface, origin, near)
        if surface.brakes:
            drawn.append(outline)
        elif len(outline):
            names[", ".join(phases_of[surface])] = [tuple(place) for place in view(outline)]
    axes.plot(*view(path).T, **LOOKS["its path"], zorder=4)
    held = view(moment.held)
    for module, anchor in zip(rig.modules, moment.anchors, strict=True):
        place, on_body = view(anchor), module.frame in rig.frames
        if not on_body:  # a thread to the floor shows where it stands
            foot = view(np.where(np.arange(rig.dimension) == up, 0.0, anchor))
            axes.plot(*zip(place, foot, strict=True), color=BLUE, linewidth=0.9, linestyle=":", zorder=2)
        axes.plot(*zip(place, held, strict=True), **LOOKS["cable"], zorder=5)
        drawn.append(anchor + np.linspace(0.1, 0.9, 9)[:, None] * (moment.held - anchor))
        axes.plot(*place[:, None], **LOOKS["module on the body" if on_body else "module in the room"], zorder=6)
        names[module.name] = [tuple(place)]
    axes.plot(*held[:, None], **LOOKS["held point"], zorder=7)
    return names | {held_name: [tuple(held), *map(tuple, view(np.concatenate(drawn)))]}


def _draw_floor(axes: Axes, view: View, up: int, points: Floats) -> None:
    """Draw tiles below everything; their sides are the scale."""
    low = np.floor(points.min(axis=0) / TILE_M - 0.2) * TILE_M
    high = np.ceil(points.max(axis=0) / TILE_M + 0.2) * TILE_M
    low[up] = high[up] = 0.0
    for axis in {0, 1, 2} - {up}:
        for where in np.arange(low[axis], high[axis] + TILE_M / 2, TILE_M):
            ends = np.array([low, high])
            ends[:, axis] = where
            axes.plot(*view(ends).T, color=FLOOR_COLOUR, linewidth=0.9, zorder=0)


def _draw_surface(
    axes: Axes, view: View, up: int, surface: ScenerySurface, origin: Floats, near: Floats
) -> Floats:
    """Draw a ball, a patch of a plane near a point, or an arc of the end of a reach; return points (K, d) of it.

    A box is not drawn.
    """
    from matplotlib.patches import Circle, Polygon

    if surface.kind == "ball":
        centre = origin + np.array(surface.point)
        outline = Circle(tuple(view(centre)), surface.size[0], facecolor=SURFACE_COLOUR, alpha=0.3, zorder=3)
        axes.add_patch(outline)
        return np.asarray(centre[None])
    if surface.kind == "box":
        return np.empty((0, near.size))
    if surface.kind == "reach":
        arm = near - origin
        size = float(np.linalg.norm(arm))
        ahead = arm / size if size > 0.0 else np.eye(arm.size)[0]
        across = np.eye(arm.size)[up]
        across = across - (across @ ahead) * ahead
        arc = origin + surface.size[0] * (np.cos(ARC)[:, None] * ahead + np.sin(ARC)[:, None] * across)
        axes.plot(*view(arc).T, **LOOKS["where brakes hold"], zorder=3)
        return np.asarray(arc[::4])
    plane = Plane(surface.point, surface.normal)
    normal, colour = plane.n, GREEN if surface.brakes else SURFACE_COLOUR
    middle = near - plane.height(near - origin) * normal
    sides = np.linalg.svd(normal[None])[2][1:]
    if abs(normal[up]) > 0.99:
        sides = np.delete(np.eye(normal.size), up, axis=0)
    elif normal.size == 3:
        upright = np.eye(3)[up] - normal[up] * normal
        upright /= np.linalg.norm(upright)
        sides = np.array([upright, np.cross(normal, upright)])
    signs = [(1, 1), (1, -1), (-1, -1), (-1, 1)] if len(sides) == 2 else [(1,), (-1,)]
    places = middle + PATCH_M * np.array(signs) @ sides
    axes.add_patch(Polygon(view(places), facecolor=colour, edgecolor="none", alpha=0.18, zorder=3))
    axes.add_patch(Polygon(view(places), fill=False, edgecolor=colour, linewidth=1.6, zorder=3))
    edges = places[:, None] + np.linspace(0.0, 1.0, 4)[:-1, None] * (np.roll(places, -1, axis=0) - places)[:, None]
    return np.asarray(edges.reshape(-1, normal.size))
