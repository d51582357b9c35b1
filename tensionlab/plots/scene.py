"""A scenario's layout to scale, seen from the side: floor, person, modules, cables, paths, and what brakes hold.

Drawn in a cabinet projection: what lies across the view keeps its lengths and angles, and depth goes up to the
right, shortened. So sizes can be read off, and what stands behind one another is still told apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.plots.person import Place, draw_person
from tensionlab.plots.style import BLUE, GREEN, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.model.rig import Rig
    from tensionlab.scenarios import BrakeTarget, Phase, Scenario

DEPTH = (0.40, 0.25)
"""Right and up, for each metre of depth."""
FLOOR = "#DDDDDD"
SKY = "#56B4E9"
TILE = 0.5
"""Side of a tile of the floor, in m."""
PATCH = 0.25
"""Half the side of the patch that stands for a wall, in m."""
ARC = np.radians(np.linspace(-16.0, 16.0, 33))
"""Of the circle that stands for the end of a reach."""
LOOKS: dict[str, dict[str, Any]] = {
    "module in the room": {"color": BLUE, "marker": "s", "linestyle": "", "markersize": 9},
    "module on the body": {"color": ORANGE, "marker": "s", "linestyle": "", "markersize": 9},
    "cable": {"color": "#333333", "linewidth": 1.3},
    "what the cables hold": {"color": RED, "marker": "o", "linestyle": "", "markersize": 9},
    "its path": {"color": RED, "linewidth": 1.4, "alpha": 0.55},
    "surface to be felt": {"color": SKY, "linewidth": 2.4},
    "where brakes hold": {"color": GREEN, "linewidth": 2.4},
}


@dataclass(frozen=True, eq=False)
class View:
    """How is space seen?

    Attributes
    ----------
    axes : (d, 2) array
        Where each axis of the world points in the picture.
    up : int
        Which axis is up.
    """

    axes: Floats
    up: int

    def __call__(self, points: Floats) -> Floats:
        """Where are points (..., d) seen, (..., 2)?"""
        return np.asarray(points @ self.axes)


def view_of(rig: Rig) -> View:
    """How is a rig to be seen: x to the right, what is up upwards?"""
    across, upwards, deep = (1.0, 0.0), (0.0, 1.0), np.array(DEPTH)
    if rig.dimension == 2:
        return View(np.array([across, upwards]), 1)
    if rig.vertical == "z":
        return View(np.array([across, deep, upwards]), 2)
    if rig.vertical == "x":
        return View(np.array([upwards, across, -deep]), 0)
    return View(np.array([across, upwards, -deep]), 1)


@dataclass(frozen=True, eq=False)
class Moment:
    """Where is everything at one moment, in the world?

    Attributes
    ----------
    held : (d,) array
        The point that the cables hold.
    anchors : (m, d) array
        Of the modules.
    bodies : mapping of str to (d,) array
        The origins of the body frames.
    """

    held: Floats
    anchors: Floats
    bodies: Mapping[str, Floats]


def scripted(scenario: Scenario, time: float) -> Moment:
    """Where is everything meant to be at a time?"""
    bodies = {name: script.position(time) for name, script in scenario.person.bodies.items()}
    nowhere = np.zeros(scenario.rig.dimension)
    anchors = np.array([each.anchor + bodies.get(each.frame, nowhere) for each in scenario.rig.modules])
    return Moment(scenario.person.script.position(time), anchors, bodies)


def origin_of(scenario: Scenario, moment: Moment) -> Floats:
    """Where is that from which effects and holds are seen?"""
    return np.zeros_like(moment.held) if scenario.seen_from is None else moment.bodies[scenario.seen_from]


def held_name(scenario: Scenario) -> str:
    """What is that called which the cables hold?"""
    return next((word for key, word in scenario.labels.items() if key not in scenario.rig.frames), "held point")


def draw_scene(
    axes: Axes, scenario: Scenario, moment: Moment, path: Floats
) -> dict[str, list[tuple[float, float]]]:
    """Draw a scenario's layout at one moment, and the path (K, d) of what the cables hold.

    Returns
    -------
    dict
        The names that belong beside points, for `tensionlab.plots.labels.label_points`.
    """
    rig, view = scenario.rig, view_of(scenario.rig)
    axes.set_aspect("equal")
    axes.axis("off")
    if rig.dimension == 3:
        stands = [] if scenario.stands is None else [np.array(scenario.stands)]
        _draw_floor(axes, view, np.array([*moment.anchors, *path, moment.held, *stands]))
        if scenario.stands is not None:
            parts = [Place(held_name(scenario), moment.held)]
            parts += [Place(scenario.labels.get(name, name), place) for name, place in moment.bodies.items()]
            draw_person(axes, view, view.up, np.array(scenario.stands), parts)
    origin = origin_of(scenario, moment)
    drawn = [path[:: max(1, len(path) // 20)]]
    names: dict[str, list[tuple[float, float]]] = {}
    for name, outline in _draw_surfaces(axes, view, scenario, origin, path.mean(axis=0)).items():
        names[name] = [tuple(place) for place in view(outline)]
    for phase in scenario.phases:
        if phase.hold is not None:
            drawn.append(_draw_hold(axes, view, phase.hold, origin, moment.held))
    axes.plot(*view(path).T, **LOOKS["its path"], zorder=4)
    held = view(moment.held)
    for module, anchor in zip(rig.modules, moment.anchors, strict=True):
        seen, rides = view(anchor), module.frame in rig.frames
        if not rides:  # a thread to the floor shows where it stands
            foot = view(np.where(np.arange(rig.dimension) == view.up, 0.0, anchor))
            axes.plot(*zip(seen, foot, strict=True), color=BLUE, linewidth=0.9, linestyle=":", zorder=2)
        axes.plot(*zip(seen, held, strict=True), **LOOKS["cable"], zorder=5)
        drawn.append(anchor + np.linspace(0.1, 0.9, 9)[:, None] * (moment.held - anchor))
        axes.plot(*seen[:, None], **LOOKS["module on the body" if rides else "module in the room"], zorder=6)
    axes.plot(*held[:, None], **LOOKS["what the cables hold"], zorder=7)
    names |= {each.name: [tuple(view(anchor))] for each, anchor in zip(rig.modules, moment.anchors, strict=True)}
    return names | {held_name(scenario): [tuple(held), *map(tuple, view(np.concatenate(drawn)))]}


def looks_of(scenarios: list[Scenario]) -> list[tuple[str, dict[str, Any]]]:
    """Which entries does the legend of these scenarios need?"""
    bodily = [module.frame in each.rig.frames for each in scenarios for module in each.rig.modules]
    holds = any(phase.hold is not None for each in scenarios for phase in each.phases)
    flat = any(plane_of(phase) is not None for each in scenarios for phase in each.phases)
    left_out = {
        "surface to be felt": not flat,
        "module in the room": all(bodily),
        "module on the body": not any(bodily),
        "where brakes hold": not holds,
    }
    return [(name, look) for name, look in LOOKS.items() if not left_out.get(name, False)]


def _draw_floor(axes: Axes, view: View, points: Floats) -> None:
    """Draw tiles below everything; their sides are the scale."""
    low = np.floor(points.min(axis=0) / TILE - 0.2) * TILE
    high = np.ceil(points.max(axis=0) / TILE + 0.2) * TILE
    low[view.up] = high[view.up] = 0.0
    flat = [axis for axis in range(3) if axis != view.up]
    for one in flat:
        for where in np.arange(low[one], high[one] + TILE / 2, TILE):
            ends = np.array([low, high])
            ends[:, one] = where
            axes.plot(*view(ends).T, color=FLOOR, linewidth=0.9, zorder=0)


def plane_of(phase: Phase, names: Sequence[str] = ("plane", "surface")) -> Any:
    """Which flat surface is in a phase, if any? An effect's own, by these names, or that of its wall."""
    for effect in phase.effects.values():
        for part in (effect, getattr(effect, "wall", None)):
            for name in names:
                if hasattr(part, name):
                    return getattr(part, name)
    return None


