"""A run as a moving scene and as numbers to plot, in messages that Foxglove and other viewers of robots know.

`CHANNELS` are written between the cycles, at most `RATE_HZ` times a second. Lengths are in m, forces in N.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.hardware.log.foxglove_schemas import (
    FRAME_TRANSFORMS,
    JOINT_STATES,
    LINE_TYPES,
    NUMBER,
    PRIMITIVES,
    SCENE_UPDATE,
    TEXT,
    TIME,
    VECTOR,
    list_of,
    message,
)
from tensionlab.hardware.runner.cycle_table import anchors_in_world, desired_wrench, rotation_matrix
from tensionlab.hardware.runner.records import Cycle
from tensionlab.model.kinematics import in_space, turn_axes
from tensionlab.model.module import WORLD, upward
from tensionlab.model.pose import CoordinateFrame, frame_of, place_anchors
from tensionlab.model.pulleys import ways
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREY, ORANGE, RED, Colours, ramp, rgb

RATE_HZ = 30.0  # a screen shows no more
DIGITS = 6  # decimals of positions, in m, and of other numbers of the scene
UPRIGHT = "upright"  # frame whose z axis points up, as viewers expect it: the world's may be another
PLATFORM = "platform"  # frame of the platform, or of the hand
MARGINS = message(
    "tensionlab.Margins",
    ("smallest",),
    timestamp=TIME,
    smallest=NUMBER | {"description": "the smallest of them (N)"},
    cables=list_of(
        message(
            "tensionlab.Margin",
            ("margin",),
            name=TEXT,
            margin=NUMBER | {"description": "from the commanded tension to the nearer limit (N)"},
        )
    ),
)
FORCES = message("tensionlab.Forces", tuple(FORCE_COLOURS), timestamp=TIME, **dict.fromkeys(FORCE_COLOURS, VECTOR))
# Schema of each channel. Numbers that are not known are left out; what rests is written as it changes.
CHANNELS = {
    "transforms": FRAME_TRANSFORMS,
    "scene/modules": SCENE_UPDATE,
    "scene/platform": SCENE_UPDATE,
    "scene/cables": SCENE_UPDATE,
    "scene/forces": SCENE_UPDATE,
    "cables": JOINT_STATES,
    "forces": FORCES,
    "margins": MARGINS,
}
STRONGEST_SHARE = 0.5  # length of the arrow of the largest tension, as a share of the rig's size
# Diameters of drawn parts, as shares of the rig's size.
ANCHOR_SHARE, HAND_SHARE, SHAFT_SHARE, HEAD_SHARE = 0.025, 0.03, 0.008, 0.02
# Offset of force arrows from the hand, as a share of the rig's size, so that equal forces are all visible.
OFFSET_SHARE = {"desired": 0.0, "commanded": 0.012, "measured": -0.012}
MAX_HEAD_SHARE = 0.3  # longest head of an arrow, as a share of its length
CABLE_PIXELS, ARM_PIXELS = 3.0, 2.0
LABEL_PIXELS = 12.0
NOWHERE = {"x": 0.0, "y": 0.0, "z": 0.0}
NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
Json = dict[str, Any]


class SceneEncoder:
    """Encoder of a run's cycles into messages of `CHANNELS`; cycles between two pictures are left out."""

    def __init__(self, rig: Rig) -> None:
        places = np.vstack([place_anchors(rig.modules, rig.anchors, rig.at_rest), rig.home])
        self._rig = rig
        self._names = [module.name for module in rig.modules]
        self._size = float(np.ptp(places, axis=0).max()) or 1.0
        self._scale = STRONGEST_SHARE * self._size / max(float(rig.limits.upper.max()), 1e-9)
        up = rig.up or ("y" if rig.dimension == 2 else "z")
        upright = turn_axes(upward(up, 3), upward("z", 3))
        self._up, self._upright = upright[2], _quaternion(upright)
        on_body = np.array([module.frame != WORLD for module in rig.modules])
        self._colours = np.where(on_body[:, None], rgb(ORANGE), rgb(BLUE))
        self._drawn_active: NDArray[np.bool_] | None = None
        self._next = -math.inf

    def messages(self, cycle: Cycle, time_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield the messages of a cycle, each with its channel, if the next picture is due."""
        if cycle.state.time < self._next:
            return
        self._next = (math.floor(cycle.state.time * RATE_HZ + 1e-6) + 1) / RATE_HZ - 1e-9
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        now = {"sec": seconds, "nsec": nanoseconds}
        forces = self._forces(cycle)
        anchors = in_space(anchors_in_world(cycle, self._rig))
        active = cycle.state.active
        yield "transforms", _json({"transforms": self._transforms(cycle, now)})
        if self._drawn_active is None:
            yield "scene/platform", _scene(now, "platform", PLATFORM, self._platform())
        if self._drawn_active is None or self._rig.frames or (active != self._drawn_active).any():
            yield "scene/modules", _scene(now, "modules", WORLD, self._modules(anchors, active))
            self._drawn_active = active
        yield "scene/cables", _scene(now, "cables", WORLD, self._cables(cycle))
        yield "scene/forces", _scene(now, "forces", WORLD, self._arrows(cycle, forces))
        yield "cables", _json({"timestamp": now, "joints": self._joints(cycle)})
        yield "forces", _json({"timestamp": now, **{name: _vector(force) for name, force in forces.items()}})
        yield "margins", _json({"timestamp": now, **self._margins(cycle)})

    def _forces(self, cycle: Cycle) -> dict[str, Floats]:
        """Return those of the desired, commanded and measured forces (3,) that are known."""
        state, d = cycle.state, self._rig.dimension
        demanded = cycle.demand.wrench
        others = 0.0 if demanded is None else demanded - cycle.solver_wrench  # impedances and lost modules pull it
        wrenches = {
            "desired": desired_wrench(cycle, self._rig),
            "commanded": state.structure @ np.where(np.isfinite(cycle.commanded), cycle.commanded, 0.0) + others,
            "measured": state.structure @ np.where(state.active, state.tensions, 0.0),
        }
        forces = {name: in_space(np.asarray(wrench)[:d]) for name, wrench in wrenches.items()}
        return {name: force for name, force in forces.items() if np.isfinite(force).all()}

    def _transforms(self, cycle: Cycle, now: dict[str, int]) -> list[dict[str, Any]]:
        """Return where the world, the platform and the body frames are."""
        pose = cycle.state.pose
        found = [_transform(now, UPRIGHT, WORLD, NOWHERE, self._upright)]
        placed = {PLATFORM: CoordinateFrame(pose.position, pose.rotation)}
        placed |= {name: frame_of(where) for name, where in (pose.frames or {}).items()}
        for name, (position, rotation) in placed.items():
            place = _vector(in_space(np.asarray(position, dtype=np.float64)))
            turn = NO_TURN if rotation is None else _quaternion(np.asarray(rotation, dtype=np.float64))
            found.append(_transform(now, WORLD, name, place, turn))
        return found

    def _modules(self, anchors: Floats, active: NDArray[np.bool_]) -> Json:
        """Return a sphere and a name for each module: orange on bodies, red where it is lost, blue else."""
        colours = np.where(active[:, None], self._colours, rgb(RED))
        spheres = [
            _sphere(place, ANCHOR_SHARE * self._size, color)
            for place, color in zip(_vectors(anchors), _colors(colours), strict=True)
        ]
        texts = [
            {
                "pose": sphere["pose"],
                "billboard": True,
                "font_size": LABEL_PIXELS,
                "scale_invariant": True,
                "color": _color(rgb(GREY)),
                "text": name,
            }
            for sphere, name in zip(spheres, self._names, strict=True)
        ]
        return {"spheres": spheres, "texts": texts}

    def _platform(self) -> Json:
        """Return the hand, and arms to the attachments, in the platform's own frame."""
        arms = in_space(self._rig.attachments)
        apart = arms[arms.any(axis=1)]
        ends = np.stack([np.zeros_like(apart), apart], axis=1)
        return {
            "spheres": [_sphere(NOWHERE, HAND_SHARE * self._size, _color(rgb(RED)))],
            "lines": [_lines(ends, np.tile(rgb(GREY), (len(apart), 1)), ARM_PIXELS)],
        }

    def _cables(self, cycle: Cycle) -> Json:
        """Return the cables as lines, coloured by measured tension; grey where the module is lost."""
        rig, state = self._rig, cycle.state
        ends = state.pose.position + rig.attachments @ rotation_matrix(cycle, rig).T
        points = in_space(ways(ends, anchors_in_world(cycle, rig), rig.pulleys_in_world(state.pose.frames))[::-1])
        known = np.where(np.isfinite(state.tensions), state.tensions, cycle.commanded)
        shades = ramp(np.where(state.active, known, np.nan), rig.limits.lower, rig.limits.upper)
        pieces = np.stack([points[:-1], points[1:]], axis=2).reshape(-1, 2, 3)
        return {"lines": [_lines(pieces, np.tile(shades, (len(points) - 1, 1)), CABLE_PIXELS)]}

    def _arrows(self, cycle: Cycle, forces: dict[str, Floats]) -> Json:
        """Return an arrow for each force, from the hand, side by side."""
        known = {name: force for name, force in forces.items() if force.any()}
        if not known:
            return {"arrows": []}
        hand, along = in_space(cycle.state.pose.position), next(iter(known.values()))
        across = np.cross(along, self._up)
        if float(np.linalg.norm(across)) < 0.1 * float(np.linalg.norm(along)):
            across = np.cross(along, np.roll(self._up, 1))
        across *= self._size / float(np.linalg.norm(across))
        return {
            "arrows": [
                self._arrow(hand + OFFSET_SHARE[name] * across, force, FORCE_COLOURS[name])
                for name, force in known.items()
            ]
        }

    def _arrow(self, start: Floats, force: Floats, colour: str) -> Json:
        strength = float(np.linalg.norm(force))
        length = self._scale * strength
        head = min(HEAD_SHARE * self._size, MAX_HEAD_SHARE * length)
        return {
            "pose": {"position": _vector(start), "orientation": _towards(force / strength)},
            "shaft_length": round(length - head, DIGITS),
            "shaft_diameter": round(SHAFT_SHARE * self._size, DIGITS),
            "head_length": round(head, DIGITS),
            "head_diameter": round(HEAD_SHARE * self._size, DIGITS),
            "color": _color(rgb(colour)),
        }

    def _joints(self, cycle: Cycle) -> list[dict[str, Any]]:
        """Return lengths, speeds of paying out and measured tensions of the cables, as of sliding joints."""
        state = cycle.state
        numbers = np.stack([state.lengths, state.speeds, state.tensions], axis=1).tolist()
        keys = ("position", "velocity", "effort")
        return [
            {"name": name, **_known(dict(zip(keys, row, strict=True)))}
            for name, row in zip(self._names, numbers, strict=True)
        ]

    def _margins(self, cycle: Cycle) -> dict[str, Any]:
        """Return how far each commanded tension is from its limits; negative beyond one."""
        margins = np.minimum(cycle.commanded - self._rig.limits.lower, cycle.state.upper_now - cycle.commanded)
        cables = [
            {"name": name, **_known({"margin": margin})}
            for name, margin in zip(self._names, margins.tolist(), strict=True)
        ]
        return {**_known({"smallest": float(np.fmin.reduce(margins))}), "cables": cables}


def _json(content: Json) -> bytes:
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def _known(numbers: dict[str, float]) -> dict[str, float]:
    return {name: number for name, number in numbers.items() if math.isfinite(number)}


def _vectors(points: Floats) -> list[Json]:
    return [{"x": x, "y": y, "z": z} for x, y, z in np.round(points, DIGITS).tolist()]


def _vector(point: Floats) -> Json:
    return _vectors(point[None])[0]


def _colors(colours: Colours) -> list[Json]:
    return [{"r": r, "g": g, "b": b, "a": 1.0} for r, g, b in np.round(colours / 255.0, 3).tolist()]


def _color(colour: Colours) -> Json:
    return _colors(colour[None])[0]


def _quaternion(rotation: Floats) -> Json:
    """Return the unit quaternion of a rotation: a matrix (3, 3), or an angle in the plane."""
    from scipy.spatial.transform import Rotation

    planar = rotation.ndim == 0
    found = Rotation.from_euler("z", float(rotation)) if planar else Rotation.from_matrix(rotation)
    return dict(zip("xyzw", found.as_quat().tolist(), strict=True))


def _towards(direction: Floats) -> Json:
    """Return the unit quaternion that turns the x axis to a unit vector (3,) by the shorter way."""
    x, y, z = direction.tolist()
    length = math.sqrt(2.0 * max(1.0 + x, 0.0))
    if length < 1e-6:  # opposite to x: half a turn
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    return {"x": 0.0, "y": -z / length, "z": y / length, "w": length / 2.0}


def _transform(now: Json, parent: str, child: str, place: Json, turn: Json) -> Json:
    return {
        "timestamp": now,
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": place,
        "rotation": turn,
    }


def _scene(now: Json, name: str, frame: str, primitives: Json) -> bytes:
    """Return the message that draws an entity, which stays until the next of its name."""
    entity = {
        "timestamp": now,
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }
    return _json({"deletions": [], "entities": [entity]})


def _sphere(place: Json, diameter: float, color: Json) -> Json:
    size = round(diameter, DIGITS)
    pose = {"position": place, "orientation": NO_TURN}
    return {"pose": pose, "size": {"x": size, "y": size, "z": size}, "color": color}


def _lines(ends: Floats, colours: Colours, pixels: float) -> Json:
    """Return line segments between points (k, 2, 3), with a colour (k, 3) each."""
    return {
        "type": LINE_TYPES.index("LINE_LIST"),
        "pose": {"position": NOWHERE, "orientation": NO_TURN},
        "thickness": pixels,
        "scale_invariant": True,
        "points": _vectors(ends.reshape(-1, 3)),
        "color": _color(rgb(GREY)),
        "colors": [color for color in _colors(colours) for _ in range(2)],
        "indices": [],
    }
