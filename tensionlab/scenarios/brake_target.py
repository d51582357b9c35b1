"""What are brakes to hold against: a flat wall, or the end of a reach?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import ScenarioError
from tensionlab.haptics.brakes.contact import TIMING, ImpactCap, Timing, Wall
from tensionlab.haptics.effects import Plane
from tensionlab.haptics.effects.effect import norm, normalized
from tensionlab.haptics.effects.parameters import Length, PositiveForce, require_parameters


@dataclass(frozen=True)
class Hold:
    """Where is it that brakes stop the hand or the head, and how hard?

    Parameters
    ----------
    force : float
        What they should hold, in N.
    plane : Plane or None
        A wall; its normal is towards the free side.
    reach : float or None
        In place of a wall: so far, in m, from the origin of what the effects are seen from.
    cap : ImpactCap or None
        For what must not be hurt.
    timing : Timing
        Of the brakes by themselves; the delay of the loop comes on top.
    """

    force: PositiveForce
    plane: Plane | None = None
    reach: Length | None = None
    cap: ImpactCap | None = None
    timing: Timing = TIMING

    def __post_init__(self) -> None:
        require_parameters(self, ScenarioError)
        if (self.plane is None) == (self.reach is None):
            raise ScenarioError("a hold has a plane or a reach: give one of them")

    def wall(self, position: Floats) -> Wall:
        """Where is the wall, as seen from a position (d,)?"""
        if self.plane is not None:
            return Wall(self.plane.n, float(self.plane.height(position)), self.force)
        assert self.reach is not None
        inward = -normalized(position) if position.any() else np.eye(position.size)[0]
        return Wall(inward, self.reach - float(norm(position)), self.force)

    def late_by(self, delay: float) -> Timing:
        """When must brakes lock over a loop that is so late, in s?"""
        return replace(self.timing, latency=self.timing.latency + delay)
