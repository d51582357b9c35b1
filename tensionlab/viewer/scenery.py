"""What is drawn around a rig of the scenario that it plays, as arrays: surfaces, the person, and names."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.kinematics import in_space
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery, Surface
from tensionlab.scenarios.stick_figure import stick_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import GREEN, GREY, rgb
from tensionlab.viewer.instant import Instant
from tensionlab.viewer.scene import Label, Lines, both_ends
from tensionlab.viewer.volume import Mesh

SURFACE_COLOUR, PERSON_COLOUR = "#56B4E9", "#B8B8B8"
PATCH_M = 0.25
"""Half the side of the patch that stands for a plane, in m."""
CAP_RAD = 0.28
"""From the middle of the cap that stands for the end of a reach to its edge."""
CAP_STEPS, BALL_STEPS = 8, 12


@dataclass(frozen=True, eq=False)
class DrawnSurface:
    """Surface: a mesh, lines along its edges, and its colour; without faces where its phase is over or to come."""

    mesh: Mesh
    edges: Lines
    colour: str


@dataclass(frozen=True, eq=False)
class SceneryScene:
    """All that is drawn around a rig.

    Attributes
    ----------
    surfaces : tuple of DrawnSurface
        Of all phases, in their order.
    person : Lines
        Limbs and trunk of the person; none if no person is drawn.
    head : (3,) array or None
    labels : tuple of Label
        Names of the held point, of bodies, and of phases at their surfaces.
    """

    surfaces: tuple[DrawnSurface, ...]
    person: Lines
    head: Floats | None
    labels: tuple[Label, ...]

    @property
    def points(self) -> Floats:
        """All points (k, 3) that are to be seen, in m."""
        parts = [self.person.points.reshape(-1, 3), *(each.edges.points.reshape(-1, 3) for each in self.surfaces)]
        return np.concatenate([*parts, np.empty((0, 3)) if self.head is None else self.head[None]])


def draw_scenery(scenery: Scenery, rig: Rig, instant: Instant, *, fresh: bool = True) -> SceneryScene:
    """Return what is drawn around a rig at an instant of a run; where it is not fresh, no phase is in progress."""
    bodies = body_origins(rig, instant.anchors)
    origin = in_space(np.zeros(rig.dimension) if scenery.seen_from is None else bodies[scenery.seen_from])
    up = in_space(rig.upward) if rig.up is not None else np.array([0.0, 1.0, 0.0])
    active = scenery.active_phases(instant.time) if fresh else ()
    surfaces: list[DrawnSurface] = []
    names: dict[str, Label] = {}
    for phase in scenery.phases:
        for surface in phase.surfaces:
            mesh, rim = _shape(surface, origin, in_space(np.array(scenery.middle)), up)
            now = phase in active
            colour = (GREEN if surface.brakes else SURFACE_COLOUR) if now else GREY
            shown = mesh if now else replace(mesh, faces=mesh.faces[:0])
            surfaces.append(DrawnSurface(shown, _lines(rim, colour), colour))
            if now:
                names.setdefault(phase.name, Label(rim[0, 0], phase.name))
    places = {scenery.held_name(rig) or "hand": in_space(instant.hand)}
    places |= {(scenery.labels or {}).get(name, name): in_space(place) for name, place in bodies.items()}
    person, head = _person(scenery, up, places)
    labels = [Label(place, name) for name, place in places.items()]
    return SceneryScene(tuple(surfaces), person, head, (*labels, *names.values()))


def body_origins(rig: Rig, anchors: Floats) -> dict[str, Floats]:
    """Return the origins of the body frames, (d,) in m, by anchors in the world (m, d), if none has turned."""
    pairs = zip(rig.modules, anchors, strict=True)
    return {module.frame: anchor - module.anchor for module, anchor in pairs if module.frame in rig.frames}


def _lines(points: Floats, colour: str) -> Lines:
    return Lines(points, both_ends(np.broadcast_to(rgb(colour), (len(points), 3))))


def _person(scenery: Scenery, up: Floats, places: dict[str, Floats]) -> tuple[Lines, Floats | None]:
    """Return limbs and trunk, and the middle of the head, of a person whose parts with these names are there."""
    if scenery.stands is None:
        return _lines(np.empty((0, 2, 3)), PERSON_COLOUR), None
    figure = stick_figure(in_space(np.array(scenery.stands)), up, list(places.items()))
    pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in figure.lines]
    return _lines(np.concatenate(pieces), PERSON_COLOUR), figure.head


def _shape(surface: Surface, origin: Floats, middle: Floats, up: Floats) -> tuple[Mesh, Floats]:
    """Return a surface as a mesh and the segments (k, 2, 3) of its edges, near a point of the world."""
    point = origin + in_space(np.array(surface.point))
    if surface.kind == "plane":
        normal = in_space(np.array(surface.normal))
        normal = normal / np.linalg.norm(normal)
        return _patch(middle - ((middle - point) @ normal) * normal, normal, up)
    if surface.kind == "box":
        return _box(point, in_space(np.array(surface.size)))
    if surface.kind == "ball":
        return _ball(point, surface.size[0], up)
    return _cap(point, surface.size[0], middle - point, up)


def _across(normal: Floats, up: Floats) -> Floats:
    """Return two unit vectors (2, 3) across a unit vector, the first one upwards as far as it can be."""
    first = up - (up @ normal) * normal
    if np.linalg.norm(first) < 0.1:
        aside = np.roll(up, 1)
        first = aside - (aside @ normal) * normal
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _ring(corners: Floats) -> Floats:
    """Return the segments (k, 2, 3) around corners (k, 3)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _patch(middle: Floats, normal: Floats, up: Floats) -> tuple[Mesh, Floats]:
    corners = middle + PATCH_M * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) @ _across(normal, up)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]])), _ring(corners)


