"""Tensions that render a wrench and make the platform as stiff as it can be along a direction.

At a pose, the stiffness along a direction is linear in the tensions (`tensionlab.model.stiffness`), so that the
stiffest tensions are those of a linear programme. Its multipliers bound the stiffness of all others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tensionlab import _native
from tensionlab.allocation import Allocation, allocate
from tensionlab.model import pose
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.model.stiffness import displacement, stiffness_terms
from tensionlab.solvers.base import Problem
from tensionlab.support.arrays import Floats, flatten_batch
from tensionlab.support.formatting import format_count


@dataclass(frozen=True, eq=False)
class StiffestTensions:
    """Stiffest tensions along a direction, and the proof that no others are stiffer.

    Attributes
    ----------
    allocation : Allocation
        The tensions, with a verified status. Where the wrench is infeasible they are those of the nearest wrench.
    stiffness : (...) array
        Stiffness along the direction with these tensions, in N/m.
    bound : (...) array
        Upper bound of the stiffness of all tensions in the limits that render the wrench, in N/m, by the
        multipliers of the linear program; NaN where none do. It is the stiffness itself, to rounding, but may be
        far above where the wrench is on the border of what can be rendered.
    """

    allocation: Allocation
    stiffness: Floats
    bound: Floats

    def __repr__(self) -> str:
        if self.stiffness.ndim:
            return f"<StiffestTensions of {format_count(self.stiffness.size, 'pose')}>"
        return f"<StiffestTensions: {self.stiffness:.6g} N/m, at most {self.bound:.6g} N/m>"


def stiffest_tensions(
    rig: Rig,
    direction: str | ArrayLike,
    wrench: ArrayLike | None = None,
    position: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
    frames: Frames | None = None,
) -> StiffestTensions:
    """Return the tensions inside the limits that render a wrench and have the largest stiffness along a direction.

    Maximises ``e'K(t) e`` subject to ``W t = w`` and the limits, K being `tensionlab.stiffness_matrix` and e the
    direction. Of equally stiff tensions they are those with the least sum of squares. They may jump from pose to
    pose.

    Parameters
    ----------
    rig : Rig
        Each module needs `Module.cable_stiffness`.
    direction : str or array
        "up", "x", "y", "z", or a vector: d numbers for a displacement, or n with a rotation, which counts with
        `Rig.characteristic_length`. Of any length.
    wrench : (..., n) array, optional
        Desired in addition to what the rig requires, as in `Rig.allocate`; zero if left out.
    position, rotation, frames
        Pose, as in `Rig.allocate`. All leading axes broadcast.

    Raises
    ------
    RigError, ShapeError, InputError
        As of `tensionlab.stiffness_matrix` and `Rig.allocate`; and if the direction is unknown or zero.

    Examples
    --------
    >>> import dataclasses
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> cords = tuple(dataclasses.replace(module, cable_stiffness=200.0) for module in rig.modules)  # EA in N
    >>> found = tl.stiffest_tensions(dataclasses.replace(rig, modules=cords), "up")
    >>> found.allocation.tensions.round(3)
    array([4.338, 4.338, 4.338, 6.   ])
    >>> bool(found.bound - found.stiffness < 1e-6)  # N/m: no tensions are stiffer
    True
    """
    along = displacement(rig, direction)
    place = pose.points(rig.home if position is None else position, rig.dimension, "position")
    frames = rig.at_rest if frames is None else frames
    terms = stiffness_terms(rig, place, rotation, frames)
    gains = np.einsum("i,...mij,j->...m", along, terms.slopes, along)  # N/m per N
    constant = np.einsum("i,...ij,j->...", along, terms.constant, along)
    W = rig.structure_matrix(place, rotation, frames)
    extra = np.zeros(rig.n) if wrench is None else pose.points(wrench, rig.n, "wrench")
    desired = extra + rig.required.middle(rig, rotation)

    shape = np.broadcast_shapes(W.shape[:-2], desired.shape[:-1])
    scale = np.abs(gains).max(axis=-1, keepdims=True)
    costs = np.ascontiguousarray(-gains / np.where(scale > 0.0, scale, 1.0))
    structure, wrenches = flatten_batch(W, shape, 2), flatten_batch(desired, shape, 1)
    lower, upper = (flatten_batch(limit, shape, 1) for limit in (rig.limits.lower, rig.limits.upper))
    problem = Problem(structure, wrenches, lower, upper, np.zeros(lower.shape), np.ones(rig.n), None)
    lower, upper, _, multipliers = _native.tighten(problem.arrays, 0, 1.0, flatten_batch(costs, shape, 1))
    best = lower.reshape(*shape, rig.m), upper.reshape(*shape, rig.m)
    allocation = allocate(W, desired, best)

    # For any y, gains·t is y·w + (gains - W'y)·t where W t = w, and at most that of the larger ends.
    y = -multipliers.reshape(*shape, rig.n) * scale
    reduced = gains - np.einsum("...nm,...n->...m", W, y)
    pull = np.maximum(reduced * rig.limits.lower, reduced * rig.limits.upper).sum(axis=-1)
    bound = constant + np.einsum("...n,...n->...", desired, y) + pull
    return StiffestTensions(
        replace(allocation, modules=tuple(module.name for module in rig.modules), desired=desired, position=place),
        np.asarray(constant + np.einsum("...m,...m->...", gains, allocation.tensions)),
        np.where(allocation.exact, bound, np.nan),
    )
