"""Measures of a structure matrix: can the cables hold the platform, and how evenly?"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE
from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError
from tensionlab.workspace.poses import TensionRange, poses, structure_matrices

CLOSURE_TOLERANCE = 1e-10
"""A pose with a tension factor of no more than this is on the edge of the wrench-closure workspace, not in it."""


def tension_factor(structure: ArrayLike) -> Floats:
    """How evenly can the cables be tensed against each other?

    Source: Pham, Yeo, Yang and Chen, "Workspace analysis of fully restrained cable-driven manipulators", 2009.
    Instead of their linear program, the facets of the wrench set for tensions between 1 and tau: it holds zero
    for all tau from 1/factor on.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Returns
    -------
    (...) array
        The largest ratio of least to largest tension with ``W t = 0``, from 0 to 1; 0 where there is no wrench
        closure, so also where W has a rank below n.

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    given = poses(structure_matrices(structure), (0.0, 2.0))
    return _native.tension_factor(*given[:3], RANK_TOLERANCE).reshape(given.shape)[()]


def wrench_closure(structure: ArrayLike) -> NDArray[np.bool_]:
    """Can the cables render every wrench, if they only pull hard enough?

    Source: Verhoeven, "Analysis of the workspace of tendon-based Stewart platforms", 2004.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Returns
    -------
    (...) array of bool
        Whether W has rank n and ``W t = 0`` for some t > 0: whether the tension factor exceeds
        `CLOSURE_TOLERANCE`.

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    return tension_factor(structure) > CLOSURE_TOLERANCE


def isotropic_force(structure: ArrayLike, limits: TensionRange, dimension: int | None = None) -> Floats:
    """Up to which force can a rig pull in every direction, without a torque?

    The radius of the largest ball of forces, about zero, in the available wrench set; each facet bounds it by the
    part of its normal that is a force.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    dimension : int or None
        How many of the n components are forces; the others are torques, and stay zero. None: the first three, or
        all where n is less. A planar platform, which has n = 3, needs 2: give ``rig.dimension``.

    Returns
    -------
    (...) array
        In N; 0 where some directions, or zero itself, cannot be rendered.

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    given = poses(structure_matrices(structure), limits)
    n = given.structure.shape[1]
    forces = min(n, 3) if dimension is None else dimension
    if not 1 <= forces <= n:
        raise ShapeError(f"dimension is {dimension}; of {n} wrench components, 1 to {n} can be forces")
    return _native.isotropic_force(*given[:3], forces, RANK_TOLERANCE).reshape(given.shape)[()]


def least_singular_value(structure: ArrayLike) -> Floats:
    """How much wrench do tensions of 1 N (root of their squares) render in the weakest direction?

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Returns
    -------
    (...) array
        The n-th singular value; 0 with fewer cables than components.
    """
    return _singular_values(structure)[..., -1][()]


def condition_number(structure: ArrayLike) -> Floats:
    """How much stronger is the strongest direction than the weakest?

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.

    Returns
    -------
    (...) array
        Largest over n-th singular value; infinite where the rank is below n.
    """
    sigma = _singular_values(structure)
    held = sigma[..., -1] > RANK_TOLERANCE * sigma[..., 0]
    ratio = np.full(held.shape, np.inf)
    np.divide(sigma[..., 0], sigma[..., -1], out=ratio, where=held)
    return ratio[()]


def _singular_values(structure: ArrayLike) -> Floats:
    """All n of them, largest first."""
    matrices = structure_matrices(structure)
    n, m = matrices.shape[-2:]
    found = np.linalg.svd(matrices, compute_uv=False)
    if m < n:
        found = np.concatenate([found, np.zeros((*found.shape[:-1], n - m))], axis=-1)
    return np.asarray(found)
