"""Spool: one layer of cable, screwed to the rotor. Printed upright, without support."""

from __future__ import annotations

from build123d import Cone, Cylinder, Pos, Rot
from build123d.topology import Part

from kit import parameters as p
from kit.shapes import around, disc


def spool() -> Part:
    """Return the spool where it is assembled."""
    floor, inside = p.motor_top, p.motor_top + p.spool_floor
    # The upper flange is a cone below, so that it prints without support.
    slope = p.flange_radius - p.core_radius
    cone = Pos(0, 0, p.spool_top - p.flange_rim - slope / 2) * Cone(p.core_radius, p.flange_radius, slope)
    rim = disc(p.flange_radius, p.flange_rim, z=p.spool_top - p.flange_rim)
    part = (
        disc(p.tip_radius, p.spool_floor, z=floor) + disc(p.core_radius, p.spool_top - floor, z=floor) + cone + rim
    )
    part -= disc(p.core_radius - p.spool_wall, p.spool_top, z=inside)
    part -= disc(p.motor_bore / 2, p.spool_floor, z=floor)
    for at in around(p.rotor_screws, p.rotor_hole_circle / 2):
        part -= disc(p.rotor_hole / 2, p.spool_floor, at, floor)
    for at in around(p.ratchet_screws, p.ratchet_screw_radius):
        part -= disc(p.through_m2 / 2, p.spool_floor, at, floor)
        part -= disc(2.1, 1.5, at, inside - 1.5)  # heads lie below the cable
    # The cable's end goes through the core and is knotted inside.
    return part - Pos(p.core_radius, 0, inside + 1.0) * Rot(0, 90, 0) * Cylinder(0.6, 4 * p.spool_wall)
