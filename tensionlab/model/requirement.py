"""Wrenches that the cables of a rig must exert: `Requirement`."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cache
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import RigError, ShapeError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import KINDS, MAX_LENGTH, MAX_TENSION, ArrayRecord
from tensionlab.support.arrays import Floats, as_floats, readonly_copy
from tensionlab.support.files.reading import brief
from tensionlab.support.formatting import format_vector

MAX_WRENCHES = 100_000  # wrenches of a list: each of them is looked at in every pose
MAX_ACCELERATION = 1e6  # along an axis, in m/s² or rad/s²


@dataclass(frozen=True, eq=False)
class Requirement(ArrayRecord):
    """Set of wrenches that the cables must exert on the platform, optionally with its weight.

    A single wrench, or a box, a ball or a list of wrenches around it; at the reference point and in world axes, in
    N (and N·m). Since the available wrench set is convex, a set is feasible where its corners are. RigError names
    the wrong key. Methods take the `Rig`, whose module imports this one.

    Attributes
    ----------
    wrench : (n,) read-only array or None
        Middle of the set; None for zero.
    box : (n,) read-only array or None
        Half of the edges: the box is from ``wrench - box`` to ``wrench + box``.
    wrenches : (k, n) read-only array or None
        Corners of the set relative to ``wrench``; not together with a box.
    ball : float
        Radius in N of a ball that is added to the set. Torques are divided by the length.
    gravity : bool
        Whether the cables also hold the weight of the platform, in any orientation.
    acceleration : (d,) or (n,) read-only array, float or None
        Accelerations that the cables also give to the platform from rest, in world axes: those of its centre of
        mass in m/s², and angular ones in rad/s². Half of the edges of a box, or one number for all linear
        accelerations up to that. These count as a polytope around their ball, up to 2 % (in space 7 %) further.
    length : float or None
        Characteristic length in m by which margins and balls divide torques; None for that of the rig,
        `Rig.characteristic_length`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("cogiro")
    >>> lift = tl.Requirement(wrench=[0.0, 0.0, 500.0, 0.0, 0.0, 0.0], gravity=True)
    >>> lift.at(rig)[0, :3].round()  # 500 N upwards, and the weight of 91.058 kg
    array([   0.,    0., 1393.])
    >>> lift.at(rig)[0, 3:].round(1)  # N·m: its centre of mass is not the reference point
    array([-11.6,  30.4,   0. ])
    """

    wrench: Floats | None = None
    box: Floats | None = None
    wrenches: Floats | None = None
    ball: float = 0.0
    gravity: bool = False
    acceleration: Floats | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        if self.acceleration is not None:
            object.__setattr__(self, "acceleration", _acceleration(self.acceleration))
        for key, axes in (("wrench", 1), ("box", 1), ("wrenches", 2)):
            if (values := getattr(self, key)) is not None:
                object.__setattr__(self, key, _wrenches(key, values, axes))
        if self.box is not None and (self.box < 0).any():
            raise RigError(f'key "box" is {brief(self.box.tolist())}; give half of each edge, 0 or more')
        if self.box is not None and self.wrenches is not None:
            raise RigError('keys "box" and "wrenches" are both there; give one of them')
        sizes = {key: array.shape[-1] for key, array in self._arrays().items()}
        if len(set(sizes.values())) > 1:
            counts = " and ".join(f'key "{key}" has {size} components' for key, size in sizes.items())
            raise RigError(f"{counts}; give all the same number")
        if not (np.isfinite(self.ball) and 0 <= self.ball <= MAX_TENSION):
            raise RigError(f'key "ball" is {self.ball}; give a radius in N, 0 or more')
        if self.length is not None and not (np.isfinite(self.length) and 0 < self.length <= MAX_LENGTH):
            raise RigError(f'key "length" is {self.length}; give a length in m, above zero')

    def __repr__(self) -> str:
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        keys = (
            f"{name}={value.tolist() if isinstance(value, np.ndarray) else value!r}"
            for name, value in given.items()
            if value is not None and value is not False and not (name == "ball" and value == 0.0)
        )
        return f"Requirement({', '.join(keys)})"

    def __bool__(self) -> bool:
        """Tell whether anything is required but to hold still without a load."""
        moves = self.acceleration is not None and self.acceleration.any()
        return bool(
            self.gravity or self.ball > 0 or moves or any(array.any() for array in self._arrays().values())
        )

    def _arrays(self) -> dict[str, Floats]:
        given = {key: getattr(self, key) for key in ("wrench", "box", "wrenches")}
        return {key: array for key, array in given.items() if array is not None}

    def check_rig(self, rig: Any) -> None:
        """Refuse wrenches of another size than the rig's, and the weight of a rig without mass or ``up``."""
        for key, array in self._arrays().items():
            if array.shape[-1] != rig.n:
                needs = f"{rig.name}, a {rig.kind} rig, needs {rig.n}"
                raise RigError(f'required: key "{key}" has {array.shape[-1]} components; {needs}')
        if self.gravity and rig.weight is None:
            missing = '[platform] with a "mass"' if rig.platform is None else '"up", as in up = "z"'
            why = f"{rig.name} does not know its weight; its file needs {missing}"
            raise RigError(f'required: key "gravity" is true, but {why}')
        if self.acceleration is not None:
            self._check_platform(rig, self.acceleration)

    def _check_platform(self, rig: Any, acceleration: Floats) -> None:
        """Refuse accelerations of another size than the rig's, or of a platform whose inertia is not known."""
        d, size = rig.dimension, acceleration.size
        if not KINDS[rig.kind].has_position:
            raise RigError(f'required: key "acceleration": {rig.name} is spherical; give its torques as a box')
        if acceleration.ndim and size not in (d, rig.n):
            sizes = f"{d}" if rig.n == d else f"{d} or {rig.n}"
            raise RigError(
                f'required: key "acceleration" has {size} components; {rig.name}, a {rig.kind} rig, needs {sizes}'
            )
        turns = size > d and acceleration[d:].any()
        if rig.platform is None or (turns and rig.platform.inertia is None):
            missing = "inertia" if rig.platform else "mass"
            why = f'{rig.name} has no {missing}; its file needs [platform] with "{missing}"'
            raise RigError(f'required: key "acceleration" is there, but {why}')

    def middle(self, rig: Any, rotation: ArrayLike | None = None) -> Floats:
        """Return the wrench in the middle of the set, (n,).

        (..., n) for rotations (...) of the platform, as in `Rig.structure_matrix`, with which the weight's torque
        turns.
        """
        self.check_rig(rig)
        middle = np.zeros(rig.n) if self.wrench is None else self.wrench
        return np.asarray(middle - rig.gravity(rotation)) if self.gravity else middle

    def at(self, rig: Any, rotation: ArrayLike | None = None) -> Floats:
        """Return the corners of the set, (k, n), or (..., k, n) for rotations as in `middle`.

        RigError if they do not suit the rig, or it requires an unknown weight.
        """
        around = np.zeros((1, rig.n)) if self.wrenches is None else self.wrenches
        if self.box is not None:
            around = _corners(self.box)
        wrenches = self.middle(rig, rotation)[..., None, :] + around
        if self.acceleration is None:
            return wrenches
        moving = self._inertial(rig, rotation)
        return np.asarray(wrenches[..., None, :] + moving[..., None, :, :]).reshape(*moving.shape[:-2], -1, rig.n)

    def _inertial(self, rig: Any, rotation: ArrayLike | None) -> Floats:
        """Return the wrenches (..., k, n) that accelerate the platform, by Newton and Euler for a body at rest."""
        d, platform, given = rig.dimension, rig.platform, self.acceleration
        assert platform is not None
        assert given is not None
        corners = given * around_ball(d) if given.ndim == 0 else _corners(given)
        force = platform.mass * corners[:, :d]
        if rig.n == d:
            return np.asarray(force)
        turn = rig.home_matrix if rotation is None else pose.rotations(rotation, d, "rotation")
        com = np.zeros(d) if platform.com is None else platform.com
        arms = np.broadcast_to((turn @ com)[..., None, :], (*turn.shape[:-2], *force.shape))
        wrench = np.swapaxes(kinematics.structure_matrix(np.broadcast_to(force, arms.shape), arms), -1, -2)
        if corners.shape[-1] > d and platform.inertia is not None:
            own = platform.inertia if d == 2 else turn @ platform.inertia @ np.swapaxes(turn, -1, -2)
            wrench[..., d:] += corners[:, d:] @ np.swapaxes(own, -1, -2)
        return wrench

    def turned_torque(self, rig: Any, angle: float) -> float:
        """Return the largest change of the torques of `at` when the platform turns by an angle, in N·m."""
        platform, force, torque = rig.platform, 0.0, 0.0
        if platform is None:
            return 0.0
        if self.gravity:
            force = float(np.linalg.norm(rig.gravity()[: rig.dimension]))
        if self.acceleration is not None:
            scalar = self.acceleration.ndim == 0
            corners = self.acceleration * around_ball(rig.dimension)[0] if scalar else self.acceleration
            force += platform.mass * float(np.linalg.norm(corners[: rig.dimension]))
            if platform.inertia is not None:
                moment = float(np.linalg.norm(platform.inertia, 2))
                torque = 2 * moment * float(np.linalg.norm(corners[rig.dimension :]))
        arm = 0.0 if platform.com is None else float(np.linalg.norm(platform.com))
        return 2 * math.sin(angle / 2) * (force * arm + torque)

    def length_for(self, rig: Any) -> float:
        """Return the length, in m, by which torques are divided."""
        return float(rig.characteristic_length) if self.length is None else self.length

    def divisors(self, rig: Any) -> Floats:
        """Return what the components of wrenches are divided by, (n,): forces by 1, torques by the length."""
        return np.repeat([1.0, self.length_for(rig)], [rig.dimension, rig.n - rig.dimension])

    def describe(self, rig: Any) -> str:
        """Return in a few words what is required of a rig."""
        unit = KINDS[rig.kind].wrench_unit
        parts = []
        if self.gravity and rig.platform is not None:
            parts.append(f"its weight of {rig.platform.mass:g} kg")
        if self.acceleration is not None:
            parts.append(self._describe_acceleration(rig.dimension))
        if self.wrench is not None and (self.wrench.any() or not parts):
            parts.append(f"the wrench {format_vector(self.wrench)} {unit}")
        if self.box is not None:
            parts.append(f"a box of ± {format_vector(self.box)} {unit}")
        if self.wrenches is not None:
            parts.append(f"{len(self.wrenches)} wrenches")
        if self.ball:
            parts.append(f"a ball of {self.ball:g} {unit.partition(' ')[0]}")
        return " and ".join(parts) or "no load"

    def _describe_acceleration(self, dimension: int) -> str:
        given = np.asarray(self.acceleration)
        if given.ndim == 0:
            return f"accelerations up to {given:g} m/s²"
        words = f"accelerations of ± {format_vector(given[:dimension])} m/s²"
        return words + (f" and ± {format_vector(given[dimension:])} rad/s²" if given.size > dimension else "")


