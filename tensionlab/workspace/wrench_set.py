"""Available wrench set, a zonotope: its half-spaces and vertices, the capacity margin and its derivatives."""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE
from tensionlab.errors import ShapeError
from tensionlab.model import kinematics, pose
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import (
    Floats,
    Integers,
    Limits,
    broadcast_last_axis,
    check_size,
    common_axes,
    flatten_batch,
    require_finite,
    tension_limits,
)

ALONG_FACET = 1e-12  # share of a unit vector along a facet's normal below which it is parallel to the facet
EQUAL_MARGINS = 1e-9  # relative difference below which margins are equal but for rounding

TensionRange = Limits | tuple[ArrayLike, ArrayLike]  # lower and upper limits in N, each (..., m) or a number
RequiredWrenches = ArrayLike | tuple[ArrayLike, ArrayLike] | None  # as in `capacity_margin`


class StructureBatch(NamedTuple):
    """B structure matrices and their tension limits."""

    structure: Floats  # (B, n, m)
    lower: Floats  # (B, m)
    upper: Floats
    shape: tuple[int, ...]  # leading axes of their results


def structure_matrices(structure: ArrayLike) -> Floats:
    """Return structure matrices (..., n, m) as floats; refuse NaN, infinity and unsupported sizes."""
    matrices = require_finite("structure", structure, 2)
    check_size(*matrices.shape[-2:])
    return matrices


def structure_batch(matrices: Floats, limits: TensionRange, **axes: tuple[int, ...]) -> StructureBatch:
    """Broadcast the leading axes of matrices and limits to each other and to further named ones."""
    named = zip(("lower", "upper"), tension_limits(limits), strict=True)
    lower, upper = (broadcast_last_axis(name, limit, matrices.shape[-1], "cables") for name, limit in named)
    shapes = {"structure": matrices.shape[:-2], "lower": lower.shape[:-1], "upper": upper.shape[:-1]}
    shape = common_axes(shapes | axes)
    lower, upper = flatten_batch(lower, shape, 1), flatten_batch(upper, shape, 1)
    return StructureBatch(flatten_batch(matrices, shape, 2), lower, upper, shape)


class HalfSpaces(NamedTuple):
    """The available wrench set as an intersection: w is in it if ``normals[i] @ w <= offsets[i]`` for all i."""

    normals: Floats  # unit vectors away from the set, (..., k, n)
    offsets: Floats  # (..., k)


def half_spaces(structure: ArrayLike, limits: TensionRange) -> HalfSpaces:
    """Return the half-spaces that bound the available wrench set.

    All choices of n - 1 independent cables span two parallel facets, on which every other cable is at one of its
    limits. All poses have as many half-spaces as the one that needs most; those that need fewer repeat their last.
    Where the set is flat, planes from both sides confine it.

    Source: Bouchard, Gosselin and Moore, "On the ability of a cable-driven robot to generate a prescribed set of
    wrenches", 2010; Gouttefarde and Krut, "Characterization of parallel manipulator available wrench set facets",
    2010. Parameters and errors as in `capacity_margin`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> normals, offsets = tl.workspace.half_spaces(structure, rig.limits)
    >>> bool((normals @ [1.0, 0.5, 1.0] <= offsets).all())  # so this force is feasible
    True
    """
    batch = structure_batch(structure_matrices(structure), limits)
    n, m = batch.structure.shape[1:]
    capacity, needed = 0, 2 * max(n, comb(m, n - 1))
    while needed > capacity:  # flat sets may have more facets than others
        capacity = needed
        normals, offsets, count = _native.half_spaces(*batch[:3], capacity, RANK_TOLERANCE)
        needed = int(count.max(initial=1.0))
    normals, offsets = normals.reshape(*batch.shape, capacity, n), offsets.reshape(*batch.shape, capacity)
    return HalfSpaces(normals[..., :needed, :], offsets[..., :needed])


def facet_distance(distances: Floats, normals: Floats, directions: Floats) -> Floats:
    """Return the distance (..., K) to the first facet along directions (K, n), from a wrench inside all of them.

    ``distances`` (..., k) are those of the wrench from each half-space, along its normal (..., k, n).
    """
    along = normals @ directions.T
    ahead = along > ALONG_FACET
    return np.asarray(np.min(np.where(ahead, distances[..., None], np.inf) / np.where(ahead, along, 1.0), axis=-2))


