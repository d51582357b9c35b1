"""The available wrench set itself: all wrenches that tensions inside their limits render, a zonotope."""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE
from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError
from tensionlab.workspace.poses import TensionRange, poses, structure_matrices


class HalfSpaces(NamedTuple):
    """The available wrench set as an intersection: w is in it if ``normals[i] @ w <= offsets[i]`` for all i.

    Attributes
    ----------
    normals : (..., k, n) array
        Unit vectors away from the set.
    offsets : (..., k) array
    """

    normals: Floats
    offsets: Floats


def half_spaces(structure: ArrayLike, limits: TensionRange) -> HalfSpaces:
    """Between which planes do the wrenches lie that tensions inside their limits render?

    All choices of n - 1 independent cables span two parallel facets, on which every other cable is at one of its
    limits.

    Source: Bouchard, Gosselin and Moore, "On the ability of a cable-driven robot to generate a prescribed set of
    wrenches", 2010; Gouttefarde and Krut, "Characterization of parallel manipulator available wrench set facets",
    2010.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.

    Returns
    -------
    HalfSpaces
        Some may be redundant: all poses have as many as the one that needs most, twice the choices of n - 1 of m
        cables as a rule, and those that need fewer repeat their last. Where the set is flat, planes from both
        sides confine it.

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    given = poses(structure_matrices(structure), limits)
    n, m = given.structure.shape[1:]
    capacity = 2 * max(n, comb(m, n - 1))
    while True:
        normals, offsets, count = _native.half_spaces(*given[:3], capacity, RANK_TOLERANCE)
        needed = int(count.max(initial=1.0))
        if needed <= capacity:
            break
        capacity = needed  # flat sets may have more facets than others
    shape = given.shape
    return HalfSpaces(
        normals.reshape(*shape, capacity, n)[..., :needed, :], offsets.reshape(*shape, capacity)[..., :needed]
    )


def vertices(structure: ArrayLike, limits: TensionRange) -> Floats:
    """Which wrenches are the corners of what tensions inside their limits render?

    The hull of one cable after the other, by Qhull: each copies what is there, at its least and at its largest
    tension.

    Source: Barber, Dobkin and Huhdanpaa, "The Quickhull algorithm for convex hulls", 1996.

    Parameters
    ----------
    structure : (n, m) array
        One structure matrix.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (m,) or a number.

    Returns
    -------
    (k, n) array
        In order around the set where it is a polygon, n = 2; in no order elsewhere.

    Raises
    ------
    ShapeError
        Naming the entry, or if there are several poses.
    """
    given = poses(structure_matrices(structure), limits)
    if given.shape:
        raise ShapeError(f"vertices are those of one pose; structure and limits have leading axes {given.shape}")
    W, lower, upper = given.structure[0], given.lower[0], given.upper[0]
    edges = (W * (upper - lower)).T
    basis, sigma, _ = np.linalg.svd(edges.T, full_matrices=False)
    basis = basis[:, sigma > RANK_TOLERANCE * sigma[0]]
    flat = edges @ basis  # coordinates in the range of W
    corners = np.zeros((1, basis.shape[1]))
    for edge in flat[np.any(edges != 0.0, axis=1)]:
        corners = _hull(np.concatenate([corners, corners + edge]))
    return np.asarray(W @ lower + corners @ basis.T)


def _hull(points: Floats) -> Floats:
    """Those of the points that are vertices of their hull; all of them while they span no volume."""
    from scipy.spatial import ConvexHull

    dimension = points.shape[1]
    if dimension == 1:
        return np.array([points.min(axis=0), points.max(axis=0)])
    if np.linalg.matrix_rank(points - points[0], RANK_TOLERANCE) < dimension:
        return points
    return np.asarray(points[ConvexHull(points).vertices])