def as_requirement(required: Requirement | ArrayLike | tuple[ArrayLike, float]) -> Requirement:
    """Return a requirement, in whichever way it was given.

    An array with one axis is a wrench, one with two holds the vertices (k, n) of a set, a tuple is a ball,
    ``(centre, radius)``: all that the cables exert, with the weight in it.
    """
    if isinstance(required, Requirement):
        return required
    if isinstance(required, tuple) and [np.ndim(part) for part in required] == [1, 0]:
        return Requirement(wrench=required[0], ball=float(required[1]))
    values = as_floats("required", required)  # type: ignore[arg-type]  # a tuple of two lists, too
    return Requirement(wrench=values) if values.ndim == 1 else Requirement(wrenches=values)


@cache
def around_ball(dimension: int) -> Floats:
    """Return the corners (k, d) of a polytope around the unit ball, all at one distance from its centre.

    In the plane 16; in space 42, those of an icosahedron and the middles of its edges, moved outwards.
    """
    if dimension == 2:
        angle = 2 * np.pi * np.arange(16) / 16
        return readonly_copy(np.stack([np.cos(angle), np.sin(angle)], axis=1) / math.cos(np.pi / 16))
    golden = (1 + math.sqrt(5)) / 2
    signs = np.array(list(product((-1.0, 1.0), repeat=2)))
    thirds = np.column_stack([np.zeros(4), signs * [1.0, golden]])
    icosahedron = np.concatenate([np.roll(thirds, shift, axis=1) for shift in range(3)])
    edges = [
        one + other
        for one, other in combinations(icosahedron, 2)
        if np.isclose(np.dot(one - other, one - other), 4)
    ]
    unit = np.concatenate([icosahedron, edges])
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    # The widest faces join the middles of three edges, which are 36 degrees apart.
    return readonly_copy(unit / math.sqrt(1 - 4 / 3 * math.sin(np.pi / 10) ** 2))


