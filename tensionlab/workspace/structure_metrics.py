"""Metrics of structure matrices: closure, tension factor, isotropic force, singular values, sets of directions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE, TOLERANCE, Allocator, Status
from tensionlab.errors import InputError, ShapeError
from tensionlab.support.arrays import Floats, flatten_batch, require_finite
from tensionlab.workspace.wrench_set import TensionRange, structure_batch, structure_matrices

# A pose with a tension factor of no more than this is on the edge of the wrench-closure workspace, not in it.
CLOSURE_TOLERANCE = 1e-10
ALLOCATIONS_PER_CALL = 1 << 16  # enough for all threads, and a few megabytes


def tension_factor(structure: ArrayLike) -> Floats:
    """Return the maximum ratio (...) of minimum to maximum tension with ``W t = 0``.

    From 0 to 1, for structure matrices (..., n, m); 0 where there is no wrench closure, so also where W has a rank
    below n. ShapeError names an entry that is not finite.

    Source: Pham, Yeo, Yang and Chen, "Workspace analysis of fully restrained cable-driven manipulators", 2009.
    Instead of their linear program, the facets of the wrench set for tensions between 1 and tau: it holds zero
    for all tau from 1/factor on.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> f"{tl.workspace.tension_factor(structure):.3f}"
    '0.723'
    """
    batch = structure_batch(structure_matrices(structure), (0.0, 2.0))
    return _native.tension_factor(*batch[:3], RANK_TOLERANCE).reshape(batch.shape)[()]


def wrench_closure(structure: ArrayLike) -> NDArray[np.bool_]:
    """Return whether the cables can render every wrench, if they only pull hard enough.

    True, (...), where W has rank n and ``W t = 0`` for some t > 0: where the tension factor exceeds
    `CLOSURE_TOLERANCE`. Parameter and errors as in `tension_factor`.

    Source: Verhoeven, "Analysis of the workspace of tendon-based Stewart platforms", 2004.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

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

    The radius of the largest ball of forces, about zero or a wrench, in the available wrench set; each facet
    bounds it by the part of its normal that is a force. 0 where some directions, or the middle, are infeasible.

    Parameters
    ----------
    structure, limits
        As in `capacity_margin`.
    dimension : int or None
        How many of the n components are forces; the others are torques, and stay zero. None: the first three, or
        all where n is less. A planar platform, which has n = 3, needs 2: give ``rig.dimension``.
    offset_wrench : (..., n) array or None
        Wrench that is rendered at the same time, such as that which holds a weight; None is zero.

    Raises
    ------
    ShapeError, InputError
        Naming the entry; if that number of components cannot be forces.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> f"{tl.workspace.isotropic_force(structure, rig.limits):.3f} N"
    '3.681 N'
    """
    matrices = structure_matrices(structure)
    n = matrices.shape[-2]
    middle = _offset(offset_wrench, n)
    batch = structure_batch(matrices, limits, offset_wrench=middle.shape[:-1])
    forces = min(n, 3) if dimension is None else dimension
    if not 1 <= forces <= n:
        raise InputError(f"dimension is {dimension}; of {n} wrench components, 1 to {n} can be forces")
    if not middle.any():
        return _native.isotropic_force(*batch[:3], forces, RANK_TOLERANCE).reshape(batch.shape)[()]
    # Tensions that render the wrench, whatever their limits, shift the limits for the ball.
    W, wrenches = batch.structure, flatten_batch(middle, batch.shape, 1)
    tensions = (np.linalg.pinv(W, RANK_TOLERANCE) @ wrenches[..., None])[..., 0]
    found = _native.isotropic_force(W, batch.lower - tensions, batch.upper - tensions, forces, RANK_TOLERANCE)
    missing = np.linalg.norm(wrenches - np.einsum("bnm,bm->bn", W, tensions), axis=1)
    return np.where(missing <= feasibility_tolerance(wrenches), found, 0.0).reshape(batch.shape)[()]


def least_singular_value(structure: ArrayLike) -> Floats:
    """Return the minimum singular value (...) of structure matrices (..., n, m).

    The norm of the wrench in the weakest direction for tensions of norm 1 N; 0 with fewer cables than components.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Raises
    ------
    ShapeError
        If an entry is not finite, or shapes do not fit.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> f"{tl.workspace.least_singular_value(structure):.3f}"
    '1.087'
    """
    return _singular_values(structure)[..., -1][()]


def condition_number(structure: ArrayLike) -> Floats:
    """Return the ratio (...) of the first to the n-th singular value of structure matrices (..., n, m).

    Infinite where the rank is below n.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Raises
    ------
    ShapeError
        If an entry is not finite, or shapes do not fit.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> f"{tl.workspace.condition_number(structure):.3f}"
    '1.178'
    """
    sigma = _singular_values(structure)
    full_rank = sigma[..., -1] > RANK_TOLERANCE * sigma[..., 0]
    ratio = np.full(full_rank.shape, np.inf)
    np.divide(sigma[..., 0], sigma[..., -1], out=ratio, where=full_rank)
    return ratio[()]


def _singular_values(structure: ArrayLike) -> Floats:
    """Return all n of them, in descending order."""
    matrices = structure_matrices(structure)
    n, m = matrices.shape[-2:]
    found = np.linalg.svd(matrices, compute_uv=False)
    if m < n:
        found = np.concatenate([found, np.zeros((*found.shape[:-1], n - m))], axis=-1)
    return np.asarray(found)


def feasible_direction_fraction(
    structure: ArrayLike,
    limits: TensionRange,
    directions: ArrayLike,
    magnitude: float,
    offset_wrench: ArrayLike | None = None,
) -> Floats:
    """Return the feasible-direction fraction (...): the share of directions in which a wrench is feasible.

    By the half-spaces of the available wrench set; nothing is solved. A wrench outside by no more than the
    tolerance of an exact allocation counts as feasible.

    Parameters
    ----------
    structure, limits
        As in `capacity_margin`.
    directions : (..., k, d) array
        Vectors of any length but zero, k for each pose or for all. Where d is less than n they are forces, and all
        other components are zero: no torque.
    magnitude : float
        Of the wrench; in N, if the directions are forces.
    offset_wrench : (..., n) array or None
        As in `isotropic_force`.

    Raises
    ------
    ShapeError, InputError
        Naming the entry; if the magnitude is negative or not finite.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> directions = tl.datasets.load("vectors/grid18")  # (182, 3)
    >>> f"{tl.workspace.feasible_direction_fraction(structure, rig.limits, directions, magnitude=5.0):.3f}"
    '0.363'
    """
    matrices = structure_matrices(structure)
    wrenches = _wrenches(directions, magnitude, matrices.shape[-2], offset_wrench)
    batch = structure_batch(matrices, limits, directions=wrenches.shape[:-2])
    tolerance = feasibility_tolerance(wrenches)
    share = _native.reachable_share(*batch[:3], flatten_batch(wrenches, batch.shape, 2), tolerance, RANK_TOLERANCE)
    return share.reshape(batch.shape)[()]


class SquaredTension(NamedTuple):
    """Sums of squared tensions in N², (...), mean and maximum over directions.

    They go with the heat of the motors. NaN where a wrench is infeasible.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> found = tl.workspace.squared_tension(structure, rig.limits, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], 1.5)
    >>> bool(found.mean < found.worst)
    True
    """

    mean: Floats
    worst: Floats


def squared_tension(
    structure: ArrayLike,
    limits: TensionRange,
    directions: ArrayLike,
    magnitude: float,
    offset_wrench: ArrayLike | None = None,
) -> SquaredTension:
    """Return the squared tensions that wrenches of a magnitude take, over a set of directions.

    For each direction the tensions with the minimum sum of squares, by `tensionlab.allocate`. Parameters and
    errors as in `feasible_direction_fraction`.

    Parameters
    ----------
    structure, limits, directions, magnitude, offset_wrench
        As in `feasible_direction_fraction`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> structure = rig.structure_matrix(rig.home)
    >>> mean, worst = tl.workspace.squared_tension(structure, rig.limits, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], 1.5)
    >>> f"{mean:.2f} N², {worst:.2f} N²"
    '11.19 N², 14.91 N²'
    """
    matrices = structure_matrices(structure)
    wrenches = _wrenches(directions, magnitude, matrices.shape[-2], offset_wrench)
    structures, lower, upper, shape = structure_batch(matrices, limits, directions=wrenches.shape[:-2])
    desired = flatten_batch(wrenches, shape, 2)
    mean, worst = np.empty(len(desired)), np.empty(len(desired))
    step = max(1, ALLOCATIONS_PER_CALL // desired.shape[1])
    for start in range(0, len(desired), step):
        part = slice(start, start + step)
        allocate = Allocator((lower[part, None], upper[part, None]))
        squares = np.empty((len(mean[part]), desired.shape[1]))
        for some in _parts(squares.shape[1], len(squares)):
            found = allocate(structures[part, None], desired[part, some])
            sums = np.einsum("bkm,bkm->bk", found.tensions, found.tensions)
            squares[:, some] = np.where(found.status == Status.EXACT, sums, np.nan)
        mean[part], worst[part] = squares.mean(axis=1), squares.max(axis=1)
    return SquaredTension(mean.reshape(shape)[()], worst.reshape(shape)[()])


def feasibility_tolerance(wrenches: Floats) -> float:
    """Return how far outside the available wrench set a wrench may be and count as feasible, in N.

    The tolerance of an exact allocation: a share of the largest of the wrenches.
    """
    return TOLERANCE * max(1.0, math.sqrt(np.einsum("...n,...n", wrenches, wrenches).max(initial=0.0)))


def _offset(wrench: ArrayLike | None, n: int) -> Floats:
    """Return a wrench that is rendered at the same time, (..., n)."""
    if wrench is None:
        return np.zeros(n)
    found = require_finite("offset_wrench", wrench, 1)
    if found.shape[-1] != n:
        raise ShapeError(f"offset_wrench has {found.shape[-1]} components where structure has {n} rows")
    return found


def _wrenches(directions: ArrayLike, magnitude: float, n: int, offset_wrench: ArrayLike | None) -> Floats:
    """Return wrenches of one magnitude on top of another wrench, (..., k, n)."""
    if not (math.isfinite(magnitude) and magnitude >= 0):
        raise InputError(f"magnitude is {magnitude}; give a finite number, 0 or more")
    vectors = require_finite("directions", directions, 2)
    if not (vectors.shape[-2] and 1 <= vectors.shape[-1] <= n):
        raise ShapeError(
            f"directions have shape {vectors.shape}; give (k, d), with d from 1 to {n}, the rows of structure"
        )
    *leading, count, d = vectors.shape
    offset = _offset(offset_wrench, n)[..., None, :]
    wrenches = np.zeros(np.broadcast_shapes((*leading, count, n), offset.shape))
    for part in _parts(count, math.prod(leading)):
        lengths = np.linalg.norm(vectors[..., part, :], axis=-1, keepdims=True)
        if not lengths.all():
            *before, zero = map(int, np.argwhere(lengths[..., 0] == 0)[0])
            index = ", ".join(map(str, [*before, part.start + zero]))
            raise ShapeError(f"directions[{index}] is zero; give vectors with a direction")
        wrenches[..., part, :d] = magnitude * vectors[..., part, :] / lengths
        wrenches[..., part, :] += offset
    return wrenches


def _parts(count: int, poses: int) -> Iterator[slice]:
    """Yield the directions in parts small enough that Ctrl-C is heard between two."""
    step = max(1, ALLOCATIONS_PER_CALL // max(1, poses))
    return (slice(start, min(start + step, count)) for start in range(0, count, step))
