"""The capacity margin: by how much a rig can render more than is required of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE
from tensionlab.arrays import Floats, finite, rows
from tensionlab.errors import ShapeError
from tensionlab.workspace.poses import TensionRange, poses, structure_matrices

Wanted = ArrayLike | tuple[ArrayLike, ArrayLike] | None
"""What is required of a rig, as `capacity_margin` takes it."""


class Required(NamedTuple):
    """Which wrenches a rig must render: all within a radius of the hull of some.

    Attributes
    ----------
    wrenches : (..., k, n) array
    radius : (...) array
    """

    wrenches: Floats
    radius: Floats


def capacity_margin(structure: ArrayLike, limits: TensionRange, required: Wanted = None) -> Floats:
    """How far inside the available wrench set is all that is required?

    The available wrench set is all ``W t`` with t inside the limits. Where n is more than 3, its distances mix N
    and N·m: divide the torques of W and of the required wrenches by a length of your choice first.

    Source: Guay, Cardou, Cruz-Ruiz and Caro, "Measuring how well a structure supports varying external
    wrenches", 2014; Ruiz, Caro, Cardou and Guay, "ARACHNIS: Analysis of robots actuated by cables with handy and
    neat interface software", 2015. The facets are found by hyperplane shifting: Bouchard, Gosselin and Moore, "On
    the ability of a cable-driven robot to generate a prescribed set of wrenches", 2010.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    required : None, (n,) array, (..., k, n) array, or tuple
        None is no wrench at all: zero. An array with one axis is one wrench. An array with more holds the
        vertices of a set, k for each pose or for all; one wrench for each pose is ``wrench[..., None, :]``. A
        tuple is always a ball, ``(centre, radius)``: (..., n) and (...).

    Returns
    -------
    (...) array
        Least signed distance from the required set to a facet of the available one; 0 or more if and only if
        all of it can be rendered. A set without volume (W of lower rank) ends at once in the directions that it
        lacks: its margin is at most 0, less the distance of the required set from its plane.

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    matrices = structure_matrices(structure)
    wrenches, radius = required_set(required, matrices.shape[-2])
    given = poses(matrices, limits, required=wrenches.shape[:-2], radius=radius.shape)
    margin = _native.capacity_margin(*given[:3], rows(wrenches, given.shape, 2), RANK_TOLERANCE)
    return np.asarray(margin.reshape(given.shape) - radius)[()]


def required_set(required: Wanted, n: int) -> Required:
    """Which wrenches with n components are required?

    Raises
    ------
    ShapeError
        Naming the entry.
    """
    if required is None:
        return Required(np.zeros((1, n)), np.zeros(()))
    if isinstance(required, tuple):
        if len(required) != 2:
            raise ShapeError(
                f"required is a tuple of {len(required)}; a ball is (centre, radius), and vertices are an array"
            )
        centre, radius = finite("required centre", required[0], 1), finite("required radius", required[1], 0)
        if (radius < 0).any():
            raise ShapeError(f"required radius is {radius.min():g}; give 0 or more")
        wrenches = centre[..., None, :]
    else:
        wrenches, radius = finite("required", required, 1), np.zeros(())
        if wrenches.ndim == 1:
            wrenches = wrenches[None]
    if wrenches.shape[-1] != n:
        raise ShapeError(f"required wrenches have {wrenches.shape[-1]} components where structure has {n} rows")
    if wrenches.shape[-2] == 0:
        raise ShapeError("required has no wrench; give at least one, or None")
    return Required(wrenches, radius)
