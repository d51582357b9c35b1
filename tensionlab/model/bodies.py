"""Bodies that cables must stay clear of: `Body`, where its frame puts it, and a ready `person`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import RigError
from tensionlab.model import kinematics, pose
from tensionlab.model.directions import circle, fibonacci
from tensionlab.model.module import (
    MAX_LENGTH,
    WORLD,
    ArrayRecord,
    require_name,
    require_number,
    require_up,
    upward,
    vector,
)
from tensionlab.model.pose import Frames, RestPose, frame_of
from tensionlab.support.arrays import Floats, Integers, common_axes
from tensionlab.support.files.reading import brief

HAND = "hand"  # the frame of the held point or platform
PERSON = "person"  # the frame of a ready person
DEFAULT_MARGIN_M = 0.05
ROUND_POINTS = 300  # points of a sphere, or a circle, that stand for its surface


@dataclass(frozen=True, eq=False)
class Body(ArrayRecord):
    """Sphere, capsule or box that cables must stay clear of. RigError names the body and the wrong key.

    A body with a ``size`` is a box, one with an ``end`` a capsule: all points within the radius of a segment. One
    with neither is a sphere.

    Attributes
    ----------
    start : (d,) read-only array
        Centre of a sphere or box, or one end of a capsule's segment, in the axes of ``frame``, in m.
    end : (d,) read-only array or None
        Other end of a capsule's segment.
    radius : float
        Radius of a sphere or capsule, in m; a box has none.
    size : (d,) read-only array or None
        Edges of a box along the axes of ``frame``, in m.
    frame : str
        "world"; "hand", which moves and turns with the held point or platform; or the name of a body frame, with
        or without modules. Without modules it is at its `RestPose` wherever no other pose is given.
    margin : float
        Smallest distance to a cable, in m.
    sway : float
        How far the body may move from where its frame puts it, in any direction, in m.

    Examples
    --------
    >>> import tensionlab as tl
    >>> head = tl.Body("head", [0.0, 1.6, -0.3], radius=0.12, margin=0.1)
    >>> table = tl.Body("table", [0.0, 0.7, 0.5], size=[1.2, 0.04, 0.6])
    >>> head.shape, table.shape
    ('sphere', 'box')
    """

    name: str
    start: Floats
    end: Floats | None = None
    radius: float = 0.0
    size: Floats | None = None
    frame: str = WORLD
    margin: float = DEFAULT_MARGIN_M
    sway: float = 0.0

    def __post_init__(self) -> None:
        require_name(self.name, "body", "name", "give every body a name")
        here = f'body "{self.name}"'
        require_name(self.frame, here, "frame", f'give "{WORLD}", "{HAND}" or the name of a body frame')
        for key in ("start", "end", "size"):
            if key == "start" or getattr(self, key) is not None:
                point = vector(getattr(self, key), here, key)
                object.__setattr__(self, key, point)
                if point.size != self.start.size:
                    raise RigError(f'{here}: key "{key}" has {point.size} numbers; give {self.start.size}')
        for key in ("radius", "margin", "sway"):
            require_number(getattr(self, key), here, key, MAX_LENGTH, "m")
        if self.size is None and not self.radius:
            raise RigError(f'{here}: key "radius" is missing; give the radius in m, or the "size" of a box')
        if self.size is not None and ((self.size <= 0).any() or self.end is not None or self.radius):
            raise RigError(f'{here}: a box has a "size" above zero along each axis, and no "end" or "radius"')

    @property
    def shape(self) -> Literal["sphere", "capsule", "box"]:
        """Shape of the body."""
        return "box" if self.size is not None else "sphere" if self.end is None else "capsule"

    def describe(self) -> str:
        """Return shape and size in words, such as "sphere of radius 0.12 m"."""
        if self.size is not None:
            return f"box of {' x '.join(f'{edge:.3g}' for edge in self.size)} m"
        return f"{self.shape} of radius {self.radius:.3g} m"


class PlacedBody(NamedTuple):
    """Body in the world."""

    ends: Floats  # of its segment, (..., 2, d), equal but for a capsule
    axes: Floats | None  # columns are the axes of a box, (..., d, d); None for spheres and capsules


def place_bodies(
    bodies: Sequence[Body], position: Floats, rotation: Floats | None, frames: Frames
) -> list[PlacedBody]:
    """Return the bodies in the world.

    ``position`` (..., d) and ``rotation``, matrices (..., d, d) or None, are those of the held point or platform;
    ``frames`` has the poses of all other frames. Leading axes broadcast.
    """
    placed = []
    for body in bodies:
        d, axes = body.start.size, np.eye(body.start.size)
        ends = np.stack([body.start, body.start if body.end is None else body.end])
        if body.frame == HAND:
            axes = axes if rotation is None else rotation
            ends = position[..., None, :] + kinematics.rotate(axes, ends)
        elif body.frame != WORLD:
            where, what = frame_of(frames[body.frame]), f'frame "{body.frame}"'
            if where.rotation is not None:
                axes = pose.rotations(where.rotation, d, f"{what} rotation")
            origin = pose.points(where.position, d, f"{what} position")
            ends = origin[..., None, :] + kinematics.rotate(axes, ends)
        placed.append(PlacedBody(ends, axes if body.size is not None else None))
    return placed


class Segments(NamedTuple):
    """Cables, and bodies after them, as the native kernel of distances takes them, at B poses."""

    ends: Floats  # of all, (B, S, 2, 3)
    pairs: Integers  # of a cable and a body, (k, 2), those of a cable in a row
    axes: Floats | None  # of boxes, (B, S, 3, 3); None if there is none
    halves: Floats | None  # of the edges of boxes, (S, 3)


def as_segments(
    cables: Floats, bodies: Sequence[Body], placed: Sequence[PlacedBody]
) -> tuple[Segments, tuple[int, ...]]:
    """Return cables (..., m, 2, d) and bodies in the world as segments, and the shape (..., m, bodies)."""
    m, _, d = cables.shape[-3:]
    shapes = {f'body "{body.name}"': where.ends.shape[:-2] for body, where in zip(bodies, placed, strict=True)}
    shape = common_axes({"cables": cables.shape[:-3]} | shapes)
    count = m + len(bodies)
    ends = np.zeros((*shape, count, 2, 3))
    axes, halves = np.zeros((*shape, count, 3, 3)), np.zeros((count, 3))
    ends[..., :m, :, :d] = cables
    for index, (body, where) in enumerate(zip(bodies, placed, strict=True), start=m):
        ends[..., index, :, :d] = where.ends
        if body.size is not None:
            axes[..., index, :, :] = np.eye(3)
            axes[..., index, :d, :d] = where.axes
            halves[index, :d] = body.size / 2
    pairs = np.stack([np.repeat(np.arange(m), len(bodies)), np.tile(np.arange(m, count), m)], axis=1)
    turned = (axes.reshape(-1, count, 3, 3), halves) if halves.any() else (None, None)
    flat = Segments(ends.reshape(-1, count, 2, 3), pairs, *turned)
    return flat, (*shape, m, len(bodies))


def surface_points(body: Body, placed: PlacedBody) -> Floats:
    """Return points (k, d) of the surface of a placed body, whose convex hull is the body."""
    d = body.start.size
    if placed.axes is not None:
        corners = np.array(list(product((-0.5, 0.5), repeat=d))) * body.size
        return np.asarray(placed.ends[0] + kinematics.rotate(placed.axes, corners))
    directions = fibonacci(ROUND_POINTS) if d == 3 else circle(ROUND_POINTS)
    return np.asarray((placed.ends[:, None] + body.radius * directions).reshape(-1, d))


# Heights of a standing person as shares of the stature: Drillis and Contini, "Body segment parameters", 1966, in
# Winter, "Biomechanics and Motor Control of Human Movement", 2009, figure 4.1.
KNEE, HIP, SHOULDER, CHIN = 0.285, 0.530, 0.818, 0.870
# Half of breadths and depths, in m, at the 95th percentile of men or of women, whichever is larger: Gordon et al.,
# "2012 Anthropometric survey of U.S. Army personnel" (ANSUR II), 2014. Head length, neck circumference,
# bideltoid breadth, chest and waist depth, hip breadth, thigh circumference.
HEAD_M, NECK_M, SHOULDERS_M, TORSO_M, HIPS_M, THIGH_M = 0.106, 0.071, 0.284, 0.150, 0.200, 0.115


def person(
    posture: Literal["standing", "seated"],
    up: str,
    at: ArrayLike | None = None,
    facing: ArrayLike | None = None,
    height: float = 1.75,
    margin: float = DEFAULT_MARGIN_M,
    sway: float = 0.0,
) -> tuple[tuple[Body, ...], RestPose]:
    """Return the bodies of a person on the frame "person", and the pose of that frame.

    Head, neck, torso and legs. The arms are left out: they follow the hand that the cables pull, and a cable that
    ends at the hand is always close to them. So are the feet. RigError for a wrong argument.

    Lengths along the body are shares of the stature (Drillis and Contini, 1966). Breadths and depths are those of
    a large person whatever the height: the 95th percentile of ANSUR II (Gordon et al., 2014).

    Parameters
    ----------
    posture : "standing" or "seated"
        A seated person has the thighs level, at knee height, and the shanks upright.
    up : str
        World axis that points up, as in `Rig`.
    at : (3,) array, optional
        Floor below the hips, in m; the origin of the world if left out.
    facing : (3,) array, optional
        Direction that the person faces, of which the level part counts; the axis after ``up`` if left out: x where
        z is up, z where y is up.
    height : float
        Stature in m.
    margin, sway
        As in `Body`, of every body.

    Examples
    --------
    >>> import tensionlab as tl
    >>> bodies, rest = tl.person("standing", up="z", at=[0.0, -1.0, 0.0], facing=[0.0, 1.0, 0.0])
    >>> [body.name for body in bodies]
    ['head', 'neck', 'torso', 'left leg', 'right leg']
    """
    if posture not in ("standing", "seated"):
        raise RigError(f'key "person" is {brief(posture)}; give standing or seated')
    if not 0.5 <= height <= 2.5:
        raise RigError(f'person: key "height" is {height}; give 0.5 to 2.5 m')
    require_up(up, 3)
    upright = upward(up, 3)
    ahead = np.roll(np.abs(upright), 1)
    axes = np.stack([ahead, np.cross(upright, ahead), upright])  # ahead, left, up
    place = vector(np.zeros(3) if at is None else at, "person", "at")
    towards = vector(ahead if facing is None else facing, "person", "facing")
    x, y, _ = level = axes @ towards if towards.size == place.size == 3 else np.zeros(3)
    if np.hypot(x, y) <= 1e-6 * np.linalg.norm(level):
        raise RigError('person: give three coordinates in "at", and in "facing" a direction that is not upright')
    hip, thigh = height * (KNEE if posture == "seated" else HIP), height * (HIP - KNEE)
    shoulder, chin, top = (hip + height * (share - HIP) for share in (SHOULDER, CHIN, 1.0))
    legs = {"leg": ((0.0, hip), (0.0, THIGH_M))}  # ahead and up, of both ends: the sole is on the floor
    if posture == "seated":
        legs = {"thigh": ((0.0, hip), (thigh, hip)), "shank": ((thigh, hip), (thigh, THIGH_M))}
    parts = [
        ("head", (0.0, 0.0, chin + HEAD_M), (0.0, 0.0, top - HEAD_M), HEAD_M),
        ("neck", (0.0, 0.0, shoulder), (0.0, 0.0, chin), NECK_M),
    ] + [
        (f"{side} {name}", (start[0], lateral, start[1]), (end[0], lateral, end[1]), THIGH_M)
        for side, lateral in (("left", HIPS_M - THIGH_M), ("right", THIGH_M - HIPS_M))
        for name, (start, end) in legs.items()
    ]
    same_of_all: dict[str, Any] = {"frame": PERSON, "margin": margin, "sway": sway}
    bodies = [
        Body(name, np.array(start) @ axes, np.array(end) @ axes, radius, **same_of_all)
        for name, start, end, radius in parts
    ]
    size = np.abs(np.array([2 * TORSO_M, 2 * SHOULDERS_M, shoulder - hip]) @ axes)
    bodies.insert(2, Body("torso", (shoulder + hip) / 2 * upright, size=size, **same_of_all))
    return tuple(bodies), RestPose(PERSON, place, np.arctan2(y, x) * upright)
