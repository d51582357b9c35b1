"""One-way brake: a ratchet around the motor, screwed under the spool, and the pawl that holds it.

Seen from above, the cable pays out as the wheel turns counter-clockwise. The pawl stands at -y, on the side of
the cable, so that its push opposes the cable's pull. Printed flat: the teeth lie in the layers.
"""

from __future__ import annotations

import math

from build123d.topology import Part

from kit import parameters as p
from kit.shapes import Point, around, disc, prism, turned

PITCH = 2 * math.pi / p.teeth
UNDERCUT = p.tooth_height * math.tan(math.radians(p.tooth_undercut)) / p.root_radius  # angle of a face
AT_PAWL = -math.pi / 2  # where the tooth that the pawl holds has its tip
PIN = (p.pin_x, p.pin_y)


def polar(radius: float, angle: float) -> Point:
    """Return a point by its radius and angle in rad."""
    return radius * math.cos(angle), radius * math.sin(angle)


def ratchet(turn: float = 0.0) -> Part:
    """Return the ratchet where it is assembled, turned by degrees."""
    corners: list[Point] = []  # a slope leads up to each tip, and a face falls back below it
    for tip in (AT_PAWL + k * PITCH for k in range(p.teeth)):
        corners += [polar(p.tip_radius, tip), polar(p.root_radius, tip - UNDERCUT)]
    part = prism(corners, p.ratchet_width, p.ratchet_base)
    part -= disc(p.ratchet_inside, p.ratchet_width, z=p.ratchet_base)
    for at in around(p.ratchet_screws, p.ratchet_screw_radius):
        part -= disc(p.screw_m2 / 2, 8.0, at, p.motor_top - 8.0)
    return turned(part, turn)


def pawl(lift: float = 0.0) -> Part:
    """Return the pawl laid on the ratchet, or lifted by degrees."""
    z, height = p.ratchet_base + p.clearance, p.ratchet_width - 2 * p.clearance
    (rx, ry), (tx, ty) = polar(p.root_radius, AT_PAWL - UNDERCUT), polar(p.tip_radius, AT_PAWL)

    def on_face(part: float) -> Point:
        return rx + part * (tx - rx), ry + part * (ty - ry)

    end, outside, half = on_face(1 - p.pawl_depth), on_face(1.8), p.pawl_height / 2
    x, y = PIN
    # Its back is steeper than the slope behind it, so that it reaches the root.
    back = (p.pawl_tooth, -p.tip_radius - p.clearance)
    arm = [end, outside, (outside[0] + 2.0, y - half), (x, y - half), (x, y + half), (x - 8.0, y + half), back]
    tail = [(x, y - half), (p.spring_x + 2.5, y - half), (p.spring_x + 2.5, y + 1.0), (x, y + half)]
    part = prism(arm, height, z) + prism(tail, height, z) + disc(p.boss_diameter / 2, height, PIN, z)
    part -= disc((p.pin_diameter + p.clearance) / 2, height, PIN, z)
    part -= disc(0.8, height, (p.spring_x, y - 1.25), z)
    return turned(part, lift, PIN)
