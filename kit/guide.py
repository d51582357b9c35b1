"""Cable guide: a funnel that leads the cable into a ceramic ring outside the housing."""

from __future__ import annotations

from build123d import Cone, Cylinder, Pos, Rot
from build123d.topology import Part

from kit import parameters as p
from kit.shapes import block

SNOUT = p.eyelet_diameter / 2 + 3.0  # radius inside the cover's wall
SCREWS = 12.0  # from the cable, along y
AT = Pos(p.right, -p.spool_radius, p.cable_height) * Rot(0, 90, 0)  # z along the cable, outwards


def cable_guide() -> Part:
    """Return the cable guide where it is assembled."""
    plate, inside = p.eyelet_height + 1.5, p.wall + 2.0
    y, z = -p.spool_radius, p.cable_height
    part = block((p.right, p.right + plate), (y - SCREWS - 5.0, y + SCREWS + 5.0), (z - 9.0, z + 9.0))
    part += AT * Pos(0, 0, -inside / 2) * Cylinder(SNOUT, inside)
    # A funnel from the inside to the ring's bore, and the ring's seat from the outside.
    depth = inside + plate - p.eyelet_height
    part -= AT * Pos(0, 0, depth / 2 - inside) * Cone(SNOUT - 1.3, p.eyelet_diameter / 2 - 1.5, depth)
    part -= AT * Pos(0, 0, plate - p.eyelet_height / 2) * Cylinder(p.eyelet_diameter / 2 + 0.05, p.eyelet_height)
    for side in (-SCREWS, SCREWS):
        part -= AT * Pos(0, side, plate / 2) * Cylinder(p.through_m3 / 2, plate)
    return part
