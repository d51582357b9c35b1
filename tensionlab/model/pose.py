"""Poses and body frames: checked, and turned into arrays that fit together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import RigError, ShapeError
from tensionlab.model import kinematics
from tensionlab.model.module import WORLD, ArrayRecord, Module, require_name, vector
from tensionlab.support.arrays import Floats, as_floats, common_axes, readonly_copy, require_finite
from tensionlab.support.files.reading import brief

ORTHOGONALITY = 1e-6  # largest entry of `R R' - 1` in what is still taken for a rotation


class CoordinateFrame(NamedTuple):
    """Pose of a body frame. A tuple ``(position, rotation)`` or a position is accepted as well.

    Attributes
    ----------
    position : (..., d) array
        Position of the body's origin, in m.
    rotation : (..., 3, 3) array, (...) array or None
        Orientation: a matrix in space, an angle in rad in the plane; None for the identity.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # a quarter turn about Y
    >>> hip = tl.CoordinateFrame([0.0, 0.9, 0.0], turned)
    >>> rig = tl.load_rig("body-mounted")
    >>> rig.structure_matrix(rig.home, frames={name: hip for name in rig.frames}).shape
    (3, 5)
    """

    position: ArrayLike
    rotation: ArrayLike | None = None


MAX_ROTATION_RAD = 100.0  # in a file, about each axis: beyond some turns an angle is a mistake


@dataclass(frozen=True, eq=False)
class RestPose(ArrayRecord):
    """Default pose of a body frame. RigError names the frame and the wrong key.

    Attributes
    ----------
    position : (d,) read-only array
        Position of the body's origin in the world, in m.
    rotation : (3,) or (1,) read-only array, or None
        Axis times angle in space, an angle in the plane, in rad; None for the identity.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.RestPose("hip", [0.0, 0.9, 0.0]).frame.position
    array([0. , 0.9, 0. ])
    """

    name: str
    position: Floats
    rotation: Floats | None = None

    def __post_init__(self) -> None:
        require_name(self.name, "frame", "name", "give the name of a body frame")
        here = f'frame "{self.name}"'
        object.__setattr__(self, "position", vector(self.position, here, "position"))
        if self.rotation is not None:
            turn = rotation_vector(self.rotation, here, "rotation", self.position.size)
            object.__setattr__(self, "rotation", turn)

    @property
    def frame(self) -> CoordinateFrame:
        """Pose with a matrix in space and an angle in the plane."""
        if self.rotation is None:
            return CoordinateFrame(self.position)
        turn = self.rotation
        return CoordinateFrame(self.position, kinematics.exponential(turn) if turn.size == 3 else turn[0])


def rotation_vector(values: ArrayLike, where: str, key: str, dimension: int) -> Floats:
    """Return axis times angle, (3,), or in the plane an angle, (1,), in rad; RigError for other numbers."""
    turn = np.atleast_1d(as_floats(key, values))
    if turn.shape != ({2: 1, 3: 3}.get(dimension),):
        raise RigError(f'{where}: key "{key}" must have three numbers in space, one in the plane')
    if not (np.abs(turn) <= MAX_ROTATION_RAD).all():
        raise RigError(f'{where}: key "{key}" is {brief(turn.tolist())}; give rad, within {MAX_ROTATION_RAD:g}')
    return readonly_copy(turn)


# Where each named body frame is: a `CoordinateFrame`, a tuple (position, rotation), or a position alone.
Frames = Mapping[str, CoordinateFrame | tuple[ArrayLike, ArrayLike | None] | ArrayLike]


def frame_of(where: CoordinateFrame | tuple[ArrayLike, ArrayLike | None] | ArrayLike) -> CoordinateFrame:
    """Return a body frame, in whichever way it was given."""
    if isinstance(where, CoordinateFrame):
        return where
    if isinstance(where, tuple) and len(where) == 2 and np.ndim(where[0]) > 0:
        return CoordinateFrame(*where)
    return CoordinateFrame(cast(ArrayLike, where))


def require_known(frames: Iterable[str], known: Iterable[str]) -> None:
    """Refuse the name of a frame that no module is attached to, and no body."""
    if unknown := sorted(set(frames) - set(known)):
        listed = ", ".join(known) or "none"
        raise RigError(
            f'no module or body is attached to the frame "{unknown[0]}"; the body frames of this rig are: {listed}'
        )


def frame_matrix(
    where: CoordinateFrame | tuple[ArrayLike, ArrayLike | None] | ArrayLike, dimension: int
) -> Floats:
    """Return rotation and position of a body frame, side by side, (d, d + 1)."""
    position, rotation = frame_of(where)
    turn = np.eye(dimension) if rotation is None else rotations(rotation, dimension, "rotation")
    return np.column_stack([turn, position])


def place_anchors(modules: Sequence[Module], anchors: Floats, frames: Frames | None) -> Floats:
    """Return the anchors in the world, (..., m, d), in m; (m, d) where all stand in the world.

    ``anchors``, (m, d), are each in the axes of its module's own frame, in m. RigError if a module's frame is
    missing; ShapeError for a bad position or rotation of a frame.
    """
    given: Frames = {} if frames is None else frames
    attached: dict[str, list[int]] = {}
    for index, module in enumerate(modules):
        if module.frame == WORLD:
            continue
        if module.frame not in given:
            raise RigError(
                f'module "{module.name}" (index {index}) is attached to the frame "{module.frame}", which is '
                f'missing; give frames={{"{module.frame}": (position, rotation)}}'
            )
        attached.setdefault(module.frame, []).append(index)
    if not attached:
        return anchors
    d = anchors.shape[-1]
    moved: list[tuple[list[int], Floats]] = []
    shapes: dict[str, tuple[int, ...]] = {}
    for name, own in attached.items():
        position, rotation = frame_of(given[name])
        what = f'frame "{name}" position'
        origin = points(position, d, what)
        shapes[what] = origin.shape[:-1]
        carried = anchors[own]
        if rotation is not None:
            what = f'frame "{name}" rotation'
            turn = rotations(rotation, d, what)
            shapes[what] = turn.shape[:-2]
            carried = kinematics.rotate(turn, carried)
        common_axes(shapes)
        moved.append((own, origin[..., None, :] + carried))
    placed = np.broadcast_to(anchors, (*common_axes(shapes), *anchors.shape)).copy()
    for own, part in moved:
        placed[..., own, :] = part
    return placed


def place_axes(modules: Sequence[Module], axes: Floats, frames: Frames | None) -> Floats:
    """Return directions, (m, d), one a module in the axes of its own frame, in world axes, (..., m, d)."""
    return place_anchors(modules, axes, frames) - place_anchors(modules, np.zeros_like(axes), frames)


def to_module_frames(modules: Sequence[Module], vectors: Floats, frames: Frames | None) -> Floats:
    """Turn vectors, (..., m, d), one a module, from world axes to those of each module's own frame."""
    if all(module.frame == WORLD for module in modules):
        return vectors
    corners = np.eye(vectors.shape[-1])
    axes = [place_axes(modules, np.tile(corner, (len(modules), 1)), frames) for corner in corners]
    return np.stack([np.einsum("...i,...i->...", vectors, axis) for axis in axes], axis=-1)


