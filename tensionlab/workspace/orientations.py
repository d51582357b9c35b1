"""Sets of orientations to sweep over."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import DataError, InputError
from tensionlab.model import kinematics
from tensionlab.support.arrays import Floats, require_finite
from tensionlab.support.files.tables import read_table
from tensionlab.workspace.shares import node_weights

MAX_ORIENTATIONS = 100_000  # more are taken for a mistaken step


@dataclass(frozen=True, eq=False)
class Orientations:
    """Orientations that cover a set of them; an array for NumPy."""

    rotations: Floats  # (k, 3, 3)
    weights: Floats  # (k,), shares of the set, whose sum is 1

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Floats:
        return np.array(self.rotations, dtype, copy=copy)

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, index: Any) -> Any:
        return self.rotations[index]


def cone(half_angle: float, step: float, axis: ArrayLike = (0.0, 0.0, 1.0)) -> Orientations:
    """Return the orientations (k, 3, 3) that tilt an axis by up to ``half_angle``, in every direction.

    The first is the identity; then come rings, one every ``step``, with neighbours about as far apart, none of
    them turned about the axis. Each has the weight of the solid angle in which the axis is nearest to its own.
    Angles are in rad. InputError for invalid angles, or an axis of length zero.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> turns = tl.workspace.cone(np.radians(10.0), np.radians(5.0))
    >>> len(turns), f"{np.degrees(np.arccos(turns[-1, 2, 2])):.1f} degrees"
    (19, '10.0 degrees')
    """
    upward = require_finite("axis", axis, 1)
    if upward.shape != (3,) or not upward.any():
        raise InputError(f"axis is {axis!r}; give a vector in space, not zero")
    if not (0 < half_angle <= np.pi and step > 0 and half_angle / step < np.sqrt(MAX_ORIENTATIONS)):
        given = f"a cone of {np.degrees(half_angle):g} degrees with a step of {np.degrees(step):g}"
        raise InputError(f"{given}; give angles above zero, for {MAX_ORIENTATIONS:,} orientations at most")
    upward = upward / np.linalg.norm(upward)
    across = np.linalg.svd(upward[None])[2][1:]
    rings = max(1, round(half_angle / step))
    tilts = half_angle * np.arange(rings + 1) / rings
    counts = np.maximum(6 * np.arange(rings + 1), 1)
    around = np.concatenate([2 * np.pi * np.arange(count) / count for count in counts])
    turns = np.repeat(tilts, counts)[:, None] * (np.stack([np.cos(around), np.sin(around)], axis=1) @ across)
    caps = node_weights(tilts, lambda tilt: np.square(np.sin(tilt / 2)))
    return Orientations(kinematics.exponential(turns), np.repeat(caps / counts, counts))


def roll_pitch_yaw(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Orientations:
    """Return the orientations (k, 3, 3) of every combination of angles, in rad; the yaw changes fastest.

    Angles are numbers, or arrays of one axis, about the fixed axes x, y and z: ``Rz(yaw) Ry(pitch) Rx(roll)``.
    Weights are those of the invariant (Haar) measure of rotations, proportional to the cosine of the pitch.
    ShapeError or InputError for angles that are not finite, or too many combinations.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> tl.workspace.roll_pitch_yaw(0.0, 0.0, [0.0, np.pi / 2])[1].round(6) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    given = {"roll": roll, "pitch": pitch, "yaw": yaw}
    angles = [np.atleast_1d(require_finite(name, values, 0)).ravel() for name, values in given.items()]
    if not 0 < np.prod([values.size for values in angles]) <= MAX_ORIENTATIONS:
        raise InputError(f"roll, pitch and yaw have too many combinations; give 1 to {MAX_ORIENTATIONS:,}")
    grid = np.stack(np.meshgrid(*angles, indexing="ij"), axis=-1).reshape(-1, 3)
    turned = zip(grid.T, np.eye(3), strict=True)
    x, y, z = (kinematics.exponential(np.outer(column, axis)) for column, axis in turned)
    weights = [node_weights(angles[0]), node_weights(angles[1], _integrate_cosine), node_weights(angles[2])]
    return Orientations(z @ y @ x, reduce(np.multiply.outer, weights).ravel())


def _integrate_cosine(angle: Floats) -> Floats:
    """Return the integral of the cosine's magnitude from 0 to an angle, in rad."""
    half_turns = np.round(angle / np.pi)
    return np.asarray(2 * half_turns + np.sin(angle - np.pi * half_turns))


def roll_pitch_yaw_of(rotations: Floats) -> Floats:
    """Return roll, pitch and yaw (k, 3), in rad, of orientations (k, 3, 3).

    The yaw is 0 where the pitch is a right angle, and roll and yaw turn about the same axis.
    """
    R, level = rotations, np.hypot(rotations[:, 0, 0], rotations[:, 1, 0])
    pitch, locked = np.arctan2(-R[:, 2, 0], level), level < 1e-9
    roll = np.where(locked, np.arctan2(-R[:, 1, 2], R[:, 1, 1]), np.arctan2(R[:, 2, 1], R[:, 2, 2]))
    yaw = np.where(locked, 0.0, np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    return np.stack([roll, pitch, yaw], axis=1)


def parse_rotations(text: str, dimension: int, axis: ArrayLike) -> Orientations | Floats:
    """Parse the text of ``--rotations`` into orientations: (k, 3, 3), or (k,) in the plane.

    Angles are in degrees: ``cone:ANGLE[:STEP]`` about the axis, ``rpy:ROLL,PITCH,YAW[:STEP]`` with a number or
    ``FROM..TO`` for each, in the plane ``angle:FROM..TO[:STEP]``; the step is 5 if left out. Or the path of a CSV
    file with the columns rx, ry and rz, axis times angle in rad, in the plane angle in rad.
    """
    if text.lower().endswith(".csv"):
        names = ["rx", "ry", "rz"] if dimension == 3 else ["angle"]
        columns = read_table(text, names, [], error=DataError, what="a list of orientations (*.csv)")
        turns = np.stack([columns[name] for name in names], axis=1)
        return kinematics.exponential(turns) if dimension == 3 else turns[:, 0]
    kind, _, rest = text.partition(":")
    given, _, last = rest.partition(":")
    ranges = [part.partition("..")[::2] for part in given.split(",")]
    sizes = {"cone": 1, "rpy": 3} if dimension == 3 else {"angle": 1}
    try:
        step = np.radians(float(last) if last else 5.0)
        ends = [np.radians([float(low), float(high or low)]) for low, high in ranges]
    except ValueError:
        ends, step = [], 0.0
    if sizes.get(kind) != len(ends) or not 0 < step < np.inf or not np.isfinite(ends).all():
        ways = "cone:10, cone:10:2, rpy:-10..10,0,-30..30" if dimension == 3 else "angle:-30..30, angle:-30..30:2"
        raise InputError(f"rotations {text!r}: write {ways}, in degrees, or the path of a .csv file")
    if kind == "cone":
        return cone(ends[0][1], step, axis)
    if any(high < low or (high - low) / step > MAX_ORIENTATIONS for low, high in ends):
        raise InputError(f"rotations {text!r}: give the lower end of a range first, and not too small a step")
    angles = [np.linspace(low, high, max(int(high > low), round((high - low) / step)) + 1) for low, high in ends]
    return angles[0] if kind == "angle" else roll_pitch_yaw(*angles)
