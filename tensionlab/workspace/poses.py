"""Sets of poses: a grid or a list, from a box or a file.

A set of poses has labelled axes and is cut into blocks along them; coordinates of a grid are made for one
block at a time, so that a grid of any size takes no memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import MAX_LENGTH
from tensionlab.support.arrays import Floats, as_floats, require_finite
from tensionlab.support.files.reading import brief
from tensionlab.support.files.tables import read_columns
from tensionlab.support.formatting import format_count, format_range
from tensionlab.workspace.orientations import Orientations, roll_pitch_yaw_of
from tensionlab.workspace.shares import node_weights

ROTATION_COLUMNS = ["rx", "ry", "rz"]  # axis times angle of an orientation in space, in rad
MAX_ANGLE_RAD = 1000.0  # a larger angle is taken for another unit
MAX_AXIS_POSES = 10_000_000  # more along one axis are taken for a mistaken step

# Coordinate of a dataset, as xarray takes it: axes, values and attributes.
Label = tuple[tuple[str, ...], NDArray[Any], dict[str, str]]


def label(dims: tuple[str, ...], values: NDArray[Any], units: str, long_name: str) -> Label:
    """Return a coordinate with its unit and meaning."""
    return dims, values, {"units": units, "long_name": long_name}


@dataclass(frozen=True, eq=False)
class Grid:
    """Every combination of coordinates, and of orientations if there are any; ShapeError for wrong arrays.

    Attributes
    ----------
    x, y, z : arrays of one axis, or numbers
        Coordinates of the reference point, in m. No z in the plane.
    rotations : (k, 3, 3) array, (k,) array or None
        Orientations, as in `Rig.structure_matrix`: matrices in space, angles in rad in the plane. In shares of a
        workspace those of `cone` and `roll_pitch_yaw` have their weights, angles count as coordinates do, and
        other matrices count the same.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> tl.workspace.Grid(np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 2.0, 3), 0.0).y
    array([0., 1., 2.])
    """

    x: Floats
    y: Floats
    z: Floats | None = None
    rotations: Floats | None = None
    rotation_weights: Floats | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        for name in self.dims[: self.dimension]:
            axis = np.atleast_1d(require_finite(name, getattr(self, name), 0))
            if axis.ndim != 1 or axis.size == 0:
                raise ShapeError(f"{name} has shape {axis.shape}; give one or more coordinates in m, in a row")
            object.__setattr__(self, name, axis)
        if self.rotations is not None:
            pose.rotations(self.rotations, self.dimension, "rotations")
            rotations = as_floats("rotations", self.rotations)
            if rotations.ndim != (1 if self.dimension == 2 else 3) or not len(rotations):
                raise ShapeError(f"rotations has shape {rotations.shape}; give one or more orientations in a row")
            weights = np.full(len(rotations), 1.0 / len(rotations))
            if self.dimension == 2:
                weights = node_weights(rotations)
            elif isinstance(self.rotations, Orientations):
                weights = self.rotations.weights
            object.__setattr__(self, "rotations", rotations)
            object.__setattr__(self, "rotation_weights", weights)

    def __repr__(self) -> str:
        edges = ", ".join(f"{name} {format_range(axis)} m" for name, axis in self._axes().items() if name in "xyz")
        return f"<Grid of {' x '.join(map(str, self.shape))} poses: {edges}>"

    @property
    def dimension(self) -> int:
        """Dimension of space: 2 or 3."""
        return 2 if self.z is None else 3

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        turns = () if self.rotations is None else ("angle",) if self.dimension == 2 else ("orientation",)
        return (*"xyz"[: self.dimension], *turns)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of poses along each axis."""
        return tuple(map(len, self._axes().values()))

    def block(self, where: Sequence[slice]) -> Grid:
        """Return the poses in a slice of every axis."""
        return Grid(**{name: axis[part] for (name, axis), part in zip(self._axes().items(), where, strict=True)})

    def arrays(self) -> tuple[Floats, Floats | None]:
        """Return positions (B, d) and rotations, (B, 3, 3), (B,) or None; the last axis runs fastest."""
        index = np.indices(self.shape).reshape(len(self.shape), -1)
        parts = [axis[i] for axis, i in zip(self._axes().values(), index, strict=True)]
        return np.stack(parts[: self.dimension], axis=-1), None if self.rotations is None else parts[-1]

    def weights(self) -> list[Floats]:
        """Return the share of the grid that belongs to each pose, along each axis."""
        places = [node_weights(axis) for name, axis in self._axes().items() if name in "xyz"]
        return places if self.rotation_weights is None else [*places, self.rotation_weights]

    def labels(self) -> dict[str, Label]:
        """Return the labels of the axes."""
        labels = {name: _length(name, axis, name) for name, axis in self._axes().items() if name in "xyz"}
        if self.rotations is None or self.rotation_weights is None:
            return labels
        dim = self.dims[-1]
        labels[f"{dim}_weight"] = label((dim,), self.rotation_weights, "1", "share of the orientations")
        if self.dimension == 3:
            labels[dim] = label((dim,), np.arange(len(self.rotations)), "1", "number of the orientation")
            for name, angle in zip(("roll", "pitch", "yaw"), roll_pitch_yaw_of(self.rotations).T, strict=True):
                labels[name] = label((dim,), angle, "rad", f"{name} of the platform")
        return labels | _orientation(dim, self.rotations)

    def _axes(self) -> dict[str, Floats]:
        axes = {"x": self.x, "y": self.y, "z": self.z, "rotations": self.rotations}
        return {name: axis for name, axis in axes.items() if axis is not None}


