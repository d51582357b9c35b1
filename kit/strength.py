"""What the brake's parts bear at 186 N in the cable, by the formulas of beams: ``python -m kit.strength``.

Forces in N, lengths in mm, stresses in MPa. One tooth bears all, and each tooth is loaded at its tip, as if only
an edge touched. Steel yields at 235 MPa.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from kit import parameters as p

SHEAR_OF_TENSION = 1 / math.sqrt(3)  # von Mises


class Load(NamedTuple):
    """A place that could break, its stress and the material's strength there, in MPa."""

    where: str
    stress: float
    strength: float

    @property
    def factor(self) -> float:
        """Return how many times the load the place bears."""
        return self.strength / self.stress


def tooth_force(cable: float = p.brake_strength_n) -> float:
    """Return the force on a tooth, at the root's radius, where it is largest, from the force in the cable."""
    return cable * p.spool_radius / p.root_radius


def bearing_load(cable: float) -> float:
    """Return the force on the motor's upper bearing, the larger one, while the brake holds the cable.

    The pawl's push opposes the cable's pull, but below it, so that both tilt the rotor.
    """
    lower = p.motor_base + (p.motor_height - p.motor_bearings) / 2
    pawl_height = p.motor_top - p.ratchet_width / 2
    moment = cable * (p.cable_height - lower) - tooth_force(cable) * (pawl_height - lower)
    return moment / p.motor_bearings


def engagement_angle() -> float:
    """Return the angle in degrees from the line to its pin by which the force on the pawl points inwards."""
    return p.tooth_undercut + math.degrees(math.atan(p.pawl_offset / p.pawl_length))


def loads() -> list[Load]:
    """Return the places that could break."""
    force, width = tooth_force(), p.ratchet_width
    pawl_width = width - 2 * p.clearance
    tension, shear = p.printed_strength_mpa, p.printed_strength_mpa * SHEAR_OF_TENSION
    root = 2 * math.pi * p.root_radius / p.teeth
    reach = p.pawl_depth * p.tooth_height
    boss, pin = p.boss_diameter, p.pin_diameter
    # The boss is a tube across its layers, bent by the pawl's middle above the bracket.
    lever = p.motor_top - width / 2 - p.bracket_thickness
    tube = math.pi * (boss**4 - pin**4) / (32 * boss)
    # The arm is pressed along the line to the pin, which lies off its middle by the pawl's offset.
    arm = force / (p.pawl_height * pawl_width) + 6 * force * p.pawl_offset / (pawl_width * p.pawl_height**2)
    return [
        Load("ratchet tooth, bending", 6 * force * p.tooth_height / (width * root**2), tension),
        Load("ratchet tooth, shear", 1.5 * force / (width * root), shear),
        Load("pawl tooth, bending", 6 * force * reach / (pawl_width * p.pawl_tooth**2), tension),
        Load("pawl tooth, shear", 1.5 * force / (pawl_width * p.pawl_tooth), shear),
        Load("pawl arm, compression and bending", arm, tension),
        Load("pin in the pawl, bearing", force / (pin * pawl_width), tension),
        Load("boss of the pin, across layers", force * lever / tube, p.layer_strength_mpa),
        Load("pin, steel, bending", force * (width / 2 + pin / 2) / (math.pi * pin**3 / 32), 235.0),
        Load(
            "screws between spool and ratchet, bearing",
            p.brake_strength_n
            * p.spool_radius
            / p.ratchet_screw_radius
            / p.ratchet_screws
            / (2.0 * p.spool_floor / 2),
            tension,
        ),
    ]


def breakaway() -> tuple[float, float]:
    """Return between which forces the link's neck breaks: printed as weak as assumed, or as strong as its bulk."""
    area = p.neck**2
    return p.printed_strength_mpa * area, p.bulk_strength_mpa * area


def table() -> str:
    """Return the loads as a table in Markdown."""
    lines = ["| What could break at 186 N | Stress (MPa) | Strength (MPa) | Factor |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {each.where} | {each.stress:.1f} | {each.strength:.1f} | {each.factor:.1f} |" for each in loads()
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
    weakest, strongest = breakaway()
    print(f"\nbreakaway link: {weakest:.0f} to {strongest:.0f} N")
    for cable in (p.highest_tension_n, strongest, p.brake_strength_n):
        print(f"{cable:.0f} N in the cable: {bearing_load(cable):.0f} N on the motor's upper bearing")
