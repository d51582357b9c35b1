"""Scripts of motion: waypoints, one after another, and a little sway."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import ScenarioError
from tensionlab.files.reading import brief
from tensionlab.haptics.effects.parameters import Frequency, Parameters, Point, Time


@dataclass(frozen=True)
class Waypoint(Parameters):
    """Position in m at a time in s since the start."""

    refusal = ScenarioError

    time: Time
    position: Point


@dataclass(frozen=True)
class Sway(Parameters):
    """Small motion to and fro: amplitudes in m, one an axis, and a frequency in Hz."""

    refusal = ScenarioError

    amplitude: Point
    frequency: Frequency = 0.4


@dataclass(frozen=True)
class Script:
    """Motion through at least one waypoint, in order of time, plus a sway if there is one.

    Between waypoints it has minimum jerk (Flash and Hogan 1985, "The coordination of arm movements"), from rest to
    rest; it stays where it is before the first and after the last.
    """

    waypoints: tuple[Waypoint, ...]
    sway: Sway | None = None

    def __post_init__(self) -> None:
        if not self.waypoints:
            raise ScenarioError("a script has no waypoints; give at least one")
        times = [waypoint.time for waypoint in self.waypoints]
        positions = [waypoint.position for waypoint in self.waypoints]
        if (np.diff(times) <= 0.0).any():
            raise ScenarioError(f"the waypoints' times are {brief(times)}; give each later than the last")
        sizes = {len(position) for position in positions} | ({len(self.sway.amplitude)} if self.sway else set())
        if len(sizes) > 1:
            raise ScenarioError(
                f"the waypoints are {brief(positions)}; give all the same number of coordinates, and the sway too"
            )

    def position(self, time: float) -> Floats:
        """Return the position in m at a time in s."""
        first, last = self.waypoints[0], self.waypoints[-1]
        position = np.array(first.position if time < first.time else last.position, dtype=np.float64)
        for start, end in zip(self.waypoints, self.waypoints[1:], strict=False):
            if start.time <= time < end.time:
                share = (time - start.time) / (end.time - start.time)
                way = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
                position = (1.0 - way) * np.array(start.position) + way * np.array(end.position)
        if self.sway is not None:
            # The axes are out of step, so that it goes round rather than along a line; it begins where it rests.
            phases = 2.0 * math.pi * self.sway.frequency * time * np.array([1.0, 0.83, 1.21])[: position.size]
            position = position + np.array(self.sway.amplitude) * np.sin(phases)
        return position