def _box(middle: Floats, size: Floats) -> tuple[Mesh, Floats]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    corners = middle + signs * size / 2
    edges = np.array([[a, a | bit] for bit in (1, 2, 4) for a in range(8) if not a & bit])
    return Mesh(corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])), corners[edges]


def _grid(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the triangles (k, 3) between rows of as many points."""
    corner = np.arange((rows - 1) * columns).reshape(rows - 1, columns)[:, :-1].ravel()
    low = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    high = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return np.concatenate([low, high])


def _ball(middle: Floats, radius: float, up: Floats) -> tuple[Mesh, Floats]:
    """Return a ball, whose edge is its equator."""
    level = _across(up, up)
    heights, turns = np.linspace(-0.5, 0.5, BALL_STEPS + 1), np.linspace(0.0, 2.0, 2 * BALL_STEPS + 1)
    height, turn = np.pi * np.stack(np.meshgrid(heights, turns, indexing="ij"))
    around = np.cos(turn)[..., None] * level[0] + np.sin(turn)[..., None] * level[1]
    points = middle + radius * (np.cos(height)[..., None] * around + np.sin(height)[..., None] * up)
    faces = _grid(*height.shape)
    return Mesh(points.reshape(-1, 3), faces), _ring(points[BALL_STEPS // 2, :-1])


def _cap(middle: Floats, radius: float, towards: Floats, up: Floats) -> tuple[Mesh, Floats]:
    """Return the part of a sphere in a direction."""
    size = float(np.linalg.norm(towards))
    ahead = towards / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    angles = np.linspace(-CAP_RAD, CAP_RAD, CAP_STEPS + 1)
    first, second = np.meshgrid(np.tan(angles), np.tan(angles), indexing="ij")
    sides = _across(ahead, up)
    rays = ahead + first[..., None] * sides[0] + second[..., None] * sides[1]
    points = middle + radius * rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    rim = np.concatenate([points[0, :-1], points[:-1, -1], points[-1, :0:-1], points[:0:-1, 0]])
    return Mesh(points.reshape(-1, 3), _grid(*first.shape)), _ring(rim)
