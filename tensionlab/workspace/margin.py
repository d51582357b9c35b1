"""Capacity margin, and its derivatives by the structure matrix, the pose and the anchors."""

from __future__ import annotations

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
from tensionlab.support.arrays import Floats, flatten_batch, require_finite
from tensionlab.workspace.wrench_set import StructureBatch, TensionRange, structure_batch, structure_matrices

RequiredWrenches = ArrayLike | tuple[ArrayLike, ArrayLike] | None  # as in `capacity_margin`


class MarginGradient(NamedTuple):
    """Capacity margin (...), and its derivative (..., n, m) with respect to the structure matrix."""

    margin: Floats
    structure: Floats


class RigMarginGradient(NamedTuple):
    """Capacity margin (...), and its derivatives, per m that something moves.

    (..., d) for the reference point, without rotation; (..., m, d) for each anchor, in the axes of its own frame.
    """

    margin: Floats
    position: Floats
    anchors: Floats


def capacity_margin(structure: ArrayLike, limits: TensionRange, required: RequiredWrenches = None) -> Floats:
    """Return the signed distance (...) of the required wrench set from the boundary of the available one.

    0 or more if and only if all of it is feasible. The available wrench set is all ``W t`` with t inside the
    limits; one without volume (W of lower rank) ends at once in the directions that it lacks: its margin is at
    most 0, less the distance of the required set from its plane. Where n is more than 3, its distances mix N and
    N·m: divide the torques of W and of the required wrenches by a length of your choice first, such as
    `Rig.characteristic_length`. ShapeError names an entry that does not fit.

    Source: Guay, Cardou, Cruz-Ruiz and Caro, "Measuring how well a structure supports varying external wrenches",
    2014; Ruiz, Caro, Cardou and Guay, "ARACHNIS: Analysis of robots actuated by cables with handy and neat
    interface software", 2015. The facets are found by hyperplane shifting: Bouchard, Gosselin and Moore, "On the
    ability of a cable-driven robot to generate a prescribed set of wrenches", 2010.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices.
    limits : object with ``lower`` and ``upper``, or a pair
        Tension limits in N, each (..., m) or a number.
    required : None, (n,) array, (..., k, n) array, or tuple
        None is no wrench at all: zero. An array with one axis is one wrench. An array with more holds the vertices
        of a set, k for each pose or for all; one wrench for each pose is ``wrench[..., None, :]``. A tuple is
        always a ball, ``(centre, radius)``: (..., n) and (...).

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


def required_margin(
    rig: Rig, structure: Floats, required: Requirement, rotation: ArrayLike | None = None
) -> Floats:
    """Return the capacity margin (...) of a rig about its required wrenches, in N.

    Torques, of the structure matrices (..., n, m) of its poses and of the required wrenches, are divided by the
    characteristic length of the requirement. The rotation, whose leading axes are those of the matrices, is as in
    `Rig.structure_matrix`.
    """
    corners = required.at(rig, rotation)
    if rig.n > rig.dimension:
        unit = np.ones(rig.n)
        unit[rig.dimension :] /= required.length_for(rig)
        structure, corners = structure * unit[:, None], corners * unit
    return capacity_margin(structure, rig.limits, corners) - required.ball


def margin_gradient(
    structure: ArrayLike, limits: TensionRange, required: RequiredWrenches = None
) -> MarginGradient:
    """Return the capacity margin and its derivative with respect to the structure matrix.

    The nearest facet turns and moves with W such that the derivative is ``h t'``: h is its unit normal, and t are
    the tensions whose wrench is, of all in the plane of the facet, the nearest to the required one. Where several
    facets or wrenches are equally near, the margin has no derivative, and this is one that belongs to one of them;
    where a flat set holds what is required it is zero.

    Source: as `capacity_margin`; the derivative is that of the support function of a zonotope at a facet.
    Parameters and errors as in `capacity_margin`.

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
    """Return the capacity margin of a rig and its derivatives with respect to position and anchors.

    Poses as in `Rig.structure_matrix`, required wrenches (world axes) as in `capacity_margin`, errors as in both.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> higher = tl.workspace.rig_margin_gradient(rig, rig.home).position[1]
    >>> f"{higher:.2f} N/m, if the hand is raised"
    '-7.63 N/m, if the hand is raised'
    """
    cables = rig.cables(position, rotation, frames)
    W = kinematics.structure_matrix(cables.directions, cables.arms)
    margin, by_structure = margin_gradient(W, rig.limits, required)
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    vectors = kinematics.to_anchors(anchors, np.asarray(position, dtype=np.float64), cables.arms)
    by_anchor = kinematics.anchor_gradient(by_structure, vectors, cables.arms, rig.pulleys_in_world(frames))
    own = pose.to_module_frames(rig.modules, by_anchor, frames)
    return RigMarginGradient(margin, -by_anchor.sum(axis=-2), own)


def _arguments(
    structure: ArrayLike, limits: TensionRange, required: RequiredWrenches
) -> tuple[StructureBatch, Floats, Floats]:
    """Return the batch, its required wrenches (B, k, n), and the radius (...) around them."""
    matrices = structure_matrices(structure)
    wrenches, radius = _required_set(required, matrices.shape[-2])
    batch = structure_batch(matrices, limits, required=wrenches.shape[:-2], radius=radius.shape)
    return batch, flatten_batch(wrenches, batch.shape, 2), radius


def _required_set(required: RequiredWrenches, n: int) -> tuple[Floats, Floats]:
    """Return the required wrenches (..., k, n), and the radius (...) around their hull."""
    radius = np.zeros(())
    if required is None:
        return np.zeros((1, n)), radius
    if not isinstance(required, tuple):
        wrenches = require_finite("required", required, 1)
        wrenches = wrenches[None] if wrenches.ndim == 1 else wrenches
    elif len(required) == 2:
        wrenches = require_finite("required centre", required[0], 1)[..., None, :]
        radius = require_finite("required radius", required[1], 0)
    else:
        raise ShapeError(
            f"required is a tuple of {len(required)}; a ball is (centre, radius), and vertices are an array"
        )
    if (radius < 0).any():
        raise ShapeError(f"required radius is {radius.min():g}; give 0 or more")
    if wrenches.shape[-1] != n:
        raise ShapeError(f"required wrenches have {wrenches.shape[-1]} components where structure has {n} rows")
    if wrenches.shape[-2] == 0:
        raise ShapeError("required has no wrench; give at least one, or None")
    return wrenches, radius