@dataclass(frozen=True, eq=False)
class PoseList:
    """List of poses. ShapeError if they do not fit together, are not finite, or a matrix is no rotation.

    Attributes
    ----------
    position : (k, d) array
        Of the reference point, in m.
    rotation : (k, 3, 3) array, (k,) array or None
        Orientations, as in `Rig.structure_matrix`: matrices in space, angles in rad in the plane.
    wrench : (k, d) array, (k, n) array or None
        Force, or force and torque, that the cables must exert at each pose in addition to what is required of the
        rig, in N and N·m.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.PoseList([[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]).position.shape
    (2, 3)
    """

    position: Floats
    rotation: Floats | None = None
    wrench: Floats | None = None

    def __post_init__(self) -> None:
        position = require_finite("position", self.position, 0)
        if position.ndim != 2 or position.shape[0] == 0 or position.shape[1] not in (2, 3):
            raise ShapeError(f"position has shape {position.shape}; give one or more rows of x, y (and z), in m")
        object.__setattr__(self, "position", position)
        if self.rotation is not None:
            pose.rotations(self.rotation, self.dimension, "rotation")
            rotation, k = as_floats("rotation", self.rotation), len(position)
            expected = (k,) if self.dimension == 2 else (k, 3, 3)
            if rotation.shape != expected:
                raise ShapeError(f"rotation has shape {rotation.shape}; {k} positions need {expected}")
            object.__setattr__(self, "rotation", rotation)
        if self.wrench is not None:
            wrench, (k, d) = require_finite("wrench", self.wrench, 2), position.shape
            if wrench.shape not in ((k, d), (k, 3 * (d - 1))):
                raise ShapeError(f"wrench has shape {wrench.shape}; give ({k}, {d}) or ({k}, {3 * (d - 1)})")
            object.__setattr__(self, "wrench", wrench)

    def __repr__(self) -> str:
        axes = zip("xyz", self.position.T, strict=False)
        edges = ", ".join(f"{axis} {format_range(values)} m" for axis, values in axes)
        return f"<PoseList of {format_count(len(self.position), 'pose')}: {edges}>"

    @property
    def dimension(self) -> int:
        """Dimension of space: 2 or 3."""
        return int(self.position.shape[1])

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes: one, "pose"."""
        return ("pose",)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of poses along each axis."""
        return (len(self.position),)

    def block(self, where: Sequence[slice]) -> PoseList:
        """Return the poses in a slice of the list."""
        (part,) = where
        arrays = (self.position, self.rotation, self.wrench)
        return PoseList(*(None if array is None else array[part] for array in arrays))  # type: ignore[arg-type]

    def arrays(self) -> tuple[Floats, Floats | None]:
        """Return positions (B, d) and rotations, (B, 3, 3), (B,) or None."""
        return self.position, self.rotation

    def labels(self) -> dict[str, Label]:
        """Return the labels of the list."""
        labels = {"pose": label(("pose",), np.arange(len(self.position)), "1", "number of the pose")}
        labels |= {name: _length("pose", axis, name) for name, axis in zip("xyz", self.position.T, strict=False)}
        if self.wrench is not None:
            names = wrench_columns(self.dimension, self.wrench.shape[1])
            for name, column in zip(names, self.wrench.T, strict=True):
                unit = "N" if name.startswith("F") else "N m"
                labels[name] = label(("pose",), column, unit, f"{name} that is required")
        return labels if self.rotation is None else labels | _orientation("pose", self.rotation)


Poses = Grid | PoseList


def _length(dim: str, values: Floats, name: str) -> Label:
    return label((dim,), values, "m", f"{name} of the reference point")


def _orientation(dim: str, rotations: Floats) -> dict[str, Label]:
    """Label angles or matrices along an axis."""
    if rotations.ndim == 1:
        return {"angle": label((dim,), rotations, "rad", "angle of the platform")}
    return {"rotation": label((dim, "row", "column"), rotations, "1", "rotation of the platform to the world")}


def box(
    x: ArrayLike, y: ArrayLike, z: ArrayLike | None = None, *, step: ArrayLike, rotations: ArrayLike | None = None
) -> Grid:
    """Return a grid of poses that fills a box. InputError or ShapeError for a wrong interval or step.

    Parameters
    ----------
    x, y, z : (from, to), or a number
        The box, in m; a number is a plane of it. No z in the plane.
    step : number, or one for each axis
        Distance of neighbours, in m. The first is at ``from``, the last at ``to`` if the step divides the edge.
    rotations
        As in `Grid`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.box([-0.1, 0.1], [0.0, 2.0], 0.0, step=[0.1, 1.0, 1.0]).x
    array([-0.1,  0. ,  0.1])
    """
    intervals = [x, y] if z is None else [x, y, z]
    steps = require_finite("step", step, 0)
    if steps.shape not in ((), (len(intervals),)) or not (steps > 0).all():
        raise InputError(f"step is {brief(steps.tolist())}; give one length in m, or one an axis, above zero")
    each_step = np.broadcast_to(steps, len(intervals)).tolist()
    axes = [_axis(*given) for given in zip("xyz", intervals, each_step, strict=False)]
    return Grid(*axes, rotations=rotations)  # type: ignore[arg-type, misc]  # becomes an array


