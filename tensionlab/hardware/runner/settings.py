"""Settings of a run, and the clocks that it may go by."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

from tensionlab.allocation import Policy
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.simulation.world import World
from tensionlab.support.operating_system import usable_processors

OnLoss = Literal["stop", "continue"]  # reaction to a lost module: end the run, or continue with the others
MIN_TTL_S, MAX_TTL_S = 0.05, 2.0  # range that modules accept
SET_POINTS_PER_TTL = 2  # set-points that must be due within a time to live
MAX_RATE_HZ = 10_000.0
MIN_TELEMETRY_MS = 5  # shortest period of telemetry that modules accept


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run; a `HardwareError` names one that cannot work.

    Attributes
    ----------
    rate : float
        Cycles per second.
    ttl : float
        Time to live of a set-point in a module, in s; a module that is silent for longer is lost.
    on_loss : {"stop", "continue"}
        When a module is lost (fault, refused set-point, silence): stop all, or continue with the others.
    policy : str or None
        Policy for an infeasible wrench; the solver's own if None.
    rate_limited : bool
        Choose only tensions that the modules reach within a cycle, and from which they reach the next
        (`tensionlab.RateLimitedAllocator`), in place of the solver's.
    processor : int or None
        Processor that the thread of the run is bound to while modules are armed, with SCHED_FIFO and locked
        memory, as far as the system allows; the event "scheduling" says how far. None for an ordinary thread.
    """

    rate: float = 50.0
    ttl: float = 0.25
    on_loss: OnLoss = "stop"
    policy: Policy | None = None
    rate_limited: bool = False
    processor: int | None = None

    def __post_init__(self) -> None:
        if not MIN_TTL_S <= self.ttl <= MAX_TTL_S:
            raise HardwareError(f"ttl is from {MIN_TTL_S:g} to {MAX_TTL_S:g} s; got {self.ttl:g}")
        slowest = SET_POINTS_PER_TTL / self.ttl
        if not slowest <= self.rate <= MAX_RATE_HZ:
            raise HardwareError(
                f"rate is from {slowest:g} Hz, which is {SET_POINTS_PER_TTL} set-points in a ttl of "
                f"{self.ttl:g} s, to {MAX_RATE_HZ:g} Hz; got {self.rate:g}"
            )
        if self.on_loss not in (choices := get_args(OnLoss)):
            raise HardwareError(f"on_loss is {self.on_loss!r}; give one of {', '.join(choices)}")
        if self.processor is not None and self.processor not in (usable := usable_processors()):
            numbers = ", ".join(map(str, usable))
            raise HardwareError(f"this process may use the processors {numbers}; got {self.processor}")

    @property
    def ttl_ms(self) -> int:
        """Time to live in ms."""
        return round(1e3 * self.ttl)

    @property
    def telemetry_ms(self) -> int:
        """Period of the telemetry, in ms: that of the cycles, where modules accept it."""
        return max(MIN_TELEMETRY_MS, round(1e3 / self.rate))


class Clock(Protocol):
    """Time of a run, in s, from any start; it only goes forward.

    An attribute `real_time` that is true tells that time passes during a cycle, too.
    """

    def now(self) -> float:
        """Return the time."""

    def wait_until(self, when: float) -> None:
        """Return at that time, or at once if it has passed."""


class RealClock:
    """Monotonic clock of the system; simulated modules of this process advance while a run waits for it."""

    real_time = True

    def __init__(self, clients: Iterable[ModuleClient] = ()) -> None:
        self._simulated = [client for client in clients if client.link.lockstep]

    def now(self) -> float:
        """Return the time."""
        return time.perf_counter()

    def wait_until(self, when: float) -> None:
        """Sleep until that time."""
        remaining = max(when - time.perf_counter(), 0.0)
        ends = [client.link.clock() + remaining for client in self._simulated]
        if remaining > 0.0:
            time.sleep(remaining)
        for client, end in zip(self._simulated, ends, strict=True):
            client.listen(max(end - client.link.clock(), 0.0))


class WorldClock:
    """Clock of simulated modules, whose time passes while the run waits.

    If ``paced``, it is never ahead of real time, so that a run can be watched. On a slow computer time passes more
    slowly: the run equals, cycle by cycle, one that is not paced.
    """

    def __init__(self, world: World, *, paced: bool = False) -> None:
        self._world, self.real_time = world, paced
        self._start = time.perf_counter() - world.time

    def now(self) -> float:
        """Return the time."""
        return self._world.time

    def wait_until(self, when: float) -> None:
        """Let simulated time pass until then, and real time as well if the clock is paced."""
        if self.real_time:
            remaining = when - (time.perf_counter() - self._start)
            if remaining > 0.0:
                time.sleep(remaining)
            else:
                self._start -= remaining
        self._world.advance(max(when - self._world.time, 0.0))
