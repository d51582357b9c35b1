"""Available wrench set, a zonotope: its half-spaces and vertices; batches of structure matrices and limits."""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE
from tensionlab.errors import ShapeError
from tensionlab.support.arrays import (
    Floats,
    Limits,
    broadcast_last_axis,
    check_size,
    common_axes,
    flatten_batch,
    require_finite,
    tension_limits,
)

TensionRange = Limits | tuple[ArrayLike, ArrayLike]  # lower and upper limits in N, each (..., m) or a number


class StructureBatch(NamedTuple):
    """B structure matrices (B, n, m), their tension limits (B, m), and the leading axes of their results."""

    structure: Floats
    lower: Floats
    upper: Floats
    shape: tuple[int, ...]


def structure_matrices(structure: ArrayLike) -> Floats:
    """Return structure matrices (..., n, m) as floats; refuse NaN, infinity and sizes the kernels do not serve."""
    matrices = require_finite("structure", structure, 2)
    check_size(*matrices.shape[-2:])
    return matrices


def structure_batch(matrices: Floats, limits: TensionRange, **axes: tuple[int, ...]) -> StructureBatch:
    """Broadcast the leading axes of matrices and limits to each other and to further named ones."""
    m = matrices.shape[-1]
    low, high = tension_limits(limits)
    lower, upper = broadcast_last_axis("lower", low, m, "cables"), broadcast_last_axis("upper", high, m, "cables")
    shape = common_axes(
        {"structure": matrices.shape[:-2], "lower": lower.shape[:-1], "upper": upper.shape[:-1], **axes}
    )
    return StructureBatch(
        flatten_batch(matrices, shape, 2), flatten_batch(lower, shape, 1), flatten_batch(upper, shape, 1), shape
    )


class HalfSpaces(NamedTuple):
    """The available wrench set as an intersection: w is in it if ``normals[i] @ w <= offsets[i]`` for all i.

    Normals (..., k, n) are unit vectors away from the set; offsets are (..., k).
    """

    normals: Floats
    offsets: Floats


def half_spaces(structure: ArrayLike, limits: TensionRange) -> HalfSpaces:
    """Return the half-spaces that bound the available wrench set.

    All choices of n - 1 independent cables span two parallel facets, on which every other cable is at one of its
    limits. Some half-spaces may be redundant: all poses have as many as the one that needs most, twice the choices
    of n - 1 of m cables as a rule, and those that need fewer repeat their last. Where the set is flat, planes from
    both sides confine it.

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
    capacity = 2 * max(n, comb(m, n - 1))
    while True:
        normals, offsets, count = _native.half_spaces(*batch[:3], capacity, RANK_TOLERANCE)
        needed = int(count.max(initial=1.0))
        if needed <= capacity:
            break
        capacity = needed  # flat sets may have more facets than others
    shape = batch.shape
    return HalfSpaces(
        normals.reshape(*shape, capacity, n)[..., :needed, :], offsets.reshape(*shape, capacity)[..., :needed]
    )


def vertices(structure: ArrayLike, limits: TensionRange) -> Floats:
    """Return the vertices (k, n) of the available wrench set at one pose.

    In order around the set where it is a polygon, n = 2; in no order elsewhere. They are the hull of one cable
    after the other, by Qhull: each copies what is there, at its lower and its upper limit.

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
