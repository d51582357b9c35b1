"""Bought parts as far as printed ones must keep clear of them."""

from __future__ import annotations

from build123d import Cylinder, Pos, Rot
from build123d.topology import Part

from kit import parameters as p
from kit.bracket import SERVO_BEGIN, SERVO_MIDDLE
from kit.shapes import block, disc, turned


def motor() -> Part:
    """Return the motor."""
    return disc(p.motor_diameter / 2, p.motor_height, z=p.motor_base) - disc(
        p.motor_bore / 2, p.motor_height, z=p.motor_base
    )


def encoder() -> Part:
    """Return the encoder's board with its chip."""
    half = p.encoder_board / 2
    board = block((-half, half), (-half, half), (-1.6, 0))
    return board + block((-2.5, 2.5), (-3.2, 3.2), (0, p.encoder_chip))


def magnet() -> Part:
    """Return the encoder's magnet."""
    return disc(p.magnet_diameter / 2, p.magnet_height, z=p.magnet_face)


def pin() -> Part:
    """Return the pawl's pin, from the bracket's underside to above the pawl."""
    return disc(p.pin_diameter / 2, p.motor_top + 2.0, (p.pin_x, p.pin_y))


def servo() -> Part:
    """Return the servo without its horn."""
    ears, half = p.bracket_thickness + p.servo_pedestal, p.servo_width / 2
    bottom = ears - p.servo_ear_height
    y = (p.shaft_y - half, p.shaft_y + half)
    part = block((SERVO_BEGIN, SERVO_BEGIN + p.servo_length), y, (bottom, bottom + p.servo_height))
    part += block((SERVO_MIDDLE - p.servo_ears / 2, SERVO_MIDDLE + p.servo_ears / 2), y, (ears, ears + 2.0))
    return part + disc(3.0, p.horn_base - bottom, (p.shaft_x, p.shaft_y), bottom)


def horn(angle: float) -> Part:
    """Return the servo's horn, pointing to an angle in degrees."""
    at, half = (p.shaft_x, p.shaft_y), p.horn_width / 2
    part = disc(3.5, p.horn_thickness, at, p.horn_base)
    end = (p.shaft_x + p.horn_radius, p.shaft_y)
    part += disc(half, p.horn_thickness, end, p.horn_base)
    top = p.horn_base + p.horn_thickness
    part += block((at[0], end[0]), (p.shaft_y - half, p.shaft_y + half), (p.horn_base, top))
    return turned(part, angle, at)


def cable() -> Part:
    """Return the cable from the spool through the guide, outside by 25 mm."""
    length = p.right + 25.0
    strand = Cylinder(p.cable_diameter / 2, length)
    return Pos(length / 2, -p.spool_radius, p.cable_height) * Rot(0, 90, 0) * strand
