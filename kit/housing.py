"""Housing: a tub for the boards with mounts for a wall and for straps, and a cover over everything that turns."""

from __future__ import annotations

from build123d import Cylinder, Pos, Rot
from build123d.topology import Part

from kit import guide
from kit import parameters as p
from kit.bracket import CORNERS
from kit.shapes import block, disc

FLOOR = -p.electronics - p.wall


def shell(bottom: float, top: float, inside: tuple[float, float]) -> Part:
    """Return a box of the housing's outline with its posts, hollow between two heights."""
    outline = block((p.left, p.right), (p.front, p.back), (bottom, top))
    hollow = block((p.left + p.wall, p.right - p.wall), (p.front + p.wall, p.back - p.wall), inside)
    half = p.post / 2
    for x, y in CORNERS:
        hollow -= block((x - half, x + half), (y - half, y + half), (bottom, top))
    return outline - hollow


def tub() -> Part:
    """Return the tub, open above: straps go through the slots, wall screws through the holes of its ears."""
    part = shell(FLOOR, 0, (FLOOR + p.wall, 0))
    middle = (p.front + p.back) / 2
    for edge, way in ((p.left, -1), (p.right, 1)):
        x = sorted((edge, edge + way * p.ear))
        part += block((x[0], x[1]), (middle - 32.0, middle + 32.0), (FLOOR, FLOOR + 2 * p.wall))
        slot = sorted((edge + way * 6.0, edge + way * (6.0 + p.strap_slot)))
        half = p.strap_width / 2
        part -= block((slot[0], slot[1]), (middle - half, middle + half), (FLOOR, FLOOR + 2 * p.wall))
        for y in (middle - 24.0, middle + 24.0):
            part -= disc(2.25, 2 * p.wall, (edge + way * p.ear / 2, y), FLOOR)
    for at in CORNERS:
        part -= disc(p.screw_m3 / 2, 14.0, at, -14.0)
    # USB and the supply come in at the back.
    return part - Pos(0, p.back - p.wall / 2, FLOOR / 2) * Rot(90, 0, 0) * Cylinder(7.0, p.wall)


def cover() -> Part:
    """Return the cover: no finger reaches the spool or the teeth. Printed on its roof."""
    bottom = p.bracket_thickness
    top = p.spool_top + p.cover_gap + p.wall
    part = shell(bottom, top, (bottom, top - p.wall))
    for at in CORNERS:
        part -= disc(p.through_m3 / 2, top, at)
        part -= disc(3.4, top, at, bottom + 8.0)  # the screw and its driver
    part -= guide.AT * Pos(0, 0, -p.wall / 2) * Cylinder(guide.SNOUT + p.clearance, p.wall)
    for side in (-guide.SCREWS, guide.SCREWS):
        part -= guide.AT * Pos(0, side, -p.wall / 2) * Cylinder(p.through_m3 / 2, p.wall)
    return part
