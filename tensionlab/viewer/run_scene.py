"""Data of a run in one cycle, and how they are drawn: cables by measured tension, forces, the scenario around."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import measured_wrench
from tensionlab.model.kinematics import in_space
from tensionlab.model.pose import CoordinateFrame
from tensionlab.model.pulleys import ARC_POINTS, ways
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery, ScenerySurface, standing_person
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import FORCE_COLOURS, GREEN, GREY, RED, Colours, ramp, rgb
from tensionlab.viewer.bodies import BodyDrawing, BodyScene, draw_bodies, pose_matrix
from tensionlab.viewer.html import tension_text
from tensionlab.viewer.scene import (
    Lines,
    RigDrawing,
    RigScene,
    cable_lines,
    force_scale,
    module_colours,
    platform_lines,
    size,
)

# Length of the arrows of forces against those of the design page, which shows all available forces too.
ENLARGED = 2.0
APART = 0.012  # distance between arrows of equal forces, as a share of the size of the rig
SLACK_SHARE = 0.5  # share of its lower limit below which a cable is slack
DASHES = 24  # dashes along a cable that is slack, or whose module is lost
SURFACE_COLOUR = "#56B4E9"
ACTIVE_OPACITY, IDLE_OPACITY = 0.4, 0.08
PLATE_M, THICKNESS_M = 0.5, 0.004  # sides and thickness of the plate that shows a plane, or the end of a reach


@dataclass(frozen=True, eq=False)
class Instant:
    """Data of a run in one cycle."""

    time: float  # since the run began, in s
    hand: Floats  # the point, or the platform's reference point, (d,), in m
    anchors: Floats  # ends of the cables at the modules, (m, d), in m
    ends: Floats  # and at the platform
    tensions: Floats  # measured, (m,), in N; NaN where unknown
    set_points: Floats  # sent, (m,), in N; NaN where none was
    active: NDArray[np.bool_]  # modules that take part, (m,)
    desired: Floats  # wrenches (n,), in N and N·m; NaN where none is desired
    commanded: Floats
    measured: Floats
    frames: dict[str, CoordinateFrame] = field(default_factory=dict)  # poses of the body frames
    bodies: BodyScene = field(default_factory=BodyScene)

    @classmethod
    def of(cls, rig: Rig, cycle: Mapping[str, NDArray[Any]]) -> Instant:
        """Return the instant of a cycle, by the names of `CycleTable`."""
        structure, set_points, tensions = (cycle[name] for name in ("structure", "commanded", "measured"))
        by_modules = np.nan_to_num(cycle["demanded"] - cycle["solver_wrench"])  # impedances and lost modules
        poses = zip(rig.at_rest, cycle["frames"], strict=True)
        frames = {name: CoordinateFrame(pose[:, -1], _rotation(pose[:, :-1])) for name, pose in poses}
        rotation = _rotation(cycle["rotation"]) if rig.n > rig.dimension else None
        ends = cycle["position"] + rig.attachments @ cycle["rotation"].T
        return cls(
            time=float(cycle["time"]),
            hand=cycle["position"],
            anchors=cycle["anchors"],
            ends=ends,
            tensions=tensions,
            set_points=set_points,
            active=cycle["active"],
            desired=cycle["desired"],
            commanded=structure @ np.nan_to_num(set_points) + by_modules,
            measured=measured_wrench(structure, tensions, cycle["active"]),
            frames=frames,
            bodies=draw_bodies(rig, np.stack([ends, cycle["anchors"]], 1), cycle["position"], rotation, frames),
        )

    def slack(self, rig: Rig) -> NDArray[np.bool_]:
        """Return which cables (m,) of modules that take part are slack."""
        return np.asarray(self.active & (self.tensions < SLACK_SHARE * rig.limits.lower))

    def colours(self, rig: Rig, *, fresh: bool = True) -> Colours:
        """Return the colour of each cable (m, 3) by its tension; grey for a lost module, or if not fresh."""
        tensions = np.where(self.active & fresh, self.tensions, np.nan)
        return ramp(tensions, rig.limits.lower, rig.limits.upper)


def _rotation(matrix: Floats) -> Floats:
    """Return a rotation as `Rig.structure_matrix` takes it: an angle in the plane."""
    return np.arctan2(matrix[1, 0], matrix[0, 0]) if len(matrix) == 2 else matrix


def draw_instant(rig: Rig, instant: Instant, *, fresh: bool = True) -> RigScene:
    """Return how an instant is drawn; one that is not fresh is grey, and has neither tensions nor forces."""
    anchors, ends, hand = (in_space(points) for points in (instant.anchors, instant.ends, instant.hand))
    colours = module_colours(rig) if fresh else np.tile(rgb(GREY), (rig.m, 1))
    labels = [module.name for module in rig.modules]
    if fresh:
        values = zip(instant.active, instant.slack(rig), instant.tensions.tolist(), strict=True)
        texts = ["LOST" if not a else "slack" if slack else tension_text(t) for a, slack, t in values]
        labels = [f"{name} · {text}" for name, text in zip(labels, texts, strict=True)]
    return RigScene(
        cables=_cables(rig, instant, ends, anchors, fresh=fresh),
        platform=platform_lines(hand, ends),
        anchors=anchors,
        colours=np.where(instant.active[:, None], colours, rgb(RED)),
        hand=hand,
        labels=tuple(labels),
        arrows=_arrows(rig, instant, hand) if fresh else {},
    )


def _cables(rig: Rig, instant: Instant, ends: Floats, anchors: Floats, *, fresh: bool) -> Lines:
    """Return cables as lines; those that are slack, or of lost modules, as straight dashes."""
    d, colours = rig.dimension, instant.colours(rig, fresh=fresh)
    dashed = instant.slack(rig) | ~instant.active
    pulleys = rig.pulleys_in_world(instant.frames)
    points = np.zeros((1 + (1 if pulleys is None else ARC_POINTS), *ends.shape))
    points[..., :d] = ways(ends[:, :d], anchors[:, :d], pulleys)
    whole = cable_lines(points[:, ~dashed], colours[~dashed])
    marks = np.linspace(0.0, 1.0, 2 * DASHES).reshape(-1, 2, 1)
    dashes = [ends[i] + marks * (anchors[i] - ends[i]) for i in np.flatnonzero(dashed)]
    return Lines(
        np.concatenate([whole.points, *dashes]),
        np.concatenate([whole.colours, np.repeat(colours[dashed], DASHES, axis=0)]),
    )


def _arrows(rig: Rig, instant: Instant, hand: Floats) -> dict[str, Floats]:
    """Return the arrows of the forces from the hand, (2, 3), next to each other so that equal ones show."""
    forces = {name: in_space(getattr(instant, name)[: rig.dimension]) for name in FORCE_COLOURS}
    known = {name: force for name, force in forces.items() if np.isfinite(force).all() and force.any()}
    if not known:
        return {}
    first = next(iter(known.values()))
    up = in_space(rig.upward) if rig.dimension == 3 and rig.up is not None else np.array([0.0, 0.0, 1.0])
    across = np.cross(first, up)
    if float(np.linalg.norm(across)) < 0.1 * float(np.linalg.norm(first)):
        across = np.cross(first, np.roll(up, 1))
    across *= APART * size(rig) / float(np.linalg.norm(across))
    scale = ENLARGED * force_scale(rig)
    starts = {name: hand + step * across for name, step in zip(FORCE_COLOURS, (0.0, 1.0, -1.0), strict=True)}
    return {name: np.stack([starts[name], starts[name] + scale * force]) for name, force in known.items()}


class Solid(NamedTuple):
    """Ball of a radius, or box with edges (3,), in m, at a centre (3,), turned by a quaternion (w, x, y, z)."""

    centre: Floats
    turn: Floats
    radius: float = 0.0
    edges: Floats | None = None


def place_surface(surface: ScenerySurface, origin: Floats, middle: Floats) -> Solid:
    """Return how a surface is drawn, given the origin of its frame and the middle of the script, (3,), in m.

    A plane is a plate near the middle, and the end of a reach a plate on the side of the middle.
    """
    from scipy.spatial.transform import Rotation

    point, upright = origin + in_space(np.array(surface.point)), np.array([1.0, 0.0, 0.0, 0.0])
    if surface.kind == "ball":
        return Solid(point, upright, radius=surface.size[0])
    if surface.kind == "box":
        return Solid(point, upright, edges=in_space(np.array(surface.size)))
    if surface.kind == "plane":
        normal = in_space(np.array(surface.normal))
        normal = normal / np.linalg.norm(normal)
        centre = middle - ((middle - point) @ normal) * normal
    else:
        distance = float(np.linalg.norm(middle - point))
        normal = (middle - point) / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
        centre = point + surface.size[0] * normal
    turn = Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])[0].as_quat(scalar_first=True)
    return Solid(centre, turn, edges=np.array([PLATE_M, PLATE_M, THICKNESS_M]))


@dataclass(frozen=True, eq=False)
class SceneryScene:
    """Surroundings of a rig at an instant of a run."""

    places: dict[str, Floats]  # of the held point and the bodies, (3,), in m, by their names in the scenario
    solids: list[Solid]  # surfaces of all phases, in their order
    person: BodyScene  # none where the scenario has none, or the rig has bodies of its own

    @property
    def points(self) -> Floats:
        """Points (k, 3) in m that a picture of the run should hold."""
        return np.concatenate([self.person.points, *(solid.centre[None] for solid in self.solids)])


def draw_scenery(scenery: Scenery, rig: Rig, instant: Instant) -> SceneryScene:
    """Return where the surroundings of a rig are at an instant."""
    frames = {name: in_space(np.asarray(frame.position)) for name, frame in instant.frames.items()}
    places, labels = {scenery.held_name(rig) or "hand": in_space(instant.hand)}, scenery.labels or {}
    places |= {labels.get(name, name): place for name, place in frames.items() if name in rig.frames}
    person = BodyScene()
    if scenery.feet is not None and rig.dimension == 3 and not rig.bodies:
        bodies, at_rest = standing_person(np.array(scenery.feet), rig.up or "y", list(places.items()))
        matrix = pose_matrix(3, at_rest.frame)
        person = BodyScene(bodies, (matrix,) * len(bodies), np.zeros((0, len(bodies)), bool))
    origin = np.zeros(3) if scenery.frame is None else frames[scenery.frame]
    middle = in_space(np.array(scenery.middle))
    surfaces = (surface for phase in scenery.phases for surface in phase.surfaces)
    return SceneryScene(places, [place_surface(surface, origin, middle) for surface in surfaces], person)


class RunDrawing:
    """Nodes of the scene of a run: its rig, and the surroundings of its scenario."""

    def __init__(
        self, server: Any, rig: Rig, instant: Instant, scenery: Scenery | None, covered: float = 0.0
    ) -> None:
        """Look at all that is there at an instant, but for the share ``covered`` of the picture, from below."""
        self._rig, self._scenery = rig, scenery
        points = [instant.anchors, instant.hand[None]]
        if scenery is not None:
            drawn, scene = draw_scenery(scenery, rig, instant), server.scene
            points.append(drawn.points[:, : rig.dimension])
            self._solids = [_add_solid(scene, f"/scenery/{i}", solid) for i, solid in enumerate(drawn.solids)]
            count = len(drawn.places)
            self._names = [scene.add_label(f"/names/{i}", "", anchor="top-left") for i in range(count)]
        points.append(instant.bodies.points[:, : rig.dimension])
        self._bodies = BodyDrawing(server.scene)
        self._drawing = RigDrawing(server, FORCE_COLOURS)
        self._drawing.look_at(rig, *points, covered=covered)

    def show(self, instant: Instant, *, fresh: bool = True) -> None:
        """Bring all nodes up to date; an instant that is not fresh is grey, and in no phase."""
        self._drawing.show(draw_instant(self._rig, instant, fresh=fresh))
        if self._scenery is None:
            self._bodies.show(instant.bodies)
            return
        drawn = draw_scenery(self._scenery, self._rig, instant)
        self._bodies.show(instant.bodies if self._rig.bodies else drawn.person)
        active = self._scenery.active_phases(instant.time) if fresh else ()
        surfaces = [(phase in active, surface) for phase in self._scenery.phases for surface in phase.surfaces]
        for node, solid, (lit, surface) in zip(self._solids, drawn.solids, surfaces, strict=True):
            node.position, node.wxyz = solid.centre, solid.turn
            colour = GREY if not lit else GREEN if surface.brakes else SURFACE_COLOUR
            node.color, node.opacity = tuple(rgb(colour).tolist()), ACTIVE_OPACITY if lit else IDLE_OPACITY
        for node, (name, place) in zip(self._names, drawn.places.items(), strict=True):
            node.text, node.position = name, place


def _add_solid(scene: Any, name: str, solid: Solid) -> Any:
    look: dict[str, Any] = {
        "color": rgb(GREY), "opacity": IDLE_OPACITY, "position": solid.centre, "wxyz": solid.turn,
        "side": "double", "cast_shadow": False, "receive_shadow": False,
    }  # fmt: skip
    if solid.edges is None:
        return scene.add_icosphere(name, solid.radius, **look)
    return scene.add_box(name, dimensions=tuple(solid.edges), **look)
