"""How far the reach of a rig extends along a wrench, from its available wrench set; no solver is involved."""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.workspace import half_spaces


def furthest(structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Floats:
    """Up to which factor can each wrench be scaled and still be rendered?

    Parameters
    ----------
    structure : (B, n, m) array
        Structure matrices of rank n.
    wrench : (B, n) array
        Wrenches that can be rendered, none of them zero.
    lower, upper : (B, m) or (m,) arrays
        Tension limits in N.

    Returns
    -------
    (B,) array
        The largest s for which tensions inside their limits render ``s w``; at least 1 but for rounding.
    """
    normals, offsets = half_spaces(structure, (lower, upper))
    along = (normals @ wrench[..., None])[..., 0]
    factors = np.divide(offsets, along, out=np.full(along.shape, np.inf), where=along > 0.0)
    return np.asarray(factors.min(axis=1))
