"""Telemetry of all modules in a cycle: what they report, how old it is, and whether it can be true."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tensionlab.arrays import Floats, Integers
from tensionlab.errors import LinkTimeout, ModuleFault
from tensionlab.hardware.client.connection import CLOCK_WRAP_US, Received
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.codes import Code, Fault, Limit, State
from tensionlab.hardware.protocol.messages import Telemetry


class Observation(NamedTuple):
    """The latest telemetry of all modules; fields as in `RigState`."""

    lengths: Floats
    speeds: Floats
    tensions: Floats
    ages: Floats
    states: Integers
    faults: Integers
    limiters: Integers
    brakes: Integers
    last_sequence: Integers
    thermal: Floats


NAN = float("nan")
SILENT = (NAN, NAN, NAN, float("inf"), State.IDLE, 0, Limit.IDLE, -1, -1, NAN)
"""What is known of a module that has said nothing yet."""


def observe(group: ModuleGroup) -> Observation:
    """Read what has come by now."""
    rows: list[tuple[float, ...]] = []
    for client in group.clients:
        client.listen()
        heard = client.telemetry
        if heard is None:
            rows.append(SILENT)
            continue
        said = heard.message
        age = client.link.clock() - heard.time
        state = said.state if client.state is None else client.state
        codes = (state, client.faults, said.limit, said.brake, said.sequence)
        rows.append((said.length, said.speed, said.tension, age, *codes, said.thermal))
    lengths, speeds, tensions, ages, *numbers, thermal = np.array(rows).T
    states, faults, limiters, brakes, last_sequence = np.array(numbers, dtype=np.int64)
    return Observation(lengths, speeds, tensions, ages, states, faults, limiters, brakes, last_sequence, thermal)


SEQUENCE_NUMBERS = 256
"""Sequence numbers of set-points; then they begin anew."""
KEPT_S = 5.0
"""So far back are times of set-points kept, in s."""


class SetPointDelays:
    """Times at which set-points were sent, by their numbers.

    A number stands for many set-points at high rates. Which one it is follows from how many were sent since the
    last report; of the first one that is reported, the newest is taken.

    Parameters
    ----------
    count : int
        Of modules, m.
    rate : float
        Set-points a second.
    """

    def __init__(self, count: int, rate: float) -> None:
        self._kept = SEQUENCE_NUMBERS * math.ceil(KEPT_S * rate / SEQUENCE_NUMBERS)
        self._times = np.full((self._kept, count), np.nan)
        self._indices = np.arange(count)
        self._sent: Integers = np.full(
            count, -1, dtype=np.int64
        )  # the latest, counted through; -1 before the first
        self._first = np.full(count, np.nan)  # when that was, in s
        self._own: Integers = np.zeros(count, dtype=np.int64)  # the first one
        self._followed: Integers = np.full(count, -1, dtype=np.int64)
        self._sent_then: Integers = np.zeros(count, dtype=np.int64)  # the latest when `_followed` changed

    def send(self, sequences: Integers, now: float) -> None:
        """Note numbers (m,) of set-points that were sent at a time in s; -1 where none was."""
        new = sequences >= 0
        first = new & (self._sent < 0)
        self._own[first] = sequences[first] + SEQUENCE_NUMBERS
        self._first[first] = now
        following = self._sent + (sequences - self._sent) % SEQUENCE_NUMBERS
        self._sent = np.where(first, self._own, np.where(new, following, self._sent))
        self._times[self._sent[new] % self._kept, self._indices[new]] = now

    def delays(self, last_sequence: Integers, now: float) -> tuple[Floats, Floats]:
        """Return how old the set-points are that modules report to follow, by their numbers (m,); -1: none yet.

        Returns
        -------
        (m,) array
            In s; NaN where a module has not reported to follow one of these.
        (m,) array
            The same; there, the time since the first was sent.
        """
        newest = self._sent - (self._sent - last_sequence) % SEQUENCE_NUMBERS
        step = (last_sequence - self._followed) % SEQUENCE_NUMBERS
        step = step + SEQUENCE_NUMBERS * np.rint((self._sent - self._sent_then - step) / SEQUENCE_NUMBERS).astype(
            np.int64
        )
        likely = np.minimum(self._followed + np.maximum(step, 0), newest)
        known = (last_sequence >= 0) & (newest >= self._own) & (self._sent >= 0)
        found = np.where(known, np.where(self._followed >= self._own, likely, newest), self._followed)
        self._sent_then = np.where(found != self._followed, self._sent, self._sent_then)
        self._followed = found
        ages = np.where(known, now - self._times[found % self._kept, self._indices], np.nan)
        return ages, np.where(known, ages, now - self._first)


TELEMETRY_UNITS = {
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
    for field, unit in TELEMETRY_UNITS.items():
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
    seconds = max(1e-6 * ((now.time_us - said.time_us) % CLOCK_WRAP_US), heard.time - before.time)
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
