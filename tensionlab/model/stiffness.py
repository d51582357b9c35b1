"""Stiffness of a rig: the wrench per displacement of the platform while the winches hold their cables.

A cable has a fixed unstretched length, so that with ``EA`` its stiffness per strain (`Module.cable_stiffness`), t
its tension and l its length, dt = (EA + t)/l dl. Its direction u turns by ``-D da`` as its attachment moves by da,
with ``D = (I - u u')/l`` at a fixed anchor, and the derivative in `tensionlab.model.pulleys` over a pulley. With r
the arm, and ``A = [I, -[r]x]`` from twists to the velocity of the attachment, the stiffness matrix is::

    K = sum of A' ((EA + t)/l u u' + t D) A  +  t ((r . u) I - r u') in the block of torques and rotations

where the last part comes from the arm, which turns with the platform. K is linear in the tensions.

Sources: Behzadipour and Khajepour 2006, "Stiffness of cable-based parallel manipulators with application to
stability analysis"; Pott 2018, "Cable-Driven Parallel Robots", chapter 3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, RigError, ShapeError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import GRAVITY_M_S2
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, pad_last_axis, require_finite
from tensionlab.support.files.reading import brief


class StiffnessTerms(NamedTuple):
    """Stiffness matrix at poses as a function of the tensions t: ``constant + sum of t_i slopes_i``."""

    constant: Floats  # (..., n, n)
    slopes: Floats  # (..., m, n, n)


def stiffness_terms(
    rig: Rig, position: ArrayLike, rotation: ArrayLike | None = None, frames: Frames | None = None
) -> StiffnessTerms:
    """Return the stiffness matrix as a function of the tensions; see `stiffness_matrix`."""
    cables, d = rig.cables(position, rotation, frames), rig.dimension
    elasticity = np.array([module.cable_stiffness or np.nan for module in rig.modules])
    if (unknown := np.isnan(elasticity)).any():
        name = rig.modules[int(unknown.argmax())].name
        advice = "give the cable's stiffness per strain (modulus times area) in N, or one for all in [limits]"
        raise RigError(f'rig "{rig.name}": module "{name}": key "cable_stiffness" is missing; {advice}')
    shape = (*cables.lengths.shape, d, d)
    axes = np.broadcast_to(np.eye(d), shape)
    arms = None if cables.arms is None else np.broadcast_to(cables.arms[..., None, :], shape)
    levers = kinematics.structure_matrix(axes, arms)  # A', (..., m, n, d)
    columns = np.einsum("...nd,...d->...n", levers, cables.directions)
    along = columns[..., :, None] * columns[..., None, :] / cables.lengths[..., None, None]
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    vectors = kinematics.to_anchors(anchors, pose.points(position, d, "position"), cables.arms)
    basis = np.eye(d).reshape(d, *[1] * (vectors.ndim - 1), d)
    turning = kinematics.direction_gradient(basis, vectors, rig.pulleys_in_world(frames))
    turning = np.moveaxis(turning, 0, -1)  # D, (..., m, d, d)
    slopes = along + levers @ turning @ np.swapaxes(levers, -1, -2)
    constant = (elasticity[:, None, None] * along).sum(axis=-3)
    if cables.arms is not None:
        slopes[..., d:, d:] += _turning_arm(cables.arms, cables.directions)
        platform = rig.platform
        if rig.required.gravity and platform is not None and platform.com is not None:
            turn = rig.home_matrix if rotation is None else pose.rotations(rotation, d, "rotation")
            weight = -platform.mass * GRAVITY_M_S2 * rig.upward
            constant[..., d:, d:] += _turning_arm(turn @ platform.com, weight)
    fixed = 0 if rig.has_position else d
    return StiffnessTerms(constant[..., fixed:, fixed:], slopes[..., fixed:, fixed:])


def stiffness_matrix(
    rig: Rig,
    tensions: ArrayLike,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
) -> Floats:
    """Return the stiffness matrix of a rig whose winches hold their cables.

    It is minus the derivative of the wrench on the platform with respect to its twist. The wrench is that of the
    cables and, with ``gravity = true`` in `Rig.required`, of the weight at its centre of mass. The matrix is
    symmetric where these balance each other, or a further force at the reference point; with an unbalanced torque
    its antisymmetric part is half the torque's cross-product matrix.

    Parameters
    ----------
    rig : Rig
        Each module needs `Module.cable_stiffness`. Only the cable between anchor and platform stretches.
    tensions : (..., m) array
        Tensions of the cables in N, 0 or more. A cable counts even at tension 0.
    position, rotation, frames
        Pose, as in `Rig.structure_matrix`. All leading axes broadcast.

    Returns
    -------
    (..., n, n) array
        In N/m; with rotations N/rad or N, and N·m/rad.

    Raises
    ------
    RigError
        If the stiffness of a cable is missing; and as in `Rig.structure_matrix`.
    ShapeError, InputError
        If the tensions do not suit the rig, or a cable pushes.

    Examples
    --------
    >>> import dataclasses
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> cords = [dataclasses.replace(module, cable_stiffness=5000.0) for module in rig.modules]  # EA in N
    >>> rig = dataclasses.replace(rig, modules=tuple(cords))
    >>> tensions = rig.allocate([0.0, 0.0, 0.0], rig.home).tensions
    >>> tl.stiffness_matrix(rig, tensions, rig.home).round(0)
    array([[9079.,    0.,    0.],
           [   0., 7404.,    0.],
           [   0.,    0., 9079.]])
    """
    terms = stiffness_terms(rig, position, rotation, frames)
    pulls = pose.points(tensions, rig.m, "tensions")
    if (pushing := pulls < 0.0).any():
        raise InputError(f"tensions{pose.first(pushing)} is below zero; a cable cannot push")
    return np.asarray(terms.constant + np.einsum("...m,...mij->...ij", pulls, terms.slopes))


def stiffness_eigenvalues(rig: Rig, stiffness: ArrayLike) -> Floats:
    """Return the stiffnesses along the principal axes, (..., n), ascending, in N/m.

    The eigenvalues of the symmetric part of stiffness matrices (..., n, n), with rotations times
    `Rig.characteristic_length` as displacements. A negative value means that the pose is unstable. ShapeError if
    the matrices do not suit the rig.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("kntu-planar")  # its characteristic length is 0.15 m
    >>> tl.stiffness_eigenvalues(rig, [[900.0, 0.0, 0.0], [0.0, 400.0, 0.0], [0.0, 0.0, 2.0]]).round(0)
    array([ 89., 400., 900.])
    """
    scale = 1.0 / _lengths(rig)
    return np.asarray(np.linalg.eigvalsh(_symmetric(rig, stiffness) * np.outer(scale, scale)), dtype=np.float64)


def natural_frequencies(rig: Rig, stiffness: ArrayLike, rotation: ArrayLike | None = None) -> Floats:
    """Return the natural frequencies of the platform on its cables, (..., n), ascending, in Hz.

    They are those of small undamped motions of a platform with its mass, centre of mass and inertia on massless
    cables, by the symmetric part of the stiffness. 0 where the pose is unstable.

    Parameters
    ----------
    rig : Rig
    stiffness : (..., n, n) array
        As of `stiffness_matrix`.
    rotation : array, optional
        As in `Rig.structure_matrix`: centre of mass and inertia turn with the platform.

    Raises
    ------
    RigError
        If the rig has no ``[platform]``, or one that turns has no inertia.
    ShapeError
        If the matrices do not suit the rig.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("kntu-planar")  # a platform of 5 kg
    >>> tl.natural_frequencies(rig, np.diag([2000.0, 8000.0, 50.0])).round(2)
    array([3.18, 3.56, 6.37])
    """
    matrix = _symmetric(rig, stiffness)
    root = np.linalg.inv(np.linalg.cholesky(_mass_matrix(rig, rotation)))
    squares = np.linalg.eigvalsh(root @ matrix @ np.swapaxes(root, -1, -2))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi))


def displacement(rig: Rig, direction: str | ArrayLike) -> Floats:
    """Return the twist (n,) of a unit displacement: "up", along an axis "x", "y" or "z", or along a vector.

    A vector has d numbers, or n with the rotation, which counts with `Rig.characteristic_length`.
    """
    moves = rig.dimension if rig.has_position else 0
    axes = dict(zip("xyz", np.eye(moves), strict=False))
    if isinstance(direction, str):
        if not moves or (direction != "up" and direction not in axes):
            known = f"one of {', '.join(('up', *axes))}, or {moves} numbers" if moves else "the axis of a rotation"
            raise InputError(f"direction is {brief(direction)}; give {known}")
        direction = rig.upward if direction == "up" else axes[direction]
    twist = require_finite("direction", direction, 1)
    if twist.shape not in ((moves,), (rig.n,)) or not twist.any():
        count = f"{rig.n} numbers"
        if moves and rig.n > moves:
            count = f"{moves} numbers, or {rig.n} with the rotation"
        raise InputError(f"direction is {brief(twist.tolist())}; give {count}, not all zero")
    twist = pad_last_axis(twist, rig.n)
    return np.asarray(twist / np.linalg.norm(_lengths(rig) * twist))


def _lengths(rig: Rig) -> Floats:
    """Return the displacements (n,) that count as much as a unit of each component of a twist, in m."""
    rotation = np.arange(rig.n) >= (rig.dimension if rig.has_position else 0)
    return np.where(rotation, rig.characteristic_length, 1.0)


def _symmetric(rig: Rig, stiffness: ArrayLike) -> Floats:
    """Return the symmetric part of stiffness matrices."""
    matrix = require_finite("stiffness", stiffness, 2)
    if matrix.shape[-2:] != (rig.n, rig.n):
        raise ShapeError(f"stiffness has shape {matrix.shape}; {rig.name} needs (..., {rig.n}, {rig.n})")
    return (matrix + np.swapaxes(matrix, -1, -2)) / 2.0


def _mass_matrix(rig: Rig, rotation: ArrayLike | None) -> Floats:
    """Return the mass matrix of the platform at its reference point in world axes, (..., n, n)."""
    platform, d = rig.platform, rig.dimension
    if platform is None:
        raise RigError(f'rig "{rig.name}": [platform] is missing; give its mass')
    if rig.home_orientation is None:
        return platform.mass * np.eye(d)
    if platform.inertia is None:
        raise RigError(f'rig "{rig.name}": [platform]: key "inertia" is missing; give it in kg·m²')
    turn = rig.home_matrix if rotation is None else pose.rotations(rotation, d, "rotation")
    arm = turn @ (np.zeros(d) if platform.com is None else platform.com)
    arms = np.broadcast_to(arm[..., None, :], turn.shape)
    lever = kinematics.structure_matrix(np.broadcast_to(np.eye(d), turn.shape), arms)  # A' of the centre of mass
    mass = platform.mass * lever @ np.swapaxes(lever, -1, -2)
    own = platform.inertia if d == 2 else turn @ platform.inertia @ np.swapaxes(turn, -1, -2)
    mass[..., d:, d:] += own
    fixed = 0 if rig.has_position else d
    return np.asarray(mass[..., fixed:, fixed:])


def _turning_arm(arms: Floats, forces: Floats) -> Floats:
    """Return the stiffness against rotation of forces on arms, both (..., d), that turn: (..., k, k)."""
    along: Floats = np.einsum("...i,...i->...", arms, forces)[..., None, None]
    return along if arms.shape[-1] == 2 else along * np.eye(3) - arms[..., :, None] * forces[..., None, :]
