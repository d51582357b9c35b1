"""How far the reach of a rig extends, from the facets of its available wrench set; no solver is involved."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from tensionlab.solvers.contract import Floats


def facets(structure: Floats, lower: Floats, upper: Floats) -> tuple[Floats, Floats, Floats]:
    """Between which parallel planes do the wrenches lie that tensions inside their limits render?

    The available wrench set is a zonotope: each pair of parallel facets is spanned by n - 1 cables whose
    tensions vary, while every other cable is at one of its limits. All choices of n - 1 cables are tried; a
    choice that is rank-deficient gives planes that touch the set in less than a facet, which does no harm.

    Source: Bouchard, Gosselin and Moore, "On the ability of a cable-driven robot to generate a prescribed set
    of wrenches", 2010 (hyperplane shifting).

    Parameters
    ----------
    structure : (B, n, m) array
        Structure matrices of rank n, m >= n >= 2.
    lower, upper : (B, m) or (m,) arrays
        Tension limits in N.

    Returns
    -------
    normals : (B, F, n) array
        Unit vectors d, one a pair of planes.
    least, most : (B, F) arrays
        A wrench w is available if and only if ``least <= d·w <= most`` for all F.
    """
    n, m = structure.shape[1:]
    chosen = np.array(list(combinations(range(m), n - 1)))
    spans = np.moveaxis(structure[:, :, chosen], 2, 1)
    normals = np.linalg.qr(spans, mode="complete").Q[..., -1]
    gain = normals @ structure
    at_lower, at_upper = gain * lower[..., None, :], gain * upper[..., None, :]
    least, most = np.minimum(at_lower, at_upper).sum(axis=-1), np.maximum(at_lower, at_upper).sum(axis=-1)
    return normals, least, most


def furthest(structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Floats:
    """Up to which factor can each wrench be scaled and still be rendered?

    Parameters
    ----------
    structure, lower, upper : arrays
        As in `facets`.
    wrench : (B, n) array
        Wrenches that can be rendered, none of them zero.

    Returns
    -------
    (B,) array
        The largest s for which tensions inside their limits render ``s w``; at least 1 but for rounding.
    """
    normals, least, most = facets(structure, lower, upper)
    along = (normals @ wrench[..., None])[..., 0]
    with np.errstate(divide="ignore"):  # planes along the wrench never stop it
        factors = np.where(along == 0.0, np.inf, np.where(along > 0.0, most, least) / along)
    return np.asarray(factors.min(axis=1))


def clearance(structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Floats:
    """How far inside the available wrench set is each wrench?

    Parameters
    ----------
    structure, lower, upper : arrays
        As in `facets`.
    wrench : (B, n) array

    Returns
    -------
    (B,) array
        Distance to the nearest plane of a facet, in N (and N·m); negative where the wrench is out of reach.
    """
    normals, least, most = facets(structure, lower, upper)
    along = (normals @ wrench[..., None])[..., 0]
    return np.asarray(np.minimum(most - along, along - least).min(axis=1))
