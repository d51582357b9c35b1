"""Motions of a simulated platform: a hand that follows a target, and an orbit."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.demand import Pose
from tensionlab.errors import HardwareError
from tensionlab.model.pose import frame_of
from tensionlab.model.rig import Rig

NEARING = 20.0
"""In 1/s: close to where it is to be, a hand is so many times as fast as it is far."""
FASTEST = 1.5
"""In m/s; modules let the cable in and out at 2 m/s."""
MAX_ACCELERATION = 10.0
"""In m/s²: at twice that, with a body that moves as well, modules still keep their cables taut."""
TINY = 1e-12
"""A distance in m that is none."""
LONGEST = 0.01
"""Time of one step of the integration, in s, at most."""


class GuidedHand:
    """Hand that follows a pose without overshoot: positions of hand and body frames; rotations at once.

    Parameters
    ----------
    guide : callable
        Returns the target pose at a time in s; the hand starts there.
    """

    def __init__(self, guide: Callable[[float], Pose]) -> None:
        self._guide = guide
        self._places: dict[str, tuple[Floats, Floats]] = {}
        self._time = 0.0

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time, which must not go back."""
        wanted = self._guide(time)
        step, self._time = time - self._time, time
        position = self._follow("", wanted.position, step)
        frames = {}
        for name, where in (wanted.frames or {}).items():
            place, rotation = frame_of(where)
            frames[name] = (self._follow(name, np.asarray(place, dtype=np.float64), step), rotation)
        return Pose(position, wanted.rotation, frames)

    def _follow(self, name: str, wanted: Floats, seconds: float) -> Floats:
        place, velocity = self._places.get(name, (wanted, np.zeros_like(wanted)))
        while seconds > 0.0:
            step = min(seconds, LONGEST)
            gap = wanted - place
            far = float(np.linalg.norm(gap))
            speed = min(FASTEST, math.sqrt(MAX_ACCELERATION * far), NEARING * far)  # so that it can brake in time
            change = gap * (speed / max(far, TINY)) - velocity
            most = MAX_ACCELERATION * step
            velocity = velocity + change * (most / max(float(np.linalg.norm(change)), most))
            place = place + step * velocity
            seconds -= step
        self._places[name] = (place, velocity)
        return place


def position(rig: Rig, radius: float, period: float, now: float) -> Floats:
    """Return the point at a time, in m: on a circle around the rig's home, across the axis that points up."""
    first, second = [axis for axis in range(3) if rig.dimension == 2 or "xyz"[axis] != rig.vertical][:2]
    angle = 2.0 * math.pi * now / period
    place: Floats = rig.home.copy()
    place[first] += radius * math.cos(angle)
    place[second] += radius * math.sin(angle)
    return place


def cable_lengths(rig: Rig, radius: float, period: float) -> dict[str, Callable[[], float]]:
    """Return functions for the lengths of the cables now, by the time of day, so that processes agree.

    The circle has a radius in m, and one turn a period in s.

    Raises
    ------
    HardwareError
        For a circle that cannot be.
    """
    if not (0.0 <= radius < math.inf and 0.0 < period < math.inf):
        raise HardwareError(f"an orbit has a radius of 0 m or more and a period above 0 s; got {radius}, {period}")

    def length(index: int) -> float:
        where = position(rig, radius, period, time.time())
        return float(np.asarray(rig.lengths(where, frames=rig.at_rest))[index])

    return {module.name: partial(length, index) for index, module in enumerate(rig.modules)}
