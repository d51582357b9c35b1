"""Breakaway link between the cable and the person: its neck breaks before the brake pulls with all it can.

Printed flat, so that the neck's layers lie along the pull. Print ten of one spool, and break three with a scale.
"""

from __future__ import annotations

from build123d.topology import Part

from kit import parameters as p
from kit.shapes import block, disc, prism


def breakaway_link() -> Part:
    """Return the link, flat on the plane z = 0."""
    radius = p.eye_diameter / 2 + 3.0
    part = disc(radius, p.link_thickness, (-16, 0)) + disc(radius, p.link_thickness, (16, 0))
    half, thick = p.neck / 2, 3.0
    side = [(-16, -thick), (-6, -thick), (-2, -half), (2, -half), (6, -thick), (16, -thick)]
    part += prism([*side, *((x, -y) for x, y in reversed(side))], p.link_thickness)
    part -= block((-2.0, 2.0), (-thick, thick), (p.neck, p.link_thickness))
    for x in (-16, 16):
        part -= disc(p.eye_diameter / 2, p.link_thickness, (x, 0))
    return part