def _draw_surfaces(
    axes: Axes, view: View, scenario: Scenario, origin: Floats, middle: Floats
) -> dict[str, Floats]:
    """Draw flat surfaces and balls; where, by the names of the phases in which they are felt?"""
    from matplotlib.patches import Circle

    together: dict[Any, list[str]] = {}
    drawn: dict[str, Floats] = {}
    for phase in scenario.phases:
        if (plane := plane_of(phase)) is not None:
            together.setdefault(plane, []).append(phase.name)
        for effect in phase.effects.values():
            ball: Any = getattr(effect, "field", None)
            if hasattr(ball, "radius"):
                centre = origin + np.array(ball.centre)
                axes.add_patch(Circle(tuple(view(centre)), ball.radius, facecolor=SKY, alpha=0.3, zorder=3))
                drawn[phase.name] = centre[None]
    for plane, names in together.items():
        foot = middle - plane.height(middle - origin) * plane.n
        drawn[", ".join(names)] = draw_patch(axes, view, foot, plane.n, SKY)
    return drawn


def _draw_hold(axes: Axes, view: View, hold: BrakeTarget, origin: Floats, held: Floats) -> Floats:
    """Draw a patch of the wall, or an arc of the end of the reach, where they are nearest to what is held.

    Returns points of it, (K, d).
    """
    arm = held - origin
    if hold.reach is not None:
        size = float(np.linalg.norm(arm))
        ahead = arm / size if size > 0.0 else np.eye(arm.size)[0]
        across = np.eye(arm.size)[view.up]
        across = across - (across @ ahead) * ahead
        turned = np.cos(ARC)[:, None] * ahead + np.sin(ARC)[:, None] * across
        axes.plot(*view(origin + hold.reach * turned).T, **LOOKS["where brakes hold"], zorder=3)
        return np.asarray(origin + hold.reach * turned[::4])
    assert hold.plane is not None
    foot = held - hold.plane.height(arm) * hold.plane.n
    return draw_patch(axes, view, foot, hold.plane.n, GREEN)


def draw_patch(axes: Axes, view: View, middle: Floats, normal: Floats, colour: str) -> Floats:
    """Draw a square of a plane, or where space is flat a stretch of a line; returns points of its edge."""
    from matplotlib.patches import Polygon

    sides = np.linalg.svd(normal[None])[2][1:]
    if abs(normal[view.up]) > 0.99:
        sides = np.delete(np.eye(normal.size), view.up, axis=0)
    elif normal.size == 3:
        upright = np.eye(3)[view.up] - normal[view.up] * normal
        upright /= np.linalg.norm(upright)
        sides = np.array([upright, np.cross(normal, upright)])
    signs = [(1, 1), (1, -1), (-1, -1), (-1, 1)] if len(sides) == 2 else [(1,), (-1,)]
    places = middle + PATCH * np.array(signs) @ sides
    corners = view(places)
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="none", alpha=0.18, zorder=3))
    axes.add_patch(Polygon(corners, fill=False, edgecolor=colour, linewidth=1.6, zorder=3))
    edges = places[:, None] + np.linspace(0.0, 1.0, 4)[:-1, None] * (np.roll(places, -1, axis=0) - places)[:, None]
    return np.asarray(edges.reshape(-1, normal.size))
