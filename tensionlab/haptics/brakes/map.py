"""Which walls can a rig hold? The brakeable directions of a point, over a set of normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.arrays import Floats, finite
from tensionlab.errors import ShapeError
from tensionlab.haptics.brakes.choice import DEFAULT, LockRule, LockSet, choose_locks
from tensionlab.model.module import TensionLimits

CONVINCING = np.pi / 4
"""A force this far off its direction is still taken for the intended one, in rad."""


class BrakeMap(NamedTuple):
    """What meets a push against each wall?

    Attributes
    ----------
    normals : (k, d) array
        Unit vectors towards the free side.
    force : float
        Of the push, in N.
    chosen : LockSet
        With leading axes (..., k).
    off : (..., k) array
        Angle from the normal to the force that meets the push, in rad, from 0 to pi; pi where no force does.
    """

    normals: Floats
    force: float
    chosen: LockSet
    off: Floats

    def share(self, within: float = CONVINCING) -> Floats:
        """For which share of the walls does the force come from within this angle of the normal? (...) array."""
        return np.asarray((self.off <= within).mean(axis=-1))


def brake_map(
    structure: ArrayLike,
    normals: ArrayLike,
    force: float,
    limits: TensionLimits,
    strengths: ArrayLike,
    rule: LockRule = DEFAULT,
) -> BrakeMap:
    """Which walls can a rig hold against this push, with motors and brakes together?

    Parameters
    ----------
    structure : (..., d, m) array
        Structure matrices of a point, one for each position.
    normals : (k, d) array
        Unit vectors, as those of `tensionlab.model.directions`.
    force : float
        In N, above 0.
    limits, strengths, rule
        As in `choose_locks`; strengths of 0 make a map of the motors alone.

    Returns
    -------
    BrakeMap

    Raises
    ------
    ShapeError
        As `choose_locks`, and for a force of 0.
    """
    U, n = finite("structure", structure, 0), finite("normals", normals, 0)
    if not force > 0.0 or U.ndim < 2 or n.ndim != 2:
        raise ShapeError(
            f"force is {force}, structure has shape {U.shape} and normals {n.shape}; give a force above 0 N, "
            "(..., d, m) and (k, d)"
        )
    chosen = choose_locks(U[..., None, :, :], n, force, limits, strengths, rule=rule)
    met = np.einsum("...im,...km->...ki", U, chosen.motors + chosen.brakes)
    along = np.einsum("...ki,ki->...k", met, n)
    across = np.linalg.norm(met - along[..., None] * n, axis=-1)
    off = np.where((along == 0.0) & (across == 0.0), np.pi, np.arctan2(across, along))
    return BrakeMap(n, float(force), chosen, off)
