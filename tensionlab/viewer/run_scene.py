"""Data of a run in one cycle, and how they are drawn: cables by measured tension, modules and forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.kinematics import in_space
from tensionlab.model.pulleys import ARC_POINTS, ways
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import HEAD_M, Scenery, ScenerySurface, StickFigure, stick_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import FORCE_COLOURS, GREEN, GREY, RED, Colours, ramp, rgb
from tensionlab.support.formatting import format_number
from tensionlab.viewer.scene import (
    NO_LINE,
    Arrow,
    Lines,
    RigScene,
    as_rgb,
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


@dataclass(frozen=True, eq=False)
class Instant:
    """Data of a run in one cycle."""

    time: float  # since the run began, in s
    hand: Floats  # the point, or the platform's reference point, (d,), in m
    anchors: Floats  # ends of the cables at the modules, (m, d), in m
    ends: Floats  # and at the platform
    tensions: Floats  # measured, (m,), in N; before the first telemetry, those sent
    set_points: Floats  # sent, (m,), in N; NaN where none was
    active: NDArray[np.bool_]  # modules that take part, (m,)
    desired: Floats  # wrenches (n,), in N and N·m; NaN where none is desired
    commanded: Floats
    measured: Floats

    @classmethod
    def of(cls, rig: Rig, cycle: Mapping[str, NDArray[Any]]) -> Instant:
        """Return the instant of a cycle, by the names of `CycleTable`."""
        structure, set_points, tensions = (cycle[name] for name in ("structure", "commanded", "measured"))
        by_modules = np.nan_to_num(cycle["demanded"] - cycle["solver_wrench"])  # impedances and lost modules
        return cls(
            time=float(cycle["time"]),
            hand=cycle["position"],
            anchors=cycle["anchors"],
            ends=cycle["position"] + rig.attachments @ cycle["rotation"].T,
            tensions=np.where(np.isfinite(tensions), tensions, set_points),
            set_points=set_points,
            active=cycle["active"],
            desired=cycle["desired"],
            commanded=structure @ np.nan_to_num(set_points) + by_modules,
            measured=structure @ np.nan_to_num(tensions),
        )

    def slack(self, rig: Rig) -> NDArray[np.bool_]:
        """Return which cables (m,) of modules that take part are slack."""
        return np.asarray(self.active & (self.tensions < SLACK_SHARE * rig.limits.lower))

    def colours(self, rig: Rig, *, fresh: bool = True) -> Colours:
        """Return the colour of each cable (m, 3) by its tension; grey for a lost module, or if not fresh."""
        tensions = np.where(self.active & fresh, self.tensions, np.nan)
        return ramp(tensions, rig.limits.lower, rig.limits.upper)


def draw_instant(rig: Rig, instant: Instant, *, fresh: bool = True) -> RigScene:
    """Return how an instant is drawn; one that is not fresh is grey, and has neither tensions nor forces."""
    anchors, ends, hand = (in_space(points) for points in (instant.anchors, instant.ends, instant.hand))
    colours = module_colours(rig) if fresh else np.tile(rgb(GREY), (rig.m, 1))
    return RigScene(
        cables=_cables(rig, instant, ends, anchors, fresh=fresh),
        platform=platform_lines(hand, ends),
        anchors=anchors,
        colours=np.where(instant.active[:, None], colours, rgb(RED)),
        hand=hand,
        labels=tuple(
            f"{module.name} · {tension_text(instant, rig, i)}" if fresh else module.name
            for i, module in enumerate(rig.modules)
        ),
        arrows=_arrows(rig, instant, hand) if fresh else {},
    )


def tension_text(instant: Instant, rig: Rig, index: int) -> str:
    """Return the tension of a module, or that it is lost or its cable slack."""
    if not instant.active[index]:
        return "LOST"
    return "slack" if instant.slack(rig)[index] else f"{format_number(float(instant.tensions[index]))} N"


def _cables(rig: Rig, instant: Instant, ends: Floats, anchors: Floats, *, fresh: bool) -> Lines:
    """Return cables as lines; those that are slack, or of lost modules, as straight dashes."""
    d, colours = rig.dimension, instant.colours(rig, fresh=fresh)
    dashed = instant.slack(rig) | ~instant.active
    pulleys = None if rig.frames else rig.pulleys  # how bodies have turned is not known here
    points = np.zeros((1 + (1 if pulleys is None else ARC_POINTS), *ends.shape))
    points[..., :d] = ways(ends[:, :d], anchors[:, :d], pulleys)
    whole = cable_lines(points[:, ~dashed], colours[~dashed])
    marks = np.linspace(0.0, 1.0, 2 * DASHES).reshape(-1, 2, 1)
    dashes = [ends[i] + marks * (anchors[i] - ends[i]) for i in np.flatnonzero(dashed)]
    return Lines(
        np.concatenate([whole.points, *dashes]),
        np.concatenate([whole.colours, np.repeat(colours[dashed], DASHES, axis=0)]),
    )


def _arrows(rig: Rig, instant: Instant, hand: Floats) -> dict[str, Arrow]:
    """Return the arrows of the forces from the hand, to scale, next to each other so that equal ones show."""
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
    steps = dict(zip(FORCE_COLOURS, (0.0, 1.0, -1.0), strict=True))
    return {
        name: Arrow(hand + steps[name] * across, hand + steps[name] * across + scale * force)
        for name, force in known.items()
    }


SURFACE_COLOUR, PERSON_COLOUR = "#56B4E9", "#B8B8B8"
ACTIVE_OPACITY, IDLE_OPACITY = 0.4, 0.08
PLATE_M, THICKNESS_M = 0.5, 0.004  # sides and thickness of the plate that shows a plane, or the end of a reach
LIMB_M = 0.03  # thickness of limbs


class Solid(NamedTuple):
    """Ball of a radius, or box with edges (3,), in m, at a centre (3,), turned by a quaternion (w, x, y, z)."""

    centre: Floats
    turn: Floats
    radius: float = 0.0
    edges: Floats | None = None


def solid(surface: ScenerySurface, origin: Floats, middle: Floats) -> Solid:
    """Return how a surface is drawn, given the origin of its frame and the middle of the script, (3,), in m.

    A plane is a plate near the middle, and the end of a reach a plate on the side of the middle.
    """
    from scipy.spatial.transform import Rotation

    point = origin + in_space(np.array(surface.point))
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    if surface.kind == "ball":
        return Solid(point, upright, radius=surface.size[0])
    if surface.kind == "box":
        return Solid(point, upright, edges=in_space(np.array(surface.size)))
    if surface.kind == "plane":
        normal = in_space(np.array(surface.normal))
        normal = normal / np.linalg.norm(normal)
        centre = middle - ((middle - point) @ normal) * normal
    else:
        towards = middle - point
        distance = float(np.linalg.norm(towards))
        normal = towards / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
        centre = point + surface.size[0] * normal
    turn = Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])[0].as_quat(scalar_first=True)
    return Solid(centre, turn, edges=np.array([PLATE_M, PLATE_M, THICKNESS_M]))


def body_origins(rig: Rig, anchors: Floats) -> dict[str, Floats]:
    """Return the origins of the body frames, (d,) in m, by anchors in the world (m, d), if none has turned."""
    pairs = zip(rig.modules, anchors, strict=True)
    return {module.frame: anchor - module.anchor for module, anchor in pairs if module.frame in rig.frames}


def named_places(scenery: Scenery, rig: Rig, instant: Instant) -> dict[str, Floats]:
    """Return where the held point and the bodies are, (3,), in m, by their names in the scenario."""
    labels, bodies = scenery.labels or {}, body_origins(rig, instant.anchors)
    places = {scenery.held_name(rig) or "hand": in_space(instant.hand)}
    return places | {labels.get(name, name): in_space(place) for name, place in bodies.items()}


def person(scenery: Scenery, rig: Rig, places: dict[str, Floats]) -> StickFigure | None:
    """Return the person, with its parts where they are known to be; None if the scenario draws none."""
    if scenery.feet is None:
        return None
    up = in_space(rig.upward) if rig.up is not None else np.array([0.0, 1.0, 0.0])
    return stick_figure(in_space(np.array(scenery.feet)), up, list(places.items()))


def solids(scenery: Scenery, rig: Rig, instant: Instant) -> list[Solid]:
    """Return the surfaces of all phases, in their order."""
    frame = scenery.frame
    origin = in_space(np.zeros(rig.dimension) if frame is None else body_origins(rig, instant.anchors)[frame])
    middle = in_space(np.array(scenery.middle))
    return [solid(surface, origin, middle) for phase in scenery.phases for surface in phase.surfaces]


def points_to_see(scenery: Scenery, rig: Rig, instant: Instant) -> Floats:
    """Return points (k, 3) in m around a rig that a picture of its run should hold."""
    figure = person(scenery, rig, named_places(scenery, rig, instant))
    joints = [] if figure is None else [*figure.lines, figure.head[None]]
    return np.concatenate(
        [np.empty((0, 3)), *joints, *(placed.centre[None] for placed in solids(scenery, rig, instant))]
    )


class SceneryDrawing:
    """Nodes of what is around the rig of a run; `show` brings them up to date."""

    def __init__(self, scene: Any, scenery: Scenery, rig: Rig, instant: Instant) -> None:
        self._scenery, self._rig = scenery, rig
        self._surfaces = [_add_solid(scene, i, each) for i, each in enumerate(solids(scenery, rig, instant))]
        self._person = scene.add_line_segments(
            "/person", NO_LINE, as_rgb(PERSON_COLOUR), thickness=LIMB_M, thickness_units="world", visible=False
        )
        self._head = scene.add_icosphere("/head", HEAD_M, color=as_rgb(PERSON_COLOUR), visible=False)
        count = len(named_places(scenery, rig, instant))
        self._labels = [scene.add_label(f"/names/{i}", "", anchor="top-left") for i in range(count)]

    def show(self, instant: Instant, *, fresh: bool) -> None:
        """Bring all nodes up to date; where the instant is not fresh, no phase is in progress."""
        active = self._scenery.active_phases(instant.time) if fresh else ()
        places = named_places(self._scenery, self._rig, instant)
        drawn = iter(zip(self._surfaces, solids(self._scenery, self._rig, instant), strict=True))
        for phase in self._scenery.phases:
            for surface, (node, placed) in zip(phase.surfaces, drawn, strict=False):
                node.position, node.wxyz = placed.centre, placed.turn
                colour = GREEN if surface.brakes else SURFACE_COLOUR
                node.color = as_rgb(colour if phase in active else GREY)
                node.opacity = ACTIVE_OPACITY if phase in active else IDLE_OPACITY
        figure = person(self._scenery, self._rig, places)
        self._person.visible = self._head.visible = figure is not None
        if figure is not None:
            limbs = [np.stack([line[:-1], line[1:]], axis=1) for line in figure.lines]
            self._person.points, self._head.position = np.concatenate(limbs), figure.head
        for node, (name, place) in zip(self._labels, places.items(), strict=True):
            node.text, node.position = name, place


def _add_solid(scene: Any, index: int, placed: Solid) -> Any:
    look: dict[str, Any] = {
        "color": as_rgb(GREY), "opacity": IDLE_OPACITY, "position": placed.centre, "wxyz": placed.turn,
        "side": "double", "cast_shadow": False, "receive_shadow": False,
    }  # fmt: skip
    if placed.edges is None:
        return scene.add_icosphere(f"/scenery/{index}", placed.radius, **look)
    return scene.add_box(f"/scenery/{index}", dimensions=tuple(placed.edges), **look)
