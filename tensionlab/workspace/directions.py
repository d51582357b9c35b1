"""What a rig does over a set of directions: which of them it can render, and how hard the cables pull for it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE, TOLERANCE, Allocator, Status
from tensionlab.arrays import Floats, finite, rows
from tensionlab.errors import ShapeError
from tensionlab.workspace.poses import TensionRange, poses, structure_matrices

AT_ONCE = 1 << 16
"""Allocations in one call: enough for all threads, and a few megabytes."""


class Effort(NamedTuple):
    """How hard the cables pull: sums of squared tensions, over directions.

    They go with the heat of the motors. NaN where a wrench is out of reach.

    Attributes
    ----------
    mean, worst : (...) arrays
        In N².
    """

    mean: Floats
    worst: Floats


def reachable_share(structure: ArrayLike, limits: TensionRange, directions: ArrayLike, magnitude: float) -> Floats:
    """In which share of the directions can a wrench of this magnitude be rendered?

    By the half-spaces of the available wrench set; nothing is solved.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    directions : (..., k, d) array
        Vectors of any length but zero, k for each pose or for all. Where d is less than n they are forces, and
        all other components are zero: no torque.
    magnitude : float
        In N, if the directions are forces.

    Returns
    -------
    (...) array
        From 0 to 1. A wrench outside by no more than the tolerance of an exact allocation counts as reached.

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    matrices = structure_matrices(structure)
    wrenches = _wrenches(directions, magnitude, matrices.shape[-2])
    given = poses(matrices, limits, directions=wrenches.shape[:-2])
    tolerance = TOLERANCE * max(1.0, magnitude)
    share = _native.reachable_share(*given[:3], rows(wrenches, given.shape, 2), tolerance, RANK_TOLERANCE)
    return share.reshape(given.shape)[()]


def effort(structure: ArrayLike, limits: TensionRange, directions: ArrayLike, magnitude: float) -> Effort:
    """How hard do the cables pull to render a wrench of this magnitude, over all directions?

    For each direction the tensions with the least sum of squares, by `tensionlab.allocate`.

    Parameters and errors as in `reachable_share`.

    Returns
    -------
    Effort
    """
    matrices = structure_matrices(structure)
    wrenches = _wrenches(directions, magnitude, matrices.shape[-2])
    structures, lower, upper, shape = poses(matrices, limits, directions=wrenches.shape[:-2])
    wanted = rows(wrenches, shape, 2)
    mean, worst = np.empty(len(wanted)), np.empty(len(wanted))
    step = max(1, AT_ONCE // wanted.shape[1])
    for start in range(0, len(wanted), step):
        part = slice(start, start + step)
        allocate = Allocator((lower[part, None], upper[part, None]))
        found = allocate(structures[part, None], wanted[part])
        squares = np.where(found.status == Status.EXACT, np.einsum("bkm,bkm->bk", *2 * [found.tensions]), np.nan)
        mean[part], worst[part] = squares.mean(axis=1), squares.max(axis=1)
    return Effort(mean.reshape(shape)[()], worst.reshape(shape)[()])


def _wrenches(directions: ArrayLike, magnitude: float, n: int) -> Floats:
    """Wrenches of one magnitude, (..., k, n)."""
    if not (math.isfinite(magnitude) and magnitude >= 0):
        raise ShapeError(f"magnitude is {magnitude}; give a finite number, 0 or more")
    vectors = finite("directions", directions, 2)
    if not (vectors.shape[-2] and 1 <= vectors.shape[-1] <= n):
        raise ShapeError(
            f"directions have shape {vectors.shape}; give (k, d), with d from 1 to {n}, the rows of structure"
        )
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not lengths.all():
        index = ", ".join(str(int(i)) for i in np.argwhere(lengths[..., 0] == 0)[0])
        raise ShapeError(f"directions[{index}] is zero; give vectors with a direction")
    wrenches = np.zeros((*vectors.shape[:-1], n))
    wrenches[..., : vectors.shape[-1]] = magnitude * vectors / lengths
    return wrenches
