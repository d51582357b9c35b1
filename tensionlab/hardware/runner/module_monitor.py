"""Monitor of the modules in a run: which take part, and whether what they report is fresh and plausible."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.demand import Demand
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import CLOCK_WRAP_US, ModuleClient, Received
from tensionlab.hardware.protocol.codes import FOLLOWING_STATES, Code, Fault, State
from tensionlab.hardware.protocol.messages import SetImpedance, Stop, Telemetry
from tensionlab.hardware.runner.guard import Derating
from tensionlab.hardware.runner.settings import OnLoss
from tensionlab.hardware.runner.state_estimation import Observation
from tensionlab.support.arrays import Floats, Integers

TELEMETRY_UNITS = {
    "length": "m",
    "speed": "m/s",
    "tension": "N",
    "current": "A",
    "supply": "V",
    "thermal": "of the budget",
}  # quantities of a telemetry that must be finite, and their units
MAX_LENGTH_JUMP_M = _native.MAX_LENGTH_JUMP_M  # tolerance of a length against the cable's own speeds
# Largest acceleration of a cable in m/s²: a hand reaches 30; a free spool (6 N on 0.03 kg) at most twice this.
MAX_ACCELERATION_M_S2 = _native.MAX_ACCELERATION_M_S2
STALL_SHARE = 0.75  # a cycle that comes later than this share of the time to live after the one before has stalled


class ModuleMonitor:
    """Monitor of the modules: checks each in every cycle, and sends set-points to those that take part.

    A module that is silent for `ttl` s, the time to live of set-points, is lost, and so is one that follows older
    ones for that long. `on_lost` is called with the index and the error of each; `active` (m,) has those that take
    part, and `complete` is whether all do. One that is lost does not come back.
    """

    def __init__(
        self, group: ModuleGroup, ttl: float, on_loss: OnLoss, on_lost: Callable[[int, HardwareError], None]
    ) -> None:
        self.active: NDArray[np.bool_] = np.ones(len(group.clients), dtype=bool)
        self.complete = True
        self._group, self._clients = group, group.clients
        self._ttl, self._on_loss, self._on_lost = ttl, on_loss, on_lost
        self._no_brakes = np.zeros(len(group.clients), dtype=bool)
        group.clear_checked()
        self._late_since = np.full(len(group.clients), np.nan)
        self._stall = Stall(ttl)

    def check(self, seen: Observation, delays: Floats, derating: Derating, now: float) -> None:
        """Check all modules by their latest telemetry and its age.

        `delays` (m,) are the ages of the newest set-points that modules report to follow, in s. A `HardwareError`
        if a module is lost and the run is to stop, or none is left.
        """
        self._stall.update(now)
        suspects = self._group.suspects(self.active, delays, self._ttl)
        if not suspects:
            self._late_since.fill(np.nan)
            return
        self._late_since = np.where(delays > self._ttl, np.fmin(self._late_since, now), np.nan)
        ages, thermal, late = seen.ages.tolist(), seen.thermal.tolist(), (now - self._late_since).tolist()
        for index in suspects:
            client = self._clients[index]
            try:
                self._require_healthy(client, ages[index])
                if not self._stall.seconds and late[index] > self._ttl:
                    raise LinkTimeout(
                        f'module "{client.name}" is late: the newest set-point that it reports to follow was '
                        f"sent {delays[index]:.2f} s ago, and lives {self._ttl:g} s; its link is slow or crowded"
                    )
                derating.require_holding(index, thermal[index])
            except HardwareError as error:
                self._lose(index, error)

    def _require_healthy(self, client: ModuleClient, age: float) -> None:
        try:
            require_following(client)
        except ModuleFault as fault:
            if fault.code is State.TIMEOUT and self._stall.seconds:
                raise ModuleFault(f"{fault}: {self._stall}", fault.module, fault.code) from None
            raise
        if (unchecked := client.unchecked()) is not None:
            require_plausible(client.name, *unchecked)
        if age <= self._ttl + self._stall.seconds:
            return
        if client.endpoint.repeated and client.telemetry is not None:
            why = (
                f"repeats what it said {age:.2f} s ago ({client.endpoint.repeated} times time_us "
                f"{client.telemetry.message.time_us}): its firmware or its link hangs; switch it off and on"
            )
        else:
            why = (
                f"has been silent for {age:.2f} s; has it power, is its link whole? A longer --ttl allows for more"
            )
        raise LinkTimeout(f'module "{client.name}" at {client.link.url} {why}')

    def send(self, tensions: Floats, demand: Demand, ttl_ms: int) -> Integers:
        """Send set-points to modules that take part; return their sequence numbers (m,), -1 where none was sent.

        Tensions are in N, NaN where an impedance is commanded.
        """
        brakes, chosen = self._no_brakes, self.active
        if demand.brakes:
            brakes = np.array([client.name in demand.brakes for client in self._clients])
        springs = [index for index, client in enumerate(self._clients) if client.name in demand.impedances]
        if springs:
            chosen = chosen.copy()
            chosen[springs] = False
        sequences, left, failed = self._group.send_tensions(tensions, chosen, brakes, ttl_ms)
        for index in [*left, *(index for index in springs if self.active[index])]:
            client, brake = self._clients[index], bool(brakes[index])
            try:
                if index in springs:
                    spring = vars(demand.impedances[client.name])
                    sequences[index] = client.set_impedance(SetImpedance(0, **spring, brake=brake, ttl_ms=ttl_ms))
                else:
                    sequences[index] = client.set_tension(float(tensions[index]), brake=brake, ttl_ms=ttl_ms)
            except LinkError as error:
                failed.append((index, error))
        for index, why in failed:
            self._lose(index, why)
        return sequences

    def _lose(self, index: int, error: HardwareError) -> None:
        self.active[index] = self.complete = False
        self._on_lost(index, error)
        if self._on_loss == "stop":
            raise error
        with suppress(HardwareError):
            self._clients[index].send(Stop())
        if not self.active.any():
            raise HardwareError(f"no module is left; the last one: {error}")


class Stall:
    """Cycle that came late, by a busy computer or a slow solver: what modules miss by it is not their fault.

    After a stall, modules have the time to live of set-points, `ttl` in s, to be heard again. `seconds` is the
    duration of the latest one; 0 if it was long ago, or there was none.
    """

    def __init__(self, ttl: float) -> None:
        self._ttl, self._before, self._until = ttl, math.inf, -math.inf
        self.seconds = 0.0

    def update(self, now: float) -> None:
        """Note the time of a cycle, in s."""
        gap = now - self._before
        self._before = now
        if gap > STALL_SHARE * self._ttl:
            self.seconds, self._until = gap, now + self._ttl
        elif now > self._until:
            self.seconds = 0.0

    def __str__(self) -> str:
        return (
            f"this computer took {self.seconds:.2f} s from one cycle to the next, and set-points live "
            f"{self._ttl:g} s; is it busy, or the solver slow?"
        )


def require_following(client: ModuleClient) -> None:
    """Refuse a module that has released, refused a set-point, was stopped from outside or restarted."""
    client.check()
    late = client.state is State.IDLE and not client.endpoint.followed  # what it was before
    if client.state not in FOLLOWING_STATES and not late:
        state = State.IDLE if client.state is None else client.state
        raise ModuleFault(
            f'module "{client.name}" is {state.name}: it was stopped from outside, or restarted',
            client.name,
            state,
        )


def require_plausible(name: str, before: Received[Telemetry] | None, heard: Received[Telemetry]) -> None:
    """Refuse telemetry that cannot be true, by a `ModuleFault` that names the module, the quantity and the value.

    It came after the one `before`, of a module that follows set-points.
    """
    now = heard.message
    for field, unit in TELEMETRY_UNITS.items():
        if not math.isfinite(value := getattr(now, field)):
            raise ModuleFault(
                f'module "{name}" reports a {field} of {value} {unit}: its firmware or its link is broken',
                name,
                Code.BAD_VALUE,
            )
    if now.faults:
        raise ModuleFault(
            f'module "{name}" reports a fault ({now.faults.name or int(now.faults)}) and keeps pulling '
            f"({now.state.name}); update its firmware, it must release its cable",
            name,
            now.faults,
        )
    if before is None:
        return
    earlier = before.message
    # By the slower clock: that of a simulated module stands still while its computer gives it no time.
    seconds = max(1e-6 * ((now.time_us - earlier.time_us) % CLOCK_WRAP_US), heard.time - before.time)
    jump = now.length - (earlier.length + 0.5 * (earlier.speed + now.speed) * seconds)
    if abs(jump) > MAX_LENGTH_JUMP_M + 0.25 * MAX_ACCELERATION_M_S2 * seconds**2:
        raise ModuleFault(
            f'module "{name}" reports a length of {now.length:.3f} m, {1e3 * abs(jump):.0f} mm '
            f"{'more' if jump > 0.0 else 'less'} than its speed explains in {1e3 * seconds:.0f} ms; look at its "
            "encoder, and calibrate its length",
            name,
            Fault.ENCODER,
        )
