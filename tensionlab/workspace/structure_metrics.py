"""Metrics of structure matrices and tension limits: closure, tension factor, forces in all directions."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE, TOLERANCE, Allocator, Status
from tensionlab.errors import InputError, ShapeError
from tensionlab.model import pose
from tensionlab.support.arrays import Floats, flatten_batch, require_finite
from tensionlab.workspace.wrench_set import StructureBatch, TensionRange, structure_batch, structure_matrices

CLOSURE_TOLERANCE = 1e-10  # a tension factor up to this is on the edge of the wrench-closure workspace, not in it
ALLOCATIONS_PER_CALL = 1 << 16  # enough for all threads, and a few megabytes


def tension_factor(structure: ArrayLike) -> Floats:
    """Return the maximum ratio (...) of minimum to maximum tension with ``W t = 0``, from 0 to 1.

    0 where there is no wrench closure, as where W has a rank below n.

    ``structure`` are structure matrices (..., n, m); ShapeError names an entry that is not finite.

    Source: Pham, Yeo, Yang and Chen, "Workspace analysis of fully restrained cable-driven manipulators", 2009;
    but by the facets of the wrench set, in place of their linear program.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> f"{tl.workspace.tension_factor(rig.structure_matrix(rig.home)):.3f}"
    '0.723'
    """
    batch = structure_batch(structure_matrices(structure), (0.0, 2.0))
    return _native.tension_factor(*batch[:3], RANK_TOLERANCE).reshape(batch.shape)[()]


def wrench_closure(structure: ArrayLike) -> NDArray[np.bool_]:
    """Return whether cables of unlimited strength can render every wrench (...).

    True where W has rank n and ``W t = 0`` for some t > 0. Parameter and errors as in `tension_factor`.
    Source: Verhoeven, "Analysis of the workspace of tendon-based Stewart platforms", 2004.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.wrench_closure([[[1.0, -1.0]], [[1.0, 1.0]]])
    array([ True, False])
    """
    return tension_factor(structure) > CLOSURE_TOLERANCE


def isotropic_force(
    structure: ArrayLike,
    limits: TensionRange,
    dimension: int | None = None,
    offset_wrench: ArrayLike | None = None,
) -> Floats:
    """Return the maximum force (...), in N, that is feasible in every direction, without a torque.

    The radius of the largest ball of forces, about zero or a wrench, in the available wrench set; 0 where some
    directions, or the middle, are infeasible.

    Parameters
    ----------
    structure, limits
        Parameters and errors as in `capacity_margin`.
    dimension : int or None
        Number of the n components that are forces, the others being torques; None is 3, or n where that is less.
    offset_wrench : (..., n) array or None
        Wrench that is rendered at the same time, such as that which holds a weight; None is zero.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> f"{tl.workspace.isotropic_force(rig.structure_matrix(rig.home), rig.limits):.3f} N"
    '3.681 N'
    """
    matrices = structure_matrices(structure)
    n = matrices.shape[-2]
    middle = _offset(offset_wrench, n)
    W, lower, upper, shape = structure_batch(matrices, limits, offset_wrench=middle.shape[:-1])
    forces = min(n, 3) if dimension is None else dimension
    if not 1 <= forces <= n:
        raise InputError(f"dimension is {dimension}; of {n} wrench components, 1 to {n} can be forces")
    if not middle.any():
        return _native.isotropic_force(W, lower, upper, forces, RANK_TOLERANCE).reshape(shape)[()]
    # Tensions that render the wrench, whatever their limits, shift the limits for the ball.
    wrenches = flatten_batch(middle, shape, 1)
    tensions = (np.linalg.pinv(W, RANK_TOLERANCE) @ wrenches[..., None])[..., 0]
    radii = _native.isotropic_force(W, lower - tensions, upper - tensions, forces, RANK_TOLERANCE)
    missing = np.linalg.norm(wrenches - np.einsum("bnm,bm->bn", W, tensions), axis=1)
    return np.where(missing <= feasibility_tolerance(wrenches), radii, 0.0).reshape(shape)[()]


def feasible_direction_fraction(
    structure: ArrayLike,
    limits: TensionRange,
    directions: ArrayLike,
    magnitude: float,
    offset_wrench: ArrayLike | None = None,
) -> Floats:
    """Return the feasible-direction fraction (...): the share of directions in which a wrench is feasible.

    A wrench outside the available set by no more than the tolerance of an exact allocation counts as feasible.

    Parameters
    ----------
    structure, limits, offset_wrench
        Parameters and errors as in `isotropic_force`.
    directions : (..., k, d) array
        Vectors of any length but zero, k for each pose or for all; components beyond d are zero.
    magnitude : float
        Norm of the wrench.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> directions = tl.datasets.load("vectors/grid18")  # (182, 3)
    >>> f"{tl.workspace.feasible_direction_fraction(structure, rig.limits, directions, magnitude=5.0):.3f}"
    '0.363'
    """
    batch, wrenches = _direction_batch(structure, limits, directions, magnitude, offset_wrench)
    tolerance = feasibility_tolerance(wrenches)
    share = _native.feasible_direction_fraction(*batch[:3], wrenches, tolerance, RANK_TOLERANCE)
    return share.reshape(batch.shape)[()]


class SquaredTension(NamedTuple):
    """Sums of squared tensions, (...), in N²: mean and maximum over directions."""

    mean: Floats
    worst: Floats


def squared_tension(
    structure: ArrayLike,
    limits: TensionRange,
    directions: ArrayLike,
    magnitude: float,
    offset_wrench: ArrayLike | None = None,
) -> SquaredTension:
    """Return the mean and the maximum over directions of the least sum of squared tensions, the motors' heat.

    NaN where a wrench is infeasible. Parameters and errors as in `feasible_direction_fraction`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> mean, worst = tl.workspace.squared_tension(structure, rig.limits, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], 1.5)
    >>> f"{mean:.2f} N², {worst:.2f} N²"
    '11.19 N², 14.91 N²'
    """
    (W, lower, upper, shape), desired = _direction_batch(structure, limits, directions, magnitude, offset_wrench)
    sums = np.empty(desired.shape[:2])
    step = max(1, ALLOCATIONS_PER_CALL // desired.shape[1])
    for part in (slice(start, start + step) for start in range(0, len(desired), step)):
        allocation = Allocator((lower[part, None], upper[part, None]))(W[part, None], desired[part])
        squares = np.einsum("bkm,bkm->bk", allocation.tensions, allocation.tensions)
        sums[part] = np.where(allocation.status == Status.EXACT, squares, np.nan)
    return SquaredTension(sums.mean(axis=1).reshape(shape)[()], sums.max(axis=1).reshape(shape)[()])


def feasibility_tolerance(wrenches: Floats) -> float:
    """Return the tolerance of an exact allocation, in N: a share of the largest of the wrenches (..., n)."""
    return TOLERANCE * max(1.0, math.sqrt(np.einsum("...n,...n", wrenches, wrenches).max(initial=0.0)))


def _offset(wrench: ArrayLike | None, n: int) -> Floats:
    """Return a wrench that is rendered at the same time, (..., n)."""
    offset = np.zeros(n) if wrench is None else require_finite("offset_wrench", wrench, 1)
    if offset.shape[-1] != n:
        raise ShapeError(f"offset_wrench has {offset.shape[-1]} components where structure has {n} rows")
    return offset


def _direction_batch(
    structure: ArrayLike,
    limits: TensionRange,
    directions: ArrayLike,
    magnitude: float,
    offset_wrench: ArrayLike | None,
) -> tuple[StructureBatch, Floats]:
    """Return the batch, and its wrenches (B, k, n) of one magnitude on top of another wrench."""
    matrices = structure_matrices(structure)
    n = matrices.shape[-2]
    if not (math.isfinite(magnitude) and magnitude >= 0):
        raise InputError(f"magnitude is {magnitude}; give a finite number, 0 or more")
    vectors = require_finite("directions", directions, 2)
    *leading, count, d = vectors.shape
    if not (count and 1 <= d <= n):
        raise ShapeError(f"directions have shape {vectors.shape}; give (k, d), with d from 1 to {n}")
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not lengths.all():
        raise ShapeError(f"directions{pose.first(lengths[..., 0] == 0)} is zero; give vectors with a direction")
    offset = _offset(offset_wrench, n)[..., None, :]
    wrenches = np.zeros(np.broadcast_shapes((*leading, count, n), offset.shape))
    wrenches[..., :d] = magnitude * vectors / lengths
    wrenches += offset
    batch = structure_batch(matrices, limits, directions=wrenches.shape[:-2])
    return batch, flatten_batch(wrenches, batch.shape, 2)