def vertices(structure: ArrayLike, limits: TensionRange) -> Floats:
    """Return the vertices (k, n) of the available wrench set at one pose.

    For n = 2 they are in order around the polygon; otherwise in no order. They are computed cable by cable with
    Qhull: each cable copies the current hull, at its lower and its upper limit.

    Source: Barber, Dobkin and Huhdanpaa, "The Quickhull algorithm for convex hulls", 1996. Parameters and
    errors as in `capacity_margin`, without leading axes.

    Examples
    --------
    >>> import tensionlab as tl
    >>> wall = [[-0.8, 0.8, 0.0], [0.6, 0.6, -1.0]]  # three cables in the plane
    >>> tl.workspace.vertices(wall, (0.0, 5.0)).shape
    (6, 2)
    """
    batch = structure_batch(structure_matrices(structure), limits)
    if batch.shape:
        raise ShapeError(f"vertices are those of one pose; structure and limits have leading axes {batch.shape}")
    W, lower, upper = batch.structure[0], batch.lower[0], batch.upper[0]
    edges = (W * (upper - lower)).T
    basis, sigma, _ = np.linalg.svd(edges.T, full_matrices=False)
    basis = basis[:, sigma > RANK_TOLERANCE * sigma[0]]
    flat = edges @ basis  # coordinates in the range of W
    corners = np.zeros((1, basis.shape[1]))
    for edge in flat[np.any(edges != 0.0, axis=1)]:
        corners = _hull(np.concatenate([corners, corners + edge]))
    return np.asarray(W @ lower + corners @ basis.T)


def _hull(points: Floats) -> Floats:
    """Return those of the points that are vertices of their hull; all of them while they span no volume."""
    from scipy.spatial import ConvexHull

    dimension = points.shape[1]
    if dimension == 1:
        return np.array([points.min(axis=0), points.max(axis=0)])
    if np.linalg.matrix_rank(points - points[0], RANK_TOLERANCE) < dimension:
        return points
    return np.asarray(points[ConvexHull(points).vertices])


class MarginGradient(NamedTuple):
    """Capacity margin (...), and its derivative (..., n, m) with respect to the structure matrix."""

    margin: Floats
    structure: Floats


class RigMarginGradient(NamedTuple):
    """Capacity margin (...), and its derivatives in N/m."""

    margin: Floats
    position: Floats  # by the reference point, without rotation, (..., d)
    anchors: Floats  # in the axes of their frames, (..., m, d)
    attachments: Floats | None  # in the axes of the platform, (..., m, d); None for a point


def capacity_margin(structure: ArrayLike, limits: TensionRange, required: RequiredWrenches = None) -> Floats:
    """Return the signed distance (...) of the required wrench set from the boundary of the available one.

    0 or more if and only if all of it is feasible. The available wrench set is all ``W t`` with t inside the
    limits; where W has a lower rank, the margin is at most 0, less the distance of the required set from its
    plane. Where n is more than 3, distances mix N and N·m: divide the torques of W and of the required wrenches by
    a length first, such as `Rig.characteristic_length`. ShapeError names an entry that does not fit.

    Source: Guay, Cardou, Cruz-Ruiz and Caro, "Measuring how well a structure supports varying external wrenches",
    2014. The facets are found by hyperplane shifting: Bouchard, Gosselin and Moore, "On the ability of a
    cable-driven robot to generate a prescribed set of wrenches", 2010.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    required : None, (n,) array, (..., k, n) array, or tuple
        None is zero. An array with one axis is one wrench, with more the vertices of a set, k for each pose or for
        all. A tuple is a ball, ``(centre, radius)``: (..., n) and (...).

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> f"{tl.workspace.capacity_margin(structure, rig.limits):.3f} N in every direction"
    '3.681 N in every direction'
    >>> f"{tl.workspace.capacity_margin(structure, rig.limits, [0.0, 3.0, 0.0]):.3f} N around a pull of 3 N"
    '1.601 N around a pull of 3 N'
    """
    batch, wrenches, radius = _arguments(structure, limits, required)
    margin = _native.capacity_margin(*batch[:3], wrenches, RANK_TOLERANCE)
    return np.asarray(margin.reshape(batch.shape) - radius)[()]


def loss_margins(structure: ArrayLike, limits: TensionRange, required: RequiredWrenches = None) -> Floats:
    """Return the capacity margin (..., m) after the loss of each cable.

    A lost cable has tension zero, not its minimum; the others keep their limits, and what is required stays. The
    smallest of the margins survives the loss of any one cable. It may exceed the margin of all cables where the
    minimum tension of a cable hinders, as at the border of the workspace of a suspended robot.

    Parameters and errors as in `capacity_margin`; ShapeError also for one cable alone.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("seven-modules")
    >>> margins = tl.workspace.loss_margins(rig.structure_matrix(rig.home), rig.limits)
    >>> f"{margins.min():.3f} N after the loss of {rig.modules[margins.argmin()].name}"
    '1.029 N after the loss of back-floor'
    """
    batch, wrenches, radius = _arguments(structure, limits, required)
    m = batch.structure.shape[-1]
    if m == 1:
        raise ShapeError("structure has one cable, and nothing is left after its loss; give two or more")
    margins = []
    for lost in range(m):
        W, lower, upper = (np.delete(array, lost, axis=-1) for array in batch[:3])
        margins.append(_native.capacity_margin(W, lower, upper, wrenches, RANK_TOLERANCE))
    return np.asarray(np.stack(margins, axis=-1).reshape(*batch.shape, m) - radius[..., None])


def worst_loss(margins: Floats) -> Integers:
    """Return the cable (...) whose loss leaves the smallest of margins (..., m); the first of equal ones."""
    rounding = EQUAL_MARGINS * np.abs(margins).max(axis=-1, keepdims=True)
    return np.asarray(np.argmax(margins <= margins.min(axis=-1, keepdims=True) + rounding, axis=-1))


