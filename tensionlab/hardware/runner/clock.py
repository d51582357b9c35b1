"""When is the next cycle? By the time of day, or as fast as simulated modules can go."""

from __future__ import annotations

import time
from typing import Protocol

from tensionlab.hardware.simulation.world import World


class Clock(Protocol):
    """Time of a run, in s, from any start; it only goes forward.

    Attributes
    ----------
    real_time : bool
        Whether it goes on while a cycle lasts; optional, False if left out.
    """

    def now(self) -> float:
        """What time is it?"""

    def wait_until(self, when: float) -> None:
        """Come back at that time, or at once if it has been."""


class RealClock:
    """The system's own monotonic time, which nobody sets."""

    real_time = True

    def now(self) -> float:
        """What time is it?"""
        return time.monotonic()

    def wait_until(self, when: float) -> None:
        """Sleep."""
        left = when - time.monotonic()
        if left > 0.0:
            time.sleep(left)


class WorldClock:
    """The time of simulated modules, which passes while somebody waits.

    Parameters
    ----------
    world : World
        Whose time it is.
    paced : bool
        Whether it is real time.
    """

    def __init__(self, world: World, *, paced: bool = False) -> None:
        self._world = world
        self._paced = self.real_time = paced
        self._start = time.monotonic() - world.time

    def now(self) -> float:
        """What time is it?"""
        return time.monotonic() - self._start if self._paced else self._world.time

    def wait_until(self, when: float) -> None:
        """Let it pass in the modules."""
        if self._paced:
            time.sleep(max(when - self.now(), 0.0))
            when = self.now()
        self._world.advance(max(when - self._world.time, 0.0))
