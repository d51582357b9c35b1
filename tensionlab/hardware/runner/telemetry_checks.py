"""Checks of what a module reports: numbers that cannot be, faults that it does not act on, a loop that is late."""

from __future__ import annotations

import math

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import LinkTimeout, ModuleFault
from tensionlab.hardware.client.connection import CLOCK_WRAP, Received
from tensionlab.hardware.protocol.codes import Code, Fault
from tensionlab.hardware.protocol.messages import Telemetry

NUMBERS = {
    "length": "m",
    "speed": "m/s",
    "tension": "N",
    "current": "A",
    "supply": "V",
    "thermal": "of the budget",
}
"""Numbers of a telemetry that must be finite, and their units."""
JUMP_M = 0.05
"""A length may differ by so much, in m, from where the cable's speeds take it."""
MAX_ACCELERATION = 100.0
"""Of a cable, in m/s²: a hand makes 30, and a spool by itself, with 6 N on 0.03 kg, not more than twice this."""


def require_plausible(name: str, before: Received[Telemetry] | None, heard: Received[Telemetry]) -> None:
    """Refuse telemetry that cannot be true, by a `ModuleFault` that names the module, what it is, and the value.

    Parameters
    ----------
    name : str
        Of the module.
    before, heard : Received of Telemetry
        Two that came one after the other, of a module that follows set-points.
    """
    now = heard.message
    for field, unit in NUMBERS.items():
        value = getattr(now, field)
        if not math.isfinite(value):
            raise ModuleFault(
                f'module "{name}" reports a {field} of {value} {unit}: its firmware or its link is broken',
                name,
                Code.BAD_VALUE,
            )
    if now.faults:
        raise ModuleFault(
            f'module "{name}" reports a fault ({now.faults.name or int(now.faults)}) and goes on pulling '
            f"({now.state.name}); update its firmware, it must let go",
            name,
            now.faults,
        )
    if before is None:
        return
    said = before.message
    # By the slower clock: that of a simulated module stands still while its computer gives it no time.
    seconds = max(1e-6 * ((now.time_us - said.time_us) % CLOCK_WRAP), heard.time - before.time)
    expected = said.length + 0.5 * (said.speed + now.speed) * seconds
    jump = now.length - expected
    if abs(jump) > JUMP_M + 0.25 * MAX_ACCELERATION * seconds**2:
        raise ModuleFault(
            f'module "{name}" reports a length of {now.length:.3f} m, {1e3 * abs(jump):.0f} mm '
            f"{'more' if jump > 0.0 else 'less'} than its speed explains in {1e3 * seconds:.0f} ms; look at its "
            "encoder, and calibrate its length",
            name,
            Fault.ENCODER,
        )


class LoopChecks:
    """Are set-points followed, and is that reported, before they are older than they may get?

    Parameters
    ----------
    names : list of str
        Of the modules.
    ttl : float
        Time to live of set-points, in s. A loop that is later for as long is refused.
    """

    def __init__(self, names: list[str], ttl: float) -> None:
        self._names, self._ttl = names, ttl
        self._late_since = np.full(len(names), np.nan)

    def update(self, delays: Floats, now: float) -> None:
        """Note how old the newest set-points are, (m,) in s, that modules are known to follow, at a time in s."""
        self._late_since = np.where(delays > self._ttl, np.fmin(self._late_since, now), np.nan)
        self._delays, self._now = delays, now

    def require_prompt(self, index: int) -> None:
        """Refuse, by a `LinkTimeout`, a module whose loop has been late for too long."""
        if self._now - self._late_since[index] > self._ttl:
            raise LinkTimeout(
                f'module "{self._names[index]}" is late: the newest set-point that it reports to follow was sent '
                f"{self._delays[index]:.2f} s ago, and lives {self._ttl:g} s; its link is slow or crowded"
            )
