"""Maps of a scenario's coordinates into a rig's: moved, turned and scaled."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import ScenarioError
from tensionlab.haptics.effects import Box, Sphere
from tensionlab.haptics.effects.parameters import vectors
from tensionlab.scenarios.person import PersonPlan, Script
from tensionlab.support.arrays import Floats


@dataclass(frozen=True, eq=False)
class Similarity:
    """Map of points, ``at + scale rotation (p - start)``."""

    rotation: Floats  # (d, d)
    start: Floats  # (d,), in m
    at: Floats  # (d,), in m
    scale: float = 1.0

    def point(self, point: ArrayLike) -> tuple[float, ...]:
        """Return where a point comes to."""
        placed = self.at + self.scale * self.rotation @ (np.array(point) - self.start)
        return tuple((placed.round(12) + 0.0).tolist())

    def direction(self, direction: ArrayLike) -> tuple[float, ...]:
        """Return a direction, turned."""
        return tuple((np.round(self.rotation @ np.array(direction), 12) + 0.0).tolist())

    def script(self, script: Script) -> Script:
        """Return a motion, its path scaled and its sway not."""
        waypoints = tuple(
            replace(waypoint, position=self.point(waypoint.position)) for waypoint in script.waypoints
        )
        sway = script.sway
        if sway is not None:
            sway = replace(sway, amplitude=tuple(np.sqrt(self.rotation**2 @ np.square(sway.amplitude)).tolist()))
        return replace(script, waypoints=waypoints, sway=sway)

    def surfaces(self, part: Any, name: str) -> Any:
        """Return an effect or a brake target with its points, directions and solids placed."""
        known, axes, placed = vectors(type(part)), np.abs(self.rotation), {}
        for field in fields(part):
            value = getattr(part, field.name)
            if isinstance(part, Box) and field.name == "size":
                if not np.allclose(axes, axes.round()):
                    raise ScenarioError(f'effect "{name}" has a box along the axes; face along one of them')
                placed["size"] = tuple((self.scale * axes.round() @ np.array(value)).tolist())
            elif isinstance(part, Sphere) and field.name == "radius":
                placed["radius"] = self.scale * value
            elif field.name in known:
                placed[field.name] = self.direction(value) if known[field.name].oriented else self.point(value)
            elif is_dataclass(value):
                placed[field.name] = self.surfaces(value, name)
        return replace(part, **placed) if placed else part

    def person(self, person: PersonPlan) -> PersonPlan:
        """Return a person who moves and turns as a whole, and whose paths are scaled, each from its start."""
        rigid, bodies = replace(self, scale=1.0), {}
        for name, script in person.bodies.items():
            start = script.waypoints[0].position
            bodies[name] = replace(self, start=np.array(start), at=np.array(rigid.point(start))).script(script)
        return replace(person, script=self.script(person.script), bodies=bodies)