def points(values: ArrayLike, size: int, what: str) -> Floats:
    """Return finite floats whose last axis holds ``size`` coordinates or cables."""
    array = require_finite(what, values, 0)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ShapeError(f"{what} has shape {array.shape}; its last axis must hold {size} entries")
    return array


def rotations(values: ArrayLike, dimension: int, what: str) -> Floats:
    """Return orientations as (..., d, d) rotation matrices, from angles in the plane or matrices in space."""
    array = require_finite(what, values, 0)
    if dimension == 2:
        return kinematics.planar_rotation(array)
    if array.shape[-2:] != (3, 3):
        raise ShapeError(f"{what} has shape {array.shape}; give rotation matrices of shape (..., 3, 3)")
    array = np.clip(array, -2.0, 2.0)  # none has such entries, and their squares would overflow
    off = np.abs(array @ np.swapaxes(array, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    wrong = (off > ORTHOGONALITY) | (np.linalg.det(array) < 0)
    if wrong.any():
        why = f"R R' is off the identity by {off[wrong].flat[0]:.2g}, or R mirrors"
        raise ShapeError(f"{what}{first(wrong)} is not a rotation: {why}")
    return array


def first(wrong: NDArray[np.bool_]) -> str:
    """Return the index of the first True entry, as ``[1, 2]``; nothing for a scalar."""
    return str([int(i) for i in np.argwhere(wrong)[0]]) if wrong.ndim else ""
