"""Structure matrices and tension limits as people give them, made a batch with one row for each pose."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import ArrayLike

from tensionlab.arrays import Floats, Limits, check_size, common_axes, finite, rows, spread, tension_limits

TensionRange = Limits | tuple[ArrayLike, ArrayLike]
"""Tension limits in N: an object with ``lower`` and ``upper``, or that pair; each (..., m) or a number."""


class Poses(NamedTuple):
    """A batch of B poses, and the leading axes that their results have.

    Attributes
    ----------
    structure : (B, n, m) array
    lower, upper : (B, m) arrays
    shape : tuple of int
        B entries in all.
    """

    structure: Floats
    lower: Floats
    upper: Floats
    shape: tuple[int, ...]


def structure_matrices(structure: ArrayLike) -> Floats:
    """Which structure matrices (..., n, m) are meant?

    Raises
    ------
    ShapeError
        For NaN, infinity, and sizes that the kernels do not serve.
    """
    matrices = finite("structure", structure, 2)
    n, m = matrices.shape[-2:]
    check_size(n, m)
    return matrices


def poses(matrices: Floats, limits: TensionRange, **axes: tuple[int, ...]) -> Poses:
    """Which poses are meant, their leading axes broadcast to each other and to further named ones?

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    m = matrices.shape[-1]
    low, high = tension_limits(limits)
    lower, upper = spread("lower", low, m, "cables"), spread("upper", high, m, "cables")
    shape = common_axes(structure=matrices.shape[:-2], lower=lower.shape[:-1], upper=upper.shape[:-1], **axes)
    return Poses(rows(matrices, shape, 2), rows(lower, shape, 1), rows(upper, shape, 1), shape)
