"""Settings of a run, and the clocks that it may go by."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

from tensionlab.allocation import Nearest
from tensionlab.errors import HardwareError
from tensionlab.hardware.simulation.world import World

OnLoss = Literal["stop", "continue"]
ON_LOSS: tuple[OnLoss, ...] = get_args(OnLoss)
"""What to do when a module drops out: end the run, or go on with the others."""
SHORTEST_TTL, LONGEST_TTL = 0.05, 2.0
"""What modules take, in s."""
DUE_IN_TTL = 2
"""Set-points that must be due in the life of one."""
FASTEST = 10_000.0
"""Cycles a second that nothing needs more of."""
SHORTEST_TELEMETRY = 5
"""Period of telemetry that modules take at least, in ms."""


@dataclass(frozen=True)
class RunSettings:
    """How does a run go?

    Attributes
    ----------
    rate : float
        Cycles a second.
    ttl : float
        How long a set-point lives in a module, in s; a module that is silent for longer is lost.
    on_loss : {"stop", "continue"}
        What happens when a module has a fault, refuses a set-point, falls silent or is gone: all stop, or the
        others go on without it.
    nearest : str or None
        What to render out of reach; the solver's own if None.

    Raises
    ------
    HardwareError
        Naming the setting.
    """

    rate: float = 50.0
    ttl: float = 0.25
    on_loss: OnLoss = "stop"
    nearest: Nearest | None = None

    def __post_init__(self) -> None:
        if not SHORTEST_TTL <= self.ttl <= LONGEST_TTL:
            raise HardwareError(f"ttl is from {SHORTEST_TTL:g} to {LONGEST_TTL:g} s; got {self.ttl:g}")
        slowest = DUE_IN_TTL / self.ttl
        if not slowest <= self.rate <= FASTEST:
            raise HardwareError(
                f"rate is from {slowest:g} Hz, which is {DUE_IN_TTL} set-points in a ttl of {self.ttl:g} s, "
                f"to {FASTEST:g} Hz; got {self.rate:g}"
            )
        if self.on_loss not in ON_LOSS:
            raise HardwareError(f"on_loss is {self.on_loss!r}; give one of {', '.join(ON_LOSS)}")

    @property
    def ttl_ms(self) -> int:
        """The same in ms."""
        return round(1e3 * self.ttl)

    @property
    def telemetry_ms(self) -> int:
        """Period of the telemetry, in ms: that of the cycles, where modules go along."""
        return max(SHORTEST_TELEMETRY, round(1e3 / self.rate))


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
