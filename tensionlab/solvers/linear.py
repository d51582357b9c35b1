"""Which part of a wrench can a structure matrix produce at all: bases and metrics that respect the rank.

A rank-deficient structure matrix is an ordinary rig (fewer modules than degrees of freedom, or all cables in
a plane), so nothing here divides by a singular value below `RANK_TOLERANCE` times the largest one.
"""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.solvers.base import RANK_TOLERANCE


def times(matrices: Floats, vectors: Floats) -> Floats:
    """Which vector each matrix makes of its own: (..., n, m) times (..., m) is (..., n)."""
    product: Floats = np.matmul(matrices, vectors[..., None])[..., 0]
    return product


def independent_rows(matrix: Floats) -> tuple[Floats, Floats]:
    """Which combinations of the rows of a matrix are independent, and how strong is each.

    Parameters
    ----------
    matrix : (n, m) array

    Returns
    -------
    basis : (n, r) array
        Orthonormal columns U such that the r rows of ``U' matrix`` are orthogonal and span its row space.
    strength : (r,) array
        Norms of those rows: the singular values that count, largest first.
    """
    basis: Floats
    strength: Floats
    basis, strength, _ = np.linalg.svd(matrix, full_matrices=False)
    kept = strength > RANK_TOLERANCE * strength.max(initial=0.0)
    return basis[:, kept], strength[kept]


def whitener(structure: Floats) -> Floats:
    """Which matrix turns the distance between wrenches into the distance between tensions.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices W.

    Returns
    -------
    (..., n, n) array
        ``((W W')⁺)^(1/2)``, symmetric. The norm of it times a wrench is the norm of the least tensions that
        render that wrench, so it is the metric of the "tension" policy.
    """
    basis, strength, _ = np.linalg.svd(structure, full_matrices=False)
    kept = strength > RANK_TOLERANCE * strength.max(axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, strength, where=kept, out=np.zeros_like(strength))
    root: Floats = (basis * inverse[..., None, :]) @ np.swapaxes(basis, -1, -2)
    return root
