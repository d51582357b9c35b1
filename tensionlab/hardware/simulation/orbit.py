"""How long are the cables of a rig while its point goes round?"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError
from tensionlab.model.rig import Rig


def position(rig: Rig, radius: float, period: float, now: float) -> Floats:
    """Where is the point at a time, in m? On a circle around the rig's home, across the axis that points up."""
    first, second = [axis for axis in range(3) if rig.dimension == 2 or "xyz"[axis] != rig.vertical][:2]
    angle = 2.0 * math.pi * now / period
    place: Floats = rig.home.copy()
    place[first] += radius * math.cos(angle)
    place[second] += radius * math.sin(angle)
    return place


def cable_lengths(rig: Rig, radius: float, period: float) -> dict[str, Callable[[], float]]:
    """How long is each cable now, by the time of day? So all processes of one machine agree.

    Parameters
    ----------
    rig : Rig
    radius, period : float
        Of the circle in m, and of one turn in s.

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
