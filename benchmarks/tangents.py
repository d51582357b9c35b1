"""Cables over swivelling pulleys by trigonometry, and feasible wrenches by vertices, without the kernels.

A reference for structure matrices, for their derivatives, and for proofs of workspaces.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.support.arrays import Floats

LongFloats = NDArray[np.longdouble]


class Places(NamedTuple):
    """Attachments (..., d) relative to their anchors, radii (...) and unit axes (..., d) of the pulleys, in m."""

    points: Floats
    radii: Floats
    axes: Floats

    def moved(self, by: NDArray[np.floating]) -> Places:
        """Return the places with the attachments moved."""
        return self._replace(points=self.points + by)


def direction(places: Places) -> LongFloats:
    """Return the unit vectors (..., d) from the attachments along the cables, in long doubles.

    Seen from the rim's centre, the point at which the cable leaves is turned from the attachment, at the distance
    h, by the angle whose cosine is r / h. NaN for an attachment that is inside its pulley.
    """
    point, radius, axis = (np.asarray(each, np.longdouble) for each in places)
    along = (point * axis).sum(axis=-1)
    across = point - along[..., None] * axis
    rho = np.sqrt((across**2).sum(axis=-1))
    with np.errstate(invalid="ignore"):
        leaves = np.arctan2(along, rho - radius) + np.arccos(radius / np.hypot(rho - radius, along))
    return np.asarray(np.cos(leaves)[..., None] * axis - (np.sin(leaves) / rho)[..., None] * across)


def gradient(places: Places, step: LongFloats) -> LongFloats:
    """Return the derivative (..., d, d) of the direction with respect to the attachment, by steps (...) in m."""
    columns = []
    for axis in np.eye(places.points.shape[-1]):
        move = step[..., None] * axis
        one, two = (direction(places.moved(far * move)) - direction(places.moved(-far * move)) for far in (1, 2))
        columns.append((8 * one - two) / (12 * step[..., None]))
    return np.stack(columns, axis=-1)


def structure_matrix(
    anchors: Floats, arms: Floats | None, radii: Floats, axes: Floats, position: Floats
) -> Floats:
    """Return the structure matrices (k, n, m) at positions (k, d); the other arrays are (m, d), radii (m,)."""
    points = position[:, None] - anchors + (0.0 if arms is None else arms)
    plain = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    over = direction(Places(points, radii, axes)).astype(np.float64)
    u = np.where((radii > 0)[:, None], over, plain)
    if arms is None:
        return np.swapaxes(u, 1, 2)
    if u.shape[-1] == 2:
        torque = (arms[:, 0] * u[..., 1] - arms[:, 1] * u[..., 0])[..., None]
    else:
        torque = np.cross(arms, u)
    return np.swapaxes(np.concatenate([u, torque], axis=-1), 1, 2)


def least_violation(structure: Floats, wrenches: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return how far, in N, tensions at the vertices leave their limits, at least: 0 or less if one is feasible.

    Tensions that render a wrench and keep their limits exist if and only if there are some of which all but n are
    at a limit, and the columns of those n are independent. Matrices (k, n, m) of full rank, wrenches (w, n) for
    all of them; returns (k, w), with infinity where columns are dependent.
    """
    k, n, m = structure.shape
    least = np.full((k, len(wrenches)), np.inf)
    for free in combinations(range(m), n):
        fixed = [cable for cable in range(m) if cable not in free]
        basis = structure[:, :, free]
        sound = np.abs(np.linalg.det(basis)) > 1e-12 * np.prod(np.linalg.norm(basis, axis=1), axis=1)
        inverse = np.linalg.inv(basis[sound])
        ends = np.array(list(product(*([lower[cable], upper[cable]] for cable in fixed)))).reshape(
            2 ** (m - n), m - n
        )
        without = (inverse @ structure[sound][:, :, fixed]) @ ends.T  # (k, n, ends)
        tension = (inverse @ wrenches.T)[:, :, :, None] - without[:, :, None]
        low, high = lower[list(free), None, None], upper[list(free), None, None]
        violation = np.maximum(low - tension, tension - high).max(axis=1).min(axis=-1)
        least[sound] = np.minimum(least[sound], violation)
    return least