def required_margin(
    rig: Rig,
    structure: Floats,
    required: Requirement,
    rotation: ArrayLike | None = None,
    added: Floats | None = None,
    margin: Callable[[Floats, Limits, Floats], Floats] = capacity_margin,
) -> Floats:
    """Return the capacity margin (...) of a rig about its required wrenches, in N.

    Torques are divided by the characteristic length of the requirement. ``structure`` (..., n, m) are the matrices
    of its poses, ``rotation`` is as in `Rig.structure_matrix`, and ``added`` (..., n) is required in addition.
    With `loss_margins` as the ``margin`` it is that after the loss of each cable, (..., m).
    """
    corners = required.at(rig, rotation) + (0.0 if added is None else added[..., None, :])
    divisors = required.divisors(rig)
    return margin(structure / divisors[:, None], rig.limits, corners / divisors) - required.ball


def margin_gradient(
    structure: ArrayLike, limits: TensionRange, required: RequiredWrenches = None
) -> MarginGradient:
    """Return the capacity margin and its derivative with respect to the structure matrix.

    The derivative is ``h t'``: h is the unit normal of the nearest facet, and t are the tensions whose wrench is,
    of all in the plane of the facet, the nearest to the required one. Where several facets or wrenches are equally
    near, it is that of one of them; where a flat set holds what is required it is zero. Parameters and errors as
    in `capacity_margin`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> found = tl.workspace.margin_gradient(rig.structure_matrix(rig.home), rig.limits)
    >>> f"{found.margin:.3f} N", found.structure.shape
    ('3.681 N', (3, 4))
    """
    batch, wrenches, radius = _arguments(structure, limits, required)
    margin, normal, _, tensions = _native.active_facet(*batch[:3], wrenches, RANK_TOLERANCE)
    by_structure = normal[:, :, None] * tensions[:, None, :]
    return MarginGradient(
        np.asarray(margin.reshape(batch.shape) - radius)[()],
        by_structure.reshape(*batch.shape, *batch.structure.shape[1:]),
    )


def rig_margin_gradient(
    rig: Rig,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
    required: RequiredWrenches = None,
) -> RigMarginGradient:
    """Return the capacity margin of a rig and its derivatives with respect to position, anchors and attachments.

    Poses as in `Rig.structure_matrix`, required wrenches (world axes) as in `capacity_margin`, errors as in both.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> higher = tl.workspace.rig_margin_gradient(rig, rig.home).position[1]
    >>> f"{higher:.2f} N/m, if the hand is raised"
    '-7.63 N/m, if the hand is raised'
    """
    rig.require_position("gradients of margins")
    cables = rig.cables(position, rotation, frames)
    W = kinematics.structure_matrix(cables.directions, cables.arms)
    margin, by_structure = margin_gradient(W, rig.limits, required)
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    vectors = kinematics.to_anchors(anchors, np.asarray(position, dtype=np.float64), cables.arms)
    by_anchor = kinematics.anchor_gradient(by_structure, vectors, cables.arms, rig.pulleys_in_world(frames))
    own = pose.to_module_frames(rig.modules, by_anchor, frames)
    by_attachment = None
    if cables.arms is not None:
        by_arm = kinematics.attachment_gradient(by_structure, cables.directions, by_anchor)
        turn = rig.home_matrix if rotation is None else pose.rotations(rotation, rig.dimension, "rotation")
        by_attachment = by_arm @ turn
    return RigMarginGradient(margin, -by_anchor.sum(axis=-2), own, by_attachment)


def _arguments(
    structure: ArrayLike, limits: TensionRange, required: RequiredWrenches
) -> tuple[StructureBatch, Floats, Floats]:
    """Return the batch, its required wrenches (B, k, n), and the radius (...) around them."""
    matrices = structure_matrices(structure)
    n, radius = matrices.shape[-2], np.zeros(())
    if required is None:
        wrenches = np.zeros((1, n))
    elif not isinstance(required, tuple):
        wrenches = require_finite("required", required, 1)
        wrenches = wrenches[None] if wrenches.ndim == 1 else wrenches
    elif len(required) == 2:
        wrenches = require_finite("required centre", required[0], 1)[..., None, :]
        radius = require_finite("required radius", required[1], 0)
    else:
        raise ShapeError(f"required is a tuple of {len(required)}; give (centre, radius), or vertices as an array")
    if (radius < 0).any():
        raise ShapeError(f"required radius is {radius.min():g}; give 0 or more")
    if wrenches.shape[-1] != n:
        raise ShapeError(f"required wrenches have {wrenches.shape[-1]} components where structure has {n} rows")
    if wrenches.shape[-2] == 0:
        raise ShapeError("required has no wrench; give at least one, or None")
    batch = structure_batch(matrices, limits, required=wrenches.shape[:-2], radius=radius.shape)
    return batch, flatten_batch(wrenches, batch.shape, 2), radius
