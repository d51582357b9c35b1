"""Magnet mount: pressed into the motor's hollow shaft from below, with the encoder's magnet glued into it."""

from __future__ import annotations

from build123d.topology import Part

from kit import parameters as p
from kit.shapes import disc

GAP = 0.5  # to the stator, which does not turn


def magnet_mount() -> Part:
    """Return the magnet mount where it is assembled."""
    head = p.motor_base - GAP - p.magnet_face
    part = disc(p.magnet_diameter / 2 + 1.5, head, z=p.magnet_face)
    part += disc(p.motor_bore / 2 - 0.05, 6.0 + GAP, z=p.motor_base - GAP)
    return part - disc(p.magnet_diameter / 2 + 0.05, p.magnet_height, z=p.magnet_face)
