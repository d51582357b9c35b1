"""How a run goes: how often, and what it does when something is wrong."""

from __future__ import annotations

from dataclasses import dataclass

from tensionlab.allocation import Nearest
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.module_monitor import ON_LOSS, OnLoss

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
