"""Poses from a box, a path or a file: `box`, `polyline`, `read_poses`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError
from tensionlab.files.reading import brief
from tensionlab.files.tables import check_columns, read_npz, read_parquet, read_table
from tensionlab.model import kinematics, pose
from tensionlab.model.module import MAX_LENGTH
from tensionlab.workspace.sweep.pose_sets import Grid, PoseList

POSE_FILES = (".csv", ".parquet", ".npz")
TURNS = ["rx", "ry", "rz"]
"""Columns of an orientation in space."""
MAX_ANGLE = 1000.0
"""In rad. More is taken for another unit."""
LONGEST_AXIS = 10_000_000
"""More poses along one axis than this are taken for a slip of the step."""


def box(
    x: ArrayLike, y: ArrayLike, z: ArrayLike | None = None, *, step: ArrayLike, rotations: ArrayLike | None = None
) -> Grid:
    """Which poses fill a box, one every step?

    Parameters
    ----------
    x, y, z : (from, to), or a number
        The box, in m; a number is a plane of it. No z in the plane.
    step : number, or one for each axis
        Distance of neighbours, in m. The first is at ``from``; the last is at ``to`` if the step divides the edge.
    rotations : array, optional
        As in `Grid`.

    Raises
    ------
    ShapeError
        If an interval runs backwards, a step is not above zero, or gives more poses than anyone means.
    """
    intervals = [("x", x), ("y", y)] + ([] if z is None else [("z", z)])
    steps = pose.numbers(step, "step")
    if steps.shape not in ((), (len(intervals),)) or not (steps > 0).all():
        raise ShapeError(f"step is {step!r}; give one length in m, or one for each axis, above zero")
    axes = [
        _axis(name, ends, float(size))
        for (name, ends), size in zip(intervals, np.broadcast_to(steps, len(intervals)), strict=True)
    ]
    return Grid(*axes, rotations=rotations)  # type: ignore[arg-type, misc]  # becomes an array


def polyline(points: ArrayLike, step: float, rotation: ArrayLike | None = None) -> PoseList:
    """Which poses lie on a path of straight lines, one every step?

    Parameters
    ----------
    points : (k, d) array
        Corners of the path, two or more, in m.
    step : float
        Distance of neighbours along the path, in m; the last is the end of the path, and may be closer.
    rotation : (3, 3) array or float, optional
        Orientation, the same everywhere.

    Raises
    ------
    ShapeError
        If the path has no length, or the step is not above zero.
    """
    corners = PoseList(points).position  # type: ignore[arg-type]  # becomes an array
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    if not along[-1] > 0:
        raise ShapeError("the path has no length; give two or more points that differ")
    if not (np.isfinite(step) and step > 0 and along[-1] / step < LONGEST_AXIS):
        raise ShapeError(f"step is {step}; the path is {along[-1]:g} m long, give a part of it, above zero")
    whole = step * np.arange(int(np.floor(along[-1] / step * (1 + 1e-12))) + 1)
    places = np.asarray(whole if np.isclose(whole[-1], along[-1], rtol=1e-9, atol=0) else [*whole, along[-1]])
    position = np.stack([np.interp(places, along, column) for column in corners.T], axis=-1)
    if rotation is None:
        return PoseList(position, distance=places)
    turn = pose.numbers(rotation, "rotation")
    return PoseList(position, np.broadcast_to(turn, (len(places), *turn.shape)), places)


def read_poses(path: str | Path) -> PoseList:
    """Return the poses that a file lists.

    CSV (with a line of column names) and Parquet have the columns x, y and z in m, in the plane x and y. An
    orientation is given by rx, ry, rz, the axis times the angle in rad, in the plane by angle in rad. NPZ has
    the arrays ``position`` and, if need be, ``rotation``, as in `PoseList`.

    Raises
    ------
    ShapeError
        If the file cannot be read, or its columns, arrays or entries are not these; it names file and row.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in POSE_FILES:
        raise ShapeError(f"{path}: not a file of poses; give one that ends in {', '.join(POSE_FILES)}")
    what = f"a file of poses (*{suffix})"
    try:
        if suffix == ".npz":
            return _within(_from_arrays(read_npz(path, what, ShapeError)))
        if suffix == ".csv":
            return _from_columns(read_table(path, ["x", "y"], ["z", *TURNS, "angle"], error=ShapeError, what=what))
        table = read_parquet(path, what, ShapeError)
        check_columns(table.columns.column_names, ["x", "y"], ["z", *TURNS, "angle"], str(path), ShapeError)
        return _from_columns({name: table.numbers(name, ShapeError) for name in table.columns.column_names})
    except ShapeError as error:
        raise ShapeError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def _within(poses: PoseList) -> PoseList:
    """Refuse positions that no rig reaches, as of a file in other units."""
    if (far := np.abs(poses.position).max(axis=1) > MAX_LENGTH).any():
        row = int(np.flatnonzero(far)[0])
        raise ShapeError(f"pose {row + 1} is {brief(poses.position[row].tolist())}; give m, within {MAX_LENGTH:g}")
    return poses


def _from_columns(columns: dict[str, Floats]) -> PoseList:
    spatial = "z" in columns
    places, turns = ["x", "y", "z"][: 3 if spatial else 2], TURNS if spatial else ["angle"]
    wanted = [*places, *(turns if set(turns) & set(columns) else [])]
    if missing := [name for name in wanted if name not in columns]:
        raise ShapeError(f"no column {missing[0]}; the columns are {', '.join(columns)}")
    if unknown := [name for name in columns if name not in wanted]:
        raise ShapeError(f"unknown column {unknown[0]}; give x, y, z, rx, ry, rz, or x, y, angle in the plane")
    position = np.stack([columns[name] for name in places], axis=-1)
    if len(wanted) == len(places):
        return _within(PoseList(position))
    angles = np.stack([columns[name] for name in turns], axis=-1)
    if (far := np.abs(angles).max(axis=1) > MAX_ANGLE).any():
        row = int(np.flatnonzero(far)[0])
        raise ShapeError(f"pose {row + 1} is turned by {brief(angles[row].tolist())}; give angles in rad")
    if not spatial:
        return _within(PoseList(position, columns["angle"]))
    return _within(PoseList(position, kinematics.exponential(angles)))


def _from_arrays(arrays: dict[str, Floats]) -> PoseList:
    if "position" not in arrays or set(arrays) - {"position", "rotation"}:
        there = ", ".join(arrays) or "none"
        raise ShapeError(f"its arrays are {there:.100}; give position, and rotation or not")
    return PoseList(**arrays)


def _axis(name: str, ends: ArrayLike, step: float) -> Floats:
    """Coordinates from one end to the other."""
    values = pose.numbers(ends, name)
    if values.ndim == 0:
        return values.reshape(1)
    if values.shape != (2,):
        raise ShapeError(f"{name} has shape {values.shape}; give two ends in m, such as (0, 1), or one number")
    if values[0] > values[1]:
        raise ShapeError(f"{name} goes from {values[0]:g} to {values[1]:g} m; give the lower end first")
    count = (values[1] - values[0]) / step
    if not count < LONGEST_AXIS:
        raise ShapeError(f"a step of {step:g} m gives {count:.3g} poses along {name}; give a larger one")
    # A step that divides the edge but for rounding ends exactly on the end.
    whole = round(count)
    if abs(count - whole) <= 1e-9 * max(1.0, whole):
        return np.asarray(np.linspace(values[0], values[1], whole + 1))
    return np.asarray(values[0] + step * np.arange(int(count) + 1))
