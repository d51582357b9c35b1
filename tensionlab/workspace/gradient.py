"""How the capacity margin changes with the structure matrix, with the pose and with the anchors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE
from tensionlab.arrays import Floats, rows
from tensionlab.model import kinematics, pose
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.workspace.margin import Wanted, required_set
from tensionlab.workspace.poses import TensionRange, poses, structure_matrices


class MarginGradient(NamedTuple):
    """A capacity margin, and its derivative with respect to the structure matrix.

    Attributes
    ----------
    margin : (...) array
    structure : (..., n, m) array
    """

    margin: Floats
    structure: Floats


class RigMarginGradient(NamedTuple):
    """A capacity margin, and its derivatives with respect to where the platform and the anchors are.

    Attributes
    ----------
    margin : (...) array
    position : (..., d) array
        Per m that the reference point moves, without a turn.
    anchors : (..., m, d) array
        Per m that each anchor moves, in the axes of its own frame, as in `Rig.anchors`.
    """

    margin: Floats
    position: Floats
    anchors: Floats


def margin_gradient(structure: ArrayLike, limits: TensionRange, required: Wanted = None) -> MarginGradient:
    """How does the capacity margin change with the structure matrix?

    Parameters and errors as in `capacity_margin`. The nearest facet turns and moves with W such that the
    derivative is ``h t'``: h is its unit normal, and t are the tensions whose wrench is, of all in the plane of
    the facet, the nearest to the required one. Where several facets or wrenches are equally near, the margin has
    no derivative, and this is one that belongs to one of them; where a flat set holds what is required it is zero.

    Source: Guay, Cardou, Cruz-Ruiz and Caro, "Measuring how well a structure supports varying external wrenches",
    2014, for the margin; the derivative is that of the support function of a zonotope at a facet.

    Returns
    -------
    MarginGradient
    """
    matrices = structure_matrices(structure)
    wrenches, radius = required_set(required, matrices.shape[-2])
    given = poses(matrices, limits, required=wrenches.shape[:-2], radius=radius.shape)
    margin, normal, _, tensions = _native.active_facet(*given[:3], rows(wrenches, given.shape, 2), RANK_TOLERANCE)
    by_structure = normal[:, :, None] * tensions[:, None, :]
    return MarginGradient(
        np.asarray(margin.reshape(given.shape) - radius)[()],
        by_structure.reshape(*given.shape, *given.structure.shape[1:]),
    )


def rig_margin_gradient(
    rig: Rig,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
    required: Wanted = None,
) -> RigMarginGradient:
    """How does the capacity margin change as the platform or an anchor moves?

    Parameters
    ----------
    rig : Rig
    position, rotation, frames
        Poses, as in `Rig.structure_matrix`; leading axes broadcast.
    required
        As in `capacity_margin`; it stays the same in world axes.

    Returns
    -------
    RigMarginGradient

    Raises
    ------
    ShapeError, RigError
        As `Rig.structure_matrix` and `capacity_margin`.
    """
    cables = rig.cables(position, rotation, frames)
    W = kinematics.structure_matrix(cables.directions, cables.arms)
    margin, by_structure = margin_gradient(W, rig.limits, required)
    by_anchor = kinematics.anchor_gradient(by_structure, *cables)
    own = pose.in_own_axes(rig.modules, by_anchor, frames)
    return RigMarginGradient(margin, -by_anchor.sum(axis=-2), own)
