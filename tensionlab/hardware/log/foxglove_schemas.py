"""JSON schemas of the messages that viewers of robots draw and plot, with the names that Foxglove published.

Source: https://docs.foxglove.dev/docs/sdk/schemas. Primitives that no run draws are left out; every field of the
others is here and required, but for the numbers of a joint.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

NUMBER = {"type": "number"}
TEXT = {"type": "string"}
FLAG = {"type": "boolean"}
INDEX = {"type": "integer", "minimum": 0}
NANOSECONDS = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
# Times are since 1970.
TIME = {"title": "time", "type": "object", "properties": {"sec": INDEX, "nsec": NANOSECONDS}}
DURATION = {"title": "duration", "type": "object", "properties": {"sec": {"type": "integer"}, "nsec": NANOSECONDS}}


def message(title: str, optional: Collection[str] = (), /, **properties: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a message with these properties, required but for those that are `optional`."""
    required = [name for name in properties if name not in optional]
    return {"title": title, "type": "object", "properties": properties, "required": required}


def list_of(items: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a list."""
    return {"type": "array", "items": items}


def choice(title: str, *names: str) -> dict[str, Any]:
    """Return the schema of a number that is the index of one of these names."""
    return {"title": title, "oneOf": [{"title": name, "const": number} for number, name in enumerate(names)]}


VECTOR = message("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
POINT = message("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = message("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE = message("foxglove.Pose", position=VECTOR, orientation=QUATERNION)
COLOR = message("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
LINE_TYPES = ("LINE_STRIP", "LINE_LOOP", "LINE_LIST")
PRIMITIVES = {
    "arrows": message(
        "foxglove.ArrowPrimitive",
        pose=POSE,
        shaft_length=NUMBER,
        shaft_diameter=NUMBER,
        head_length=NUMBER,
        head_diameter=NUMBER,
        color=COLOR,
    ),
    "spheres": message("foxglove.SpherePrimitive", pose=POSE, size=VECTOR, color=COLOR),
    "lines": message(
        "foxglove.LinePrimitive",
        type=choice("foxglove.LineType", *LINE_TYPES),
        pose=POSE,
        thickness=NUMBER,
        scale_invariant=FLAG,
        points=list_of(POINT),
        color=COLOR,
        colors=list_of(COLOR),
        indices=list_of(INDEX),
    ),
    "texts": message(
        "foxglove.TextPrimitive",
        pose=POSE,
        billboard=FLAG,
        font_size=NUMBER,
        scale_invariant=FLAG,
        color=COLOR,
        text=TEXT,
    ),
}  # what an entity of a scene may have; the names are its fields
SCENE_UPDATE = message(
    "foxglove.SceneUpdate",
    deletions=list_of(
        message(
            "foxglove.SceneEntityDeletion",
            timestamp=TIME,
            type=choice("foxglove.SceneEntityDeletionType", "MATCHING_ID", "ALL"),
            id=TEXT,
        )
    ),
    entities=list_of(
        message(
            "foxglove.SceneEntity",
            timestamp=TIME,
            frame_id=TEXT,
            id=TEXT,
            lifetime=DURATION,
            frame_locked=FLAG,
            metadata=list_of(message("foxglove.KeyValuePair", key=TEXT, value=TEXT)),
            **{name: list_of(primitive) for name, primitive in PRIMITIVES.items()},
        )
    ),
)
FRAME_TRANSFORMS = message(
    "foxglove.FrameTransforms",
    transforms=list_of(
        message(
            "foxglove.FrameTransform",
            timestamp=TIME,
            parent_frame_id=TEXT,
            child_frame_id=TEXT,
            translation=VECTOR,
            rotation=QUATERNION,
        )
    ),
)
JOINT_NUMBERS = dict.fromkeys(("position", "velocity", "acceleration", "effort"), NUMBER)
JOINT_STATES = message(
    "foxglove.JointStates",
    timestamp=TIME,
    joints=list_of(message("foxglove.JointState", JOINT_NUMBERS, name=TEXT, **JOINT_NUMBERS)),
)
