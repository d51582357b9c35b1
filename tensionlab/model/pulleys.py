"""Cables over swivelling pulleys, for arrays of poses: how long they are, and where they pull.

A cable comes to its pulley along the axis about which the pulley swivels, at the anchor, which is on the pulley's
rim; it goes round the rim, and leaves it for the attachment. The pulley swivels into the plane of axis and
attachment. In that plane, with the coordinate rho across the axis and z along it, the rim's centre is at (r, 0),
and the cable leaves it after an arc of the angle b, towards (sin b, cos b): a straight part s from there ends at
(rho, z), so that::

    s² = rho² + z² - 2 r rho
    sin b = (s (rho - r) + r z) / (s² + r²)
    cos b = (s z - r (rho - r)) / (s² + r²)

and the length from the anchor is ``r b + s``. What moves the attachment across the straight part does not change
it, so that a structure matrix still is minus the derivative of the lengths. A radius of 0 is a fixed anchor.

Source: Pott 2012, "Influence of pulley kinematics on cable-driven parallel robots"; Bruckmann et al. 2008.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.support.arrays import Floats

ARC_POINTS = 16  # points of a drawn cable's arc on its pulley
ROUNDING_RAD = 1e-6  # an arc that is negative by more than that has gone round the pulley


class Pulleys(NamedTuple):
    """Pulleys of the modules of a rig."""

    radii: Floats  # (m,) in m; 0 for none
    axes: Floats  # unit vectors along the cables that come to the pulleys, in world axes, (..., m, d); or zeros

    def rows(self, part: NDArray[np.int64]) -> Pulleys:
        """Return those of some poses, where they differ from pose to pose."""
        return self if self.axes.ndim < 3 else Pulleys(self.radii, self.axes[part])


class CableGeometry(NamedTuple):
    """Lengths (..., m) of cables, unit vectors (..., m, d) from attachments, and straight parts (..., m)."""

    lengths: Floats
    directions: Floats
    straight: Floats


class _Plane(NamedTuple):
    """Where attachments are in the planes of their pulleys, and where their cables leave."""

    outward: Floats  # unit vectors (..., m, d) from the axis to the attachment
    across: Floats
    straight: Floats
    sine: Floats
    cosine: Floats


def route_cables(vectors: Floats, pulleys: Pulleys) -> CableGeometry:
    """Return the geometry of cables with vectors (..., m, d) from attachments to anchors, in m.

    The straight part is 0 for an attachment that is inside its pulley.
    """
    plane = _plane(vectors, pulleys)
    towards = plane.sine[..., None] * plane.outward + plane.cosine[..., None] * pulleys.axes
    return CableGeometry(plane.straight + pulleys.radii * _angle(plane), -towards, plane.straight)


def arcs(vectors: Floats, pulleys: Pulleys, count: int) -> Floats:
    """Return points (count, ..., m, d) along the rims, relative to the anchors, to where cables leave.

    Vectors as in `route_cables`.
    """
    plane = _plane(vectors, pulleys)
    angle = _angle(plane)
    angles = np.linspace(0.0, 1.0, count).reshape(-1, *[1] * angle.ndim) * angle
    inward, along = pulleys.radii * (1.0 - np.cos(angles)), pulleys.radii * np.sin(angles)
    points: Floats = inward[..., None] * plane.outward + along[..., None] * pulleys.axes
    return points


def ways(ends: Floats, anchors: Floats, pulleys: Pulleys | None) -> Floats:
    """Return points (k, m, d) along cables from their attachments (m, d) over the rims to their anchors (m, d)."""
    if pulleys is None:
        return np.stack([ends, anchors])
    return np.concatenate([ends[None], (anchors + arcs(anchors - ends, pulleys, ARC_POINTS))[::-1]])


def turn_gradient(pull: Floats, vectors: Floats, pulleys: Pulleys) -> Floats:
    """Return the derivative of a number with respect to the anchors, from that with respect to the directions.

    In the plane of its pulley a cable turns about where it leaves, across that plane about the axis. Both are
    (..., m, d), the second without and the first with the unit 1/m; pulleys go along with their anchors.
    """
    plane = _plane(vectors, pulleys)
    direction = -(plane.sine[..., None] * plane.outward + plane.cosine[..., None] * pulleys.axes)
    within = plane.cosine[..., None] * plane.outward - plane.sine[..., None] * pulleys.axes
    part = _dot(pull, within)[..., None] * within
    sideways = pull - _dot(pull, direction)[..., None] * direction - part
    swing = plane.sine / np.where(plane.across > 0.0, plane.across, 1.0)
    gradient: Floats = part / plane.straight[..., None] + sideways * swing[..., None]
    return gradient


def _plane(vectors: Floats, pulleys: Pulleys) -> _Plane:
    r, axes = pulleys
    z = -_dot(vectors, axes)
    outward = -vectors - z[..., None] * axes
    across = np.sqrt(_dot(outward, outward))
    straight = np.sqrt(np.maximum(across * (across - 2.0 * r) + z * z, 0.0))
    square = straight**2 + r**2
    square = np.where(square > 0.0, square, 1.0)
    return _Plane(
        outward / np.where(across > 0.0, across, 1.0)[..., None],
        across,
        straight,
        (straight * (across - r) + r * z) / square,
        (straight * z - r * (across - r)) / square,
    )


def _angle(plane: _Plane) -> Floats:
    """Return the angles (..., m) of the arcs, in rad."""
    angle = np.arctan2(plane.sine, plane.cosine)
    return np.where(angle < -ROUNDING_RAD, angle + 2 * np.pi, angle)


def _dot(one: Floats, other: Floats) -> Floats:
    product: Floats = np.einsum("...i,...i->...", one, other)
    return product
