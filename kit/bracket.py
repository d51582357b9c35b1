"""Bracket: carries motor, encoder, pawl and servo. Printed on its flat side; the pin goes through it."""

from __future__ import annotations

from build123d.topology import Part

from kit import parameters as p
from kit.shapes import Point, around, block, disc

CORNERS: list[Point] = [
    (x, y) for x in (p.left + p.corner, p.right - p.corner) for y in (p.front + p.corner, p.back - p.corner)
]
SERVO_BEGIN = p.shaft_x - p.servo_shaft  # along x
SERVO_MIDDLE = SERVO_BEGIN + p.servo_length / 2


def bracket() -> Part:
    """Return the bracket where it is assembled."""
    top, bore = p.bracket_thickness, p.magnet_diameter / 2 + 2.5
    part = block((p.left, p.right), (p.front, p.back), (0, top))
    part += disc(p.stator_hole_circle / 2 + 5.0, p.motor_base)
    part += disc(p.boss_diameter / 2, p.ratchet_base, (p.pin_x, p.pin_y))
    part += disc(2.5, p.ratchet_base + p.ratchet_width / 2 - top, p.spring_post, top)
    half = p.servo_width / 2
    for x in (SERVO_MIDDLE - p.servo_ears / 2, SERVO_MIDDLE + p.servo_ears / 2):
        ends = sorted((x, SERVO_MIDDLE + (1 if x > SERVO_MIDDLE else -1) * (p.servo_length / 2 + p.clearance)))
        part += block((ends[0], ends[1]), (p.shaft_y - half, p.shaft_y + half), (top, top + p.servo_pedestal))
    for x in (SERVO_MIDDLE - p.servo_hole_pitch / 2, SERVO_MIDDLE + p.servo_hole_pitch / 2):
        part -= disc(p.screw_m2 / 2, top + p.servo_pedestal, (x, p.shaft_y))
    part -= block(
        (SERVO_BEGIN - p.clearance, SERVO_BEGIN + p.servo_length + p.clearance),
        (p.shaft_y - half - p.clearance, p.shaft_y + half + p.clearance), (0, top),
    )  # fmt: skip
    part -= disc(bore, p.motor_base)
    for at in around(p.stator_screws, p.stator_hole_circle / 2):
        part -= disc(p.stator_hole / 2, p.motor_base, at)
        part -= disc(2.1, 2.5, at)  # heads above the encoder's board
    for at in around(4, p.encoder_hole_pitch / 2**0.5, 45.0):
        part -= disc(p.screw_m2 / 2, 6.0, at)
    part -= disc(p.pin_diameter / 2, p.ratchet_base, (p.pin_x, p.pin_y))
    part -= disc(p.screw_m2 / 2, 6.0, p.spring_post, p.ratchet_base + p.ratchet_width / 2 - 6.0)
    for at in CORNERS:
        part -= disc(p.through_m3 / 2, top, at)
    return part - disc(4.0, top, (p.left + 12.0, 0.0))  # wires of motor and servo
