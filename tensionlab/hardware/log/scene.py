"""Scene of a run for Foxglove and Lichtblick: one `foxglove.SceneUpdate` per picture.

Source of the message: https://docs.foxglove.dev/docs/sdk/schemas/scene-update. Fields that are left out have their
defaults there. Lengths are in m.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from tensionlab.demand import measured_wrench
from tensionlab.hardware.runner.cycle_table import anchors_in_world, rotation_matrix
from tensionlab.hardware.runner.records import Cycle
from tensionlab.model.kinematics import in_space, turn_axes
from tensionlab.model.module import upward
from tensionlab.model.pose import place_anchors
from tensionlab.model.pulleys import ways
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import FORCE_COLOURS, Colours, ramp, rgb

TOPIC = "scene"
FRAME = "upright"  # coordinate frame of the scene; its z axis points up, whatever axis does in the rig's world
RATE_HZ = 30.0  # a screen shows no more
DIGITS = 6  # decimals of positions
ARROW_SHARE = 0.5  # length of the arrow of the largest tension, as a share of the rig's size
ANCHOR_SHARE, SHAFT_SHARE, HEAD_SHARE = 0.025, 0.008, 0.02  # diameters, as shares of the rig's size
MAX_HEAD_SHARE = 0.3  # longest head of an arrow, as a share of its length
CABLE_PIXELS = 3.0
LINE_LIST = 2  # `foxglove.LineType` of segments that are each given by two points
# Viewers know the message by its title, and read its fields as they come.
SCHEMA = {
    "title": "foxglove.SceneUpdate",
    "type": "object",
    "properties": {"entities": {"type": "array", "items": {"type": "object", "properties": {}}}},
}
Json = dict[str, Any]


class SceneEncoder:
    """Encoder of cycles: cables and anchors coloured by tension, and an arrow of the force that cables exert."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        places = np.vstack([place_anchors(rig.modules, rig.anchors, rig.at_rest), rig.home])
        self._size = float(np.ptp(places, axis=0).max()) or 1.0
        self._metres_per_newton = ARROW_SHARE * self._size / max(float(rig.limits.upper.max()), 1e-9)
        up = rig.up or ("y" if rig.dimension == 2 else "z")
        self._upright = turn_axes(upward(up, 3), upward("z", 3))
        self._next = -math.inf

    def encode(self, cycle: Cycle, time_ns: int) -> bytes | None:
        """Return the picture of a cycle at a time in ns since 1970, in JSON; None if the latest one is recent."""
        if cycle.state.time < self._next:
            return None
        self._next = (math.floor(cycle.state.time * RATE_HZ + 1e-6) + 1) / RATE_HZ - 1e-9
        rig, state = self._rig, cycle.state
        anchors = anchors_in_world(cycle, rig)
        ends = state.pose.position + rig.attachments @ rotation_matrix(cycle, rig).T
        points = self._in_scene(ways(ends, anchors, rig.pulleys_in_world(state.pose.frames)))
        colours = ramp(np.where(state.active, state.tensions, np.nan), rig.limits.lower, rig.limits.upper)
        force = measured_wrench(state.structure, state.tensions, state.active)
        size = _vector(np.full(3, ANCHOR_SHARE * self._size))
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        entity = {  # replaces the one before
            "timestamp": {"sec": seconds, "nsec": nanoseconds},
            "frame_id": FRAME,
            "id": "run",
            "lines": [_line(np.stack([points[:-1], points[1:]], axis=2).reshape(-1, 3), colours)],
            "spheres": [
                {"pose": {"position": _vector(anchor)}, "size": size, "color": _color(colour)}
                for anchor, colour in zip(self._in_scene(anchors), colours, strict=True)
            ],
            "arrows": self._arrows(state.pose.position, force[: rig.dimension]),
        }
        return json.dumps({"entities": [entity]}, separators=(",", ":"), allow_nan=False).encode()

    def _in_scene(self, points: Floats) -> Floats:
        return in_space(points) @ self._upright.T

    def _arrows(self, start: Floats, force: Floats) -> list[Json]:
        strength = float(np.linalg.norm(force))
        if not strength > 0.0:
            return []
        length, thickness = self._metres_per_newton * strength, self._size
        return [_arrow(self._in_scene(start), self._in_scene(force / strength), length, thickness)]


def _vector(point: Floats) -> Json:
    return dict(zip("xyz", np.round(point, DIGITS).tolist(), strict=True))


def _color(colour: Colours) -> Json:
    return dict(zip("rgba", [*np.round(colour / 255.0, 3).tolist(), 1.0], strict=True))


def _line(points: Floats, colours: Colours) -> Json:
    """Return segments between pairs of points (2 m k, 3): k of each of m cables, in the cables' colours (m, 3)."""
    shades = [_color(colour) for colour in colours for _ in range(2)]
    return {
        "type": LINE_LIST,
        "thickness": CABLE_PIXELS,
        "scale_invariant": True,
        "points": [_vector(point) for point in points],
        "colors": shades * (len(points) // len(shades)),
    }


def _arrow(start: Floats, direction: Floats, length: float, size: float) -> Json:
    """Return an arrow along a unit vector (3,), for a rig of this size."""
    x, y, z = direction.tolist()
    half = math.sqrt(2.0 * max(1.0 + x, 0.0))  # the shorter way from the x axis; opposite to it, half a turn
    turn = (0.0, -z / half, y / half, 0.5 * half) if half > 1e-6 else (0.0, 0.0, 1.0, 0.0)
    head = min(HEAD_SHARE * size, MAX_HEAD_SHARE * length)
    return {
        "pose": {"position": _vector(start), "orientation": dict(zip("xyzw", turn, strict=True))},
        "shaft_length": length - head,
        "shaft_diameter": SHAFT_SHARE * size,
        "head_length": head,
        "head_diameter": HEAD_SHARE * size,
        "color": _color(rgb(FORCE_COLOURS["measured"])),
    }
