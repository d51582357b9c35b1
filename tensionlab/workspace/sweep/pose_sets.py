"""Where to ask: the poses of a sweep, as a grid or a list.

A set of poses has labelled axes and is cut into blocks along them; coordinates of a grid are made for one
block at a time, so that a grid of any size takes no memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.arrays import Floats, as_floats
from tensionlab.errors import ShapeError
from tensionlab.model import pose


class Coordinate(NamedTuple):
    """One labelled coordinate of a dataset: its axes, values, unit and meaning."""

    name: str
    dims: tuple[str, ...]
    values: NDArray[np.generic]
    units: str
    long_name: str


@dataclass(frozen=True, eq=False)
class Grid:
    """Every combination of coordinates, and of orientations if there are any.

    Attributes
    ----------
    x, y, z : arrays of one axis, or numbers
        Coordinates of the reference point, in m. No z in the plane.
    rotations : (k, 3, 3) array, (k,) array or None
        Orientations, as in `Rig.structure_matrix`: matrices in space, angles in rad in the plane.

    Raises
    ------
    ShapeError
        If an axis is empty or has more than one dimension, an entry is no finite number, or a matrix no rotation.
    """

    x: Floats
    y: Floats
    z: Floats | None = None
    rotations: Floats | None = None

    def __post_init__(self) -> None:
        for name in "xyz":
            if getattr(self, name) is not None:
                axis = np.atleast_1d(pose.numbers(getattr(self, name), name))
                if axis.ndim != 1 or axis.size == 0:
                    raise ShapeError(f"{name} has shape {axis.shape}; give one or more coordinates in m, in a row")
                object.__setattr__(self, name, axis)
        if self.rotations is not None:
            turns = _turns(self.rotations, self.dimension, "rotations")
            if turns.shape[:1] in ((), (0,)) or turns.ndim != (1 if self.dimension == 2 else 3):
                raise ShapeError(f"rotations has shape {turns.shape}; give one or more orientations in a row")
            object.__setattr__(self, "rotations", turns)

    @property
    def dimension(self) -> int:
        """Of space: 2 or 3."""
        return 2 if self.z is None else 3

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        turns = () if self.rotations is None else ("angle",) if self.dimension == 2 else ("orientation",)
        return (*"xyz"[: self.dimension], *turns)

    @property
    def shape(self) -> tuple[int, ...]:
        """Poses along each axis."""
        return tuple(len(axis) for axis in self._axes())

    def block(self, where: Sequence[slice]) -> Grid:
        """Which poses lie in a slice of every axis?"""
        parts = [axis[part] for axis, part in zip(self._axes(), where, strict=True)]
        z = parts[2] if self.dimension == 3 else None
        return Grid(parts[0], parts[1], z, None if self.rotations is None else parts[-1])

    def arrays(self) -> tuple[Floats, Floats | None]:
        """Which positions (B, d) and rotations, (B, 3, 3), (B,) or None, are these? The last axis runs fastest."""
        index = np.indices(self.shape).reshape(len(self.shape), -1)
        axes = self._axes()
        position = np.stack([axis[i] for axis, i in zip(axes, index[: self.dimension], strict=False)], axis=-1)
        return position, None if self.rotations is None else self.rotations[index[-1]]

    def coordinates(self) -> list[Coordinate]:
        """How are the axes labelled?"""
        found = [_length(name, (name,), getattr(self, name)) for name in self.dims[: self.dimension]]
        if self.rotations is None:
            return found
        if self.dimension == 2:
            return [*found, Coordinate("angle", ("angle",), self.rotations, "rad", "angle of the platform")]
        number = np.arange(len(self.rotations))
        return [
            *found,
            Coordinate("orientation", ("orientation",), number, "1", "number of the orientation"),
            _matrices("orientation", self.rotations),
        ]

    def _axes(self) -> list[Floats]:
        return [axis for axis in (self.x, self.y, self.z, self.rotations) if axis is not None]


@dataclass(frozen=True, eq=False)
class PoseList:
    """Poses one after another.

    Attributes
    ----------
    position : (k, d) array
        Of the reference point, in m.
    rotation : (k, 3, 3) array, (k,) array or None
        Orientations, as in `Rig.structure_matrix`: matrices in space, angles in rad in the plane.
    distance : (k,) array or None
        How far along a path each pose is, in m; None where they are no path.

    Raises
    ------
    ShapeError
        If the shapes do not fit, an entry is no finite number, or a matrix no rotation.
    """

    position: Floats
    rotation: Floats | None = None
    distance: Floats | None = None

    def __post_init__(self) -> None:
        position = pose.numbers(self.position, "position")
        if position.ndim != 2 or position.shape[0] == 0 or position.shape[1] not in (2, 3):
            raise ShapeError(f"position has shape {position.shape}; give one or more rows of x, y (and z), in m")
        object.__setattr__(self, "position", position)
        k = len(position)
        if self.rotation is not None:
            turns = _turns(self.rotation, self.dimension, "rotation")
            one = (k,) if self.dimension == 2 else (k, 3, 3)
            if turns.shape != one:
                raise ShapeError(
                    f"rotation has shape {turns.shape}; {k} positions need orientations of shape {one}"
                )
            object.__setattr__(self, "rotation", turns)
        if self.distance is not None:
            distance = pose.points(self.distance, k, "distance")
            object.__setattr__(self, "distance", distance)

    @property
    def dimension(self) -> int:
        """Of space: 2 or 3."""
        return int(self.position.shape[1])

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes: one, "pose"."""
        return ("pose",)

    @property
    def shape(self) -> tuple[int, ...]:
        """Poses along each axis."""
        return (len(self.position),)

    def block(self, where: Sequence[slice]) -> PoseList:
        """Which poses lie in a slice of the list?"""
        (part,) = where
        return PoseList(*(None if each is None else each[part] for each in self._columns()))  # type: ignore[arg-type]

    def arrays(self) -> tuple[Floats, Floats | None]:
        """Which positions (B, d) and rotations, (B, 3, 3), (B,) or None, are these?"""
        return self.position, self.rotation

    def coordinates(self) -> list[Coordinate]:
        """How is the list labelled?"""
        number = np.arange(len(self.position))
        found = [Coordinate("pose", ("pose",), number, "1", "number of the pose")]
        found += [_length(name, ("pose",), self.position[:, i]) for i, name in enumerate("xyz"[: self.dimension])]
        if self.distance is not None:
            found.append(Coordinate("distance", ("pose",), self.distance, "m", "distance along the path"))
        if self.rotation is None:
            return found
        if self.dimension == 2:
            return [*found, Coordinate("angle", ("pose",), self.rotation, "rad", "angle of the platform")]
        return [*found, _matrices("pose", self.rotation)]

    def _columns(self) -> tuple[Floats | None, ...]:
        return self.position, self.rotation, self.distance


Poses = Grid | PoseList


def _turns(values: ArrayLike, dimension: int, what: str) -> Floats:
    """Angles or matrices, checked."""
    pose.rotations(values, dimension, what)
    return as_floats(what, values)


def _length(name: str, dims: tuple[str, ...], values: Floats) -> Coordinate:
    return Coordinate(name, dims, values, "m", f"{name} of the reference point")


def _matrices(dim: str, rotations: Floats) -> Coordinate:
    return Coordinate("rotation", (dim, "row", "column"), rotations, "1", "rotation of the platform to the world")
