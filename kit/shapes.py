"""Shapes that several parts use."""

from __future__ import annotations

import math
from collections.abc import Iterable

from build123d import Align, Box, Cylinder, Polyline, Pos, Rot, extrude, make_face
from build123d.topology import Part

Point = tuple[float, float]


def disc(radius: float, height: float, at: Point = (0, 0), z: float = 0.0) -> Part:
    """Return a cylinder that stands at a point."""
    return Pos(*at, z) * Cylinder(radius, height, align=(Align.CENTER, Align.CENTER, Align.MIN))


def block(x: Point, y: Point, z: Point) -> Part:
    """Return a block between two bounds along each axis."""
    corner = Box(x[1] - x[0], y[1] - y[0], z[1] - z[0], align=(Align.MIN, Align.MIN, Align.MIN))
    return Pos(x[0], y[0], z[0]) * corner


def prism(corners: Iterable[Point], height: float, z: float = 0.0) -> Part:
    """Return an upright prism over a polygon."""
    return Pos(0, 0, z) * extrude(make_face(Polyline(*corners, close=True)), height)


def around(count: int, radius: float, turn: float = 0.0) -> list[Point]:
    """Return points on a circle, `turn` in degrees."""
    angles = [math.radians(turn + 360 * k / count) for k in range(count)]
    return [(radius * math.cos(a), radius * math.sin(a)) for a in angles]


def turned(part: Part, degrees: float, about: Point = (0, 0)) -> Part:
    """Return a part turned about an upright axis."""
    x, y = about
    return Pos(x, y) * Rot(0, 0, degrees) * Pos(-x, -y) * part