def _axis(name: str, ends: ArrayLike, step: float) -> Floats:
    """Return coordinates from one end to the other."""
    values = require_finite(name, ends, 0)
    if values.ndim == 0:
        return values.reshape(1)
    if values.shape != (2,):
        raise ShapeError(f"{name} has shape {values.shape}; give two ends in m, such as (0, 1), or one number")
    if values[0] > values[1]:
        raise InputError(f"{name} goes from {values[0]:g} to {values[1]:g} m; give the lower end first")
    count = (values[1] - values[0]) / step
    if not count < MAX_AXIS_POSES:
        raise InputError(f"a step of {step:g} m gives {count:.3g} poses along {name}; give a larger one")
    # A step that divides the edge but for rounding ends exactly on the end.
    whole = round(count)
    if abs(count - whole) <= 1e-9 * max(1.0, whole):
        return np.asarray(np.linspace(values[0], values[1], whole + 1))
    return np.asarray(values[0] + step * np.arange(int(count) + 1))


def read_poses(path: str | Path) -> PoseList:
    r"""Return the poses that a file lists, whose path ends in .csv or .parquet.

    Its columns are x, y and z in m, in the plane x and y. An orientation is given by rx, ry, rz, the axis times
    the angle in rad, in the plane by angle in rad; a wrench by Fx, Fy, Fz in N and Mx, My, Mz in N·m, in the plane
    by Fx, Fy and Mz, without torques where these are left out. DataError names file and row.

    Examples
    --------
    >>> from pathlib import Path
    >>> import tensionlab as tl
    >>> _ = Path("poses.csv").write_text("x,y,z\n0.0,0.3,0.0\n0.0,1.0,0.0\n")
    >>> tl.workspace.read_poses("poses.csv").position
    array([[0. , 0.3, 0. ],
           [0. , 1. , 0. ]])
    """
    names = ["z", *ROTATION_COLUMNS, "angle", *wrench_columns(3, 6)]
    columns = read_columns(path, ["x", "y"], names, DataError, "a file of poses")
    try:
        poses = poses_from_columns(columns)
        _require_below(MAX_LENGTH, poses.position, "is", f"m, within {MAX_LENGTH:g}")
    except (DataError, ShapeError) as error:
        raise DataError(f"{path}: {error}") from None
    return poses


def wrench_columns(dimension: int, n: int) -> list[str]:
    """Return the names of the columns of a wrench of n components: Fx, Fy, Fz, Mx, My, Mz, or Fx, Fy, Mz."""
    torques = ["Mx", "My", "Mz"] if dimension == 3 else ["Mz"]
    return [f"F{axis}" for axis in "xyz"[:dimension]] + torques[: n - dimension]


def poses_from_columns(columns: dict[str, Floats]) -> PoseList:
    """Return poses from the columns of `read_poses`; DataError for others."""
    spatial, d = "z" in columns, 3 if "z" in columns else 2
    places, turns = (["x", "y", "z"], ROTATION_COLUMNS) if spatial else (["x", "y"], ["angle"])
    forces, wrench_names = wrench_columns(d, d), wrench_columns(d, 3 * (d - 1))
    turned, loaded = bool(set(turns) & set(columns)), bool(set(wrench_names) & set(columns))
    needed = [*places, *(turns if turned else []), *(forces if loaded else [])]
    if missing := [name for name in needed if name not in columns]:
        raise DataError(f"no column {missing[0]}; the columns are {', '.join(columns)}")
    if unknown := [name for name in columns if name not in [*needed, *wrench_names]]:
        raise DataError(f"unknown column {unknown[0]}; give {', '.join([*places, *turns, *wrench_names])}")
    position, rotation, wrench = np.stack([columns[name] for name in places], axis=-1), None, None
    if turned:
        angles = np.stack([columns[name] for name in turns], axis=-1)
        _require_below(MAX_ANGLE_RAD, angles, "is turned by", "angles in rad")
        rotation = kinematics.exponential(angles) if spatial else angles[:, 0]
    if loaded:
        names = wrench_names if set(wrench_names[d:]) & set(columns) else forces
        wrench = np.stack([columns.get(name, np.zeros(len(position))) for name in names], axis=-1)
    return PoseList(position, rotation, wrench)


def _require_below(largest: float, rows: Floats, what: str, expected: str) -> None:
    """Refuse numbers that are too large to be meant, as of a file in other units."""
    if len(far := np.flatnonzero(np.abs(rows).max(axis=1) > largest)):
        raise DataError(f"pose {far[0] + 1} {what} {brief(rows[far[0]].tolist())}; give {expected}")