def _corners(half: Floats) -> Floats:
    """Return the corners (k, n) of a box with half of its edges (n,)."""
    return np.array(list(product(*((-edge, edge) if edge else (0.0,) for edge in half))))


def _acceleration(values: Any) -> Floats:
    """Return a read-only array of accelerations, or a number, or say what is wrong with it."""
    try:
        array = readonly_copy(as_floats("acceleration", values))
    except ShapeError:
        array = np.array(np.nan)
    if array.ndim > 1 or not array.size or not ((array >= 0) & (array <= MAX_ACCELERATION)).all():
        give = f"give half of each edge of a box, or one number, 0 to {MAX_ACCELERATION:g} m/s² (or rad/s²)"
        raise RigError(f'key "acceleration" is {brief(values)}; {give}')
    return array


def _wrenches(key: str, values: Any, axes: int) -> Floats:
    """Return a read-only array of wrenches, or say what is wrong with it."""
    expected = "a list of numbers in N (and N·m)" if axes == 1 else "a list of wrenches, all of one size"
    try:
        array = readonly_copy(as_floats(key, values))
    except ShapeError:
        raise RigError(f'key "{key}" is {brief(values)}; give {expected}') from None
    if array.ndim != axes or not array.size or not (np.abs(array) <= MAX_TENSION).all():
        raise RigError(f'key "{key}" is {brief(array.tolist())}; give {expected}, each within {MAX_TENSION:g}')
    if len(array) > MAX_WRENCHES:
        raise RigError(f'key "{key}" has {len(array):,} wrenches; give {MAX_WRENCHES:,} at most')
    return array
