"""Poses as people give them, turned into arrays that fit together, or refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.arrays import Floats, as_floats
from tensionlab.errors import RigError, ShapeError
from tensionlab.model import kinematics
from tensionlab.model.module import WORLD, Module

ORTHOGONALITY = 1e-6
"""Largest entry of ``R R' - 1`` in what is still taken for a rotation."""


class Frame(NamedTuple):
    """Where is a body that carries modules? A tuple ``(position, rotation)`` or a position does as well.

    Attributes
    ----------
    position : (..., d) array
        Of the body's origin, in m.
    rotation : (..., 3, 3) array, (...) array or None
        Its orientation: a matrix in space, an angle in rad in the plane; None for no turn.
    """

    position: ArrayLike
    rotation: ArrayLike | None = None


Frames = Mapping[str, Frame | tuple[ArrayLike, ArrayLike | None] | ArrayLike]
"""Where each named body frame is: a `Frame`, a tuple (position, rotation), or a position alone."""


def frame_of(where: Frame | tuple[ArrayLike, ArrayLike | None] | ArrayLike) -> Frame:
    """Where is a body frame, in whichever way it was given?"""
    if isinstance(where, Frame):
        return where
    if isinstance(where, tuple) and len(where) == 2 and np.ndim(where[0]) > 0:
        return Frame(*where)
    return Frame(cast(ArrayLike, where))


def place_anchors(modules: Sequence[Module], anchors: Floats, frames: Frames | None) -> Floats:
    """Where in the world are the anchors, with the body frames where they are now?

    Parameters
    ----------
    modules : sequence of Module
    anchors : (m, d) array
        Their anchors, each in the axes of its own frame, in m.
    frames : mapping of name to Frame, (position, rotation) or position, or None

    Returns
    -------
    (..., m, d) array
        In m; (m, d) where no module rides on a body.

    Raises
    ------
    RigError
        A frame that a module rides on is missing, or a frame is given that none rides on.
    ShapeError
        Positions or rotations of frames that are no such thing, or do not broadcast.
    """
    given: Frames = {} if frames is None else frames
    names = list(dict.fromkeys(module.frame for module in modules if module.frame != WORLD))
    for index, module in enumerate(modules):
        if module.frame != WORLD and module.frame not in given:
            raise RigError(
                f'module "{module.name}" (index {index}) rides on the frame "{module.frame}", which is '
                f'missing; give frames={{"{module.frame}": (position, rotation)}}'
            )
    if unknown := sorted(set(given) - set(names)):
        listed = ", ".join(names) if names else "none"
        raise RigError(f'no module rides on the frame "{unknown[0]}"; the body frames of this rig are: {listed}')
    if not names:
        return anchors
    origins: list[Floats] = []
    turns: list[Floats | None] = []
    shapes: dict[str, tuple[int, ...]] = {}
    for name in names:
        position, rotation = frame_of(given[name])
        what = f'frame "{name}" '
        origins.append(points(position, anchors.shape[-1], what + "position"))
        shapes[what + "position"] = origins[-1].shape[:-1]
        turn = None if rotation is None else rotations(rotation, anchors.shape[-1], what + "rotation")
        if turn is not None:
            shapes[what + "rotation"] = turn.shape[:-2]
        turns.append(turn)
    common_shape(shapes)
    index_of = np.array([names.index(module.frame) if module.frame != WORLD else -1 for module in modules])
    return kinematics.place(anchors, index_of, origins, turns)


def in_own_axes(modules: Sequence[Module], vectors: Floats, frames: Frames | None) -> Floats:
    """Which components do vectors in world axes have in the axes of each module's own frame?

    Parameters
    ----------
    modules : sequence of Module
    vectors : (..., m, d) array
        One a module.
    frames : as in `place_anchors`

    Returns
    -------
    (..., m, d) array
    """
    if all(module.frame == WORLD for module in modules):
        return vectors
    corners = np.eye(vectors.shape[-1])
    here = place_anchors(modules, np.zeros(vectors.shape[-2:]), frames)
    axes = [place_anchors(modules, np.tile(each, (len(modules), 1)), frames) - here for each in corners]
    return np.stack([np.einsum("...i,...i->...", vectors, axis) for axis in axes], axis=-1)


def points(values: ArrayLike, size: int, what: str) -> Floats:
    """Check an array whose last axis holds coordinates or cables.

    Raises
    ------
    ShapeError
        If the last axis has another length than ``size``, or an entry is NaN or infinite.
    """
    array = numbers(values, what)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ShapeError(f"{what} has shape {array.shape}; its last axis must hold {size} entries")
    return array


def rotations(values: ArrayLike, dimension: int, what: str) -> Floats:
    """Check orientations and return them as (..., d, d) matrices; angles in the plane, matrices in space.

    Raises
    ------
    ShapeError
        If the shape is wrong, an entry is NaN or infinite, or a matrix is not a rotation.
    """
    array = numbers(values, what)
    if dimension == 2:
        return kinematics.planar_rotation(array)
    if array.shape[-2:] != (3, 3):
        raise ShapeError(f"{what} has shape {array.shape}; give rotation matrices of shape (..., 3, 3)")
    array = np.clip(array, -2.0, 2.0)  # none has such entries, and their squares would overflow
    off = np.abs(array @ np.swapaxes(array, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    wrong = (off > ORTHOGONALITY) | (np.linalg.det(array) < 0)
    if wrong.any():
        raise ShapeError(
            f"{what}{first(wrong)} is not a rotation: R R' is off the identity by {off[wrong].flat[0]:.2g}, "
            "or R mirrors; give orthonormal right-handed matrices"
        )
    return array


def numbers(values: ArrayLike, what: str) -> Floats:
    """Turn anything into a float array, or name the first entry that is not a finite number."""
    array = as_floats(what, values)
    bad = ~np.isfinite(array)
    if bad.any():
        raise ShapeError(f"{what}{first(bad)} is {array[bad].flat[0]}; every entry must be finite")
    return array


def common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Find the common leading shape of named arrays.

    Raises
    ------
    ShapeError
        Naming each array with its leading shape, if they do not broadcast.
    """
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ShapeError(f"leading shapes do not broadcast: {listed}; insert axes of length 1") from None


def first(wrong: NDArray[np.bool_]) -> str:
    """Write the index of the first True entry, as ``[1, 2]``; nothing for a scalar."""
    return str([int(i) for i in np.argwhere(wrong)[0]]) if wrong.ndim else ""
