"""Modules of a run while they are armed: which take part, their reports, limits and set-points, and lost ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from itertools import compress
from typing import NoReturn

import numpy as np

from tensionlab import _native
from tensionlab.allocation import Allocation
from tensionlab.demand import Demand, Impedance, Pose, RigState
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import CLOCK_WRAP_US, ModuleClient, Received
from tensionlab.hardware.protocol.codes import FOLLOWING_STATES, Code, Fault, State
from tensionlab.hardware.protocol.messages import SetImpedance, Stop
from tensionlab.hardware.runner.body_clearance import BodyClearance
from tensionlab.hardware.runner.guard import Derating, FrictionCompensation, Release, release_of
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.settings import Clock, RunSettings
from tensionlab.hardware.runner.state_estimation import Flags, Observation, observe
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.path_allocation import RateLimitedAllocator
from tensionlab.support.arrays import Floats, Integers

TELEMETRY_UNITS = {
    "length": "m",
    "speed": "m/s",
    "tension": "N",
    "current": "A",
    "supply": "V",
    "bearable": "N",
}  # quantities of a telemetry that must be finite, and their units
MAX_LENGTH_JUMP_M = _native.MAX_LENGTH_JUMP_M  # tolerance of a length against the cable's own speeds
# Largest acceleration of a cable in m/s²: a hand reaches 30; a free spool (6 N on 0.03 kg) at most twice this.
MAX_ACCELERATION_M_S2 = _native.MAX_ACCELERATION_M_S2
SEQUENCE_NUMBERS = 256  # set-point numbers wrap around here
HISTORY_S = 5.0  # time for which times of set-points are kept
LATE_PERIODS, UNKNOWN_PERIODS = 2, 5  # ages of telemetry from which on it is late, and its tension unknown
CLOCK_DRIFT = 1e-4  # largest difference between the rates of two clocks
STALL_SHARE = 0.75  # a cycle that comes later than this share of the time to live after the one before has stalled


class ArmedModules:
    """Modules of a run, in the order of the rig: checks each in every cycle, and sends set-points.

    It is made when the group has been prepared. A module that is silent for the time to live of set-points is
    lost, and so is one that follows older ones for that long; one that is lost does not come back. After a cycle
    that came late, by a busy computer or a slow solver, modules have that time to be heard again.
    """

    def __init__(
        self,
        rig: Rig,
        group: ModuleGroup,
        settings: RunSettings,
        clock: Clock,
        statistics: Statistics,
        note: Callable[[str, str, str], None],  # takes the kind of an event, its text, and the module's name
    ) -> None:
        self._rig, self._group, self._clients = rig, group, group.clients
        self._settings, self._clock = settings, clock
        self._statistics, self._note = statistics, note
        self.names = [client.name for client in group.clients]
        self.active: Flags = np.ones(rig.m, dtype=bool)  # modules that take part
        self.complete = True  # whether all do
        minimum = np.array([info.tension_lower for info in group.infos])
        # By the latest set-points, in N; at first equal, but for single precision, or below.
        self.tensions = np.minimum(minimum, rig.limits.lower)
        self._max_change = min(group.slews) / settings.rate  # of a tension from one cycle to the next, in N
        self._within_rates = RateLimitedAllocator(rig.limits, min(group.slews), 1.0 / settings.rate)
        self._derating = Derating(rig.limits, self.names)
        self._clearance = BodyClearance(rig, note)
        self._friction = FrictionCompensation(rig, group.frictions) if group.frictions else None
        self._minimum = minimum
        # Friction in N by the latest reports, and that by which set-points are lower; not during pretension.
        self._friction_force: Floats | None = None
        self._compensated: Floats | None = None
        statistics.derated, statistics.near = self._derating.lowest, self._clearance.closest
        self._releases: dict[int, Release] = {}  # of lost modules
        # At high rates set-points share numbers: which one a module follows depends on how many were sent since.
        kept = SEQUENCE_NUMBERS * math.ceil(HISTORY_S * settings.rate / SEQUENCE_NUMBERS)
        self._delays = _native.SetPointDelays(rig.m, kept)
        self._previous, self._stalled_until = math.inf, -math.inf
        self._stall_s = 0.0  # duration of the latest late cycle; 0 if it was long ago
        self._late_since = np.full(rig.m, np.nan)
        period = 1e-3 * settings.telemetry_ms
        self._late_ages = np.full(rig.m, LATE_PERIODS * period)
        self._unknown_ages = np.full(rig.m, min(UNKNOWN_PERIODS * period, settings.ttl))
        self._no_brakes = np.zeros(rig.m, dtype=bool)
        self._seen: Observation | None = None
        self.start = 0.0  # of the first cycle, by the clock of the run
        self._offsets: dict[str, tuple[float, float]] = {}  # of modules' clocks, and when they were measured
        group.clear_checked()

    @property
    def limits(self) -> TensionLimits:
        """Tension limits now: the rig's, or less where a winding is warm or a body is near."""
        return self._clearance.limited(self._derating.limits)

    def keep_clear(self, pose: Pose, structure: Floats) -> Floats:
        """Lower the limits of cables near bodies at a pose; return their distances (m,) from the nearest, in m."""
        self._clearance.update(pose, structure)
        return self._clearance.distances

    def read(self) -> tuple[Observation, Floats]:
        """Read and check the modules; return what they report, and the ages (m,) of their set-points in s."""
        now = self._clock.now()
        seen = observe(self._group)
        self._derating.update(seen.bearable)
        delays, at_least = self._delays.delays(seen.last_sequence, now)
        self.check(seen, at_least, now)
        if _native.any_exceeds(seen.ages, self._unknown_ages):  # an old report is no measurement
            seen = seen._replace(tensions=np.where(seen.ages > self._unknown_ages, np.nan, seen.tensions))
        if self._friction is not None:  # a module reports the pull of its motor
            self._friction_force = self._friction.force(seen.speeds)
            seen = seen._replace(tensions=seen.tensions + self._friction_force)
        return seen, delays

    def check(self, seen: Observation, delays: Floats, now: float) -> None:
        """Check all modules by their latest telemetry and its age.

        `delays` (m,) are the ages of the newest set-points that modules report to follow, in s. A `HardwareError`
        if a module is lost and the run is to stop, or none is left.
        """
        self._seen = seen
        ttl, gap, self._previous = self._settings.ttl, now - self._previous, now
        if gap > STALL_SHARE * ttl:
            self._stall_s, self._stalled_until = gap, now + ttl
        elif now > self._stalled_until:
            self._stall_s = 0.0
        suspects = self._group.suspects(self.active, delays, ttl)
        if _native.any_exceeds(self._derating.lower, seen.bearable):
            hot = np.flatnonzero(self.active & (self._derating.lower > seen.bearable))
            suspects = sorted({*suspects, *hot.tolist()})
        if not suspects:
            self._late_since.fill(np.nan)
            return
        self._late_since = np.where(delays > ttl, np.fmin(self._late_since, now), np.nan)
        ages, bearable, late = seen.ages.tolist(), seen.bearable.tolist(), (now - self._late_since).tolist()
        for index in suspects:
            client = self._clients[index]
            try:
                self._require_healthy(client, ages[index])
                if not self._stall_s and late[index] > ttl:
                    old = f"it follows a set-point sent {delays[index]:.2f} s ago, which lives {ttl:g} s"
                    raise LinkTimeout(f'module "{client.name}" is late: {old}; its link is slow or crowded')
                self._derating.require_holding(index, bearable[index])
            except HardwareError as error:
                self._lose(index, error)

    def _require_healthy(self, client: ModuleClient, age: float) -> None:
        try:
            require_following(client)
        except ModuleFault as fault:
            if fault.code is not State.TIMEOUT or not self._stall_s:
                raise
            late = f"a cycle came after {self._stall_s:.2f} s, and set-points live {self._settings.ttl:g} s"
            slow = f"{fault}: {late}; is this computer busy, or the solver slow?"
            raise ModuleFault(slow, fault.module, fault.code) from None
        if (unchecked := client.unchecked()) is not None:
            require_plausible(client.name, *unchecked)
        if age <= self._settings.ttl + self._stall_s:
            return
        why = f"has been silent for {age:.2f} s; has it power, is its link whole? A longer --ttl allows for more"
        if client.endpoint.repeated and client.telemetry is not None:
            why = (
                f"repeats its report of {age:.2f} s ago ({client.endpoint.repeated} times time_us "
                f"{client.telemetry.message.time_us}): its firmware or its link hangs; switch it off and on"
            )
        raise LinkTimeout(f'module "{client.name}" at {client.link.url} {why}')

    def count_late(self, seen: Observation) -> None:
        """Count the modules that take part and whose telemetry is late."""
        if _native.any_exceeds(seen.ages, self._late_ages):
            late = compress(self.names, (seen.ages >= self._late_ages).tolist())
            self._statistics.late_telemetry.update(late)

    def allocate_within_rates(
        self, structure: Floats, wrench: Floats, free: Flags, limits: TensionLimits
    ) -> tuple[Allocation, bool]:
        """Return an allocation that the `free` modules reach by the next cycle; never by a fallback."""
        return self._within_rates(structure, wrench, limits.only(free), self.tensions), False

    def go_to(self, chosen: Floats, free: Flags) -> tuple[Floats, bool]:
        """Set the next tensions of the `free` modules (m,), on their way to those chosen.

        All go the same share of their way, so that the wrench goes straight from the old to the new one, and none
        faster than its slew. Return those that are commanded, NaN elsewhere, and whether slew limits them. A
        `HardwareError` names the module whose set-point would be outside its limits, NaN among that.
        """
        lower, upper = self.limits.lower, self.limits.upper
        tensions, commanded, slew_limited, refused = _native.next_tensions(
            self.tensions, chosen, free, lower, upper, self._max_change
        )
        if refused >= 0:
            limits = f"its limits are {lower[refused]:g} to {upper[refused]:g} N"
            raise HardwareError(f'module "{self.names[refused]}" would be sent {chosen[refused]:g} N; {limits}')
        self.tensions = tensions
        self._compensated = self._friction_force
        return commanded, slew_limited

    def send(self, demand: Demand) -> Integers:
        """Send set-points to modules that take part; return their numbers (m,), -1 where none was sent."""
        brakes, chosen, ttl_ms = self._no_brakes, self.active, self._settings.ttl_ms
        if demand.brakes:
            brakes = np.array([client.name in demand.brakes for client in self._clients])
        springs = [index for index, client in enumerate(self._clients) if client.name in demand.impedances]
        if springs:
            chosen = chosen.copy()
            chosen[springs] = False
        tensions = self.tensions
        if self._compensated is not None:
            tensions = np.clip(tensions - self._compensated, self._minimum, self.limits.upper)
        sequences, unsent, failed = self._group.send_tensions(tensions, chosen, brakes, ttl_ms)
        for index in [*unsent, *(index for index in springs if self.active[index])]:
            client, brake = self._clients[index], bool(brakes[index])
            try:
                if index in springs:
                    spring = self._clearance.soften(demand.impedances[client.name], index)
                    if spring.amplitude:
                        spring = spring._replace(phase=self._module_phase(client, spring))
                    message = SetImpedance(0, **spring._asdict(), brake=brake, ttl_ms=ttl_ms)
                    sequences[index] = client.set_impedance(message)
                else:
                    sequences[index] = client.set_tension(float(tensions[index]), brake=brake, ttl_ms=ttl_ms)
            except LinkError as error:
                failed.append((index, error))
        for index, why in failed:
            self._lose(index, why)
        self._delays.send(sequences, self._clock.now())
        return sequences

    def _module_phase(self, client: ModuleClient, spring: Impedance) -> float:
        """Return the phase of a vibration at 0 of a module's clock, in turns.

        That clock is known by the telemetry that was underway for the shortest time; the module's crystal may be
        off by `CLOCK_DRIFT`.
        """
        if (received := client.telemetry) is None:
            return spring.phase
        offset = received.time - 1e-6 * received.message.time_us
        known, measured = self._offsets.get(client.name, (offset, received.time))
        known += CLOCK_DRIFT * (received.time - measured)
        if 0.0 < offset - known < 1.0:  # more: its clock has wrapped around
            offset = known
        self._offsets[client.name] = offset, received.time
        begin = self._clock.now() - self.start - client.link.clock() + offset  # of that clock, in the run's time
        return (spring.phase + float(np.float32(spring.frequency)) * begin) % 1.0

    def fixed_tensions(self, demand: Demand, state: RigState) -> Floats:
        """Return the tensions (m,) in N of modules with an impedance, and of lost ones that have not released."""
        tensions, now = np.zeros(self._rig.m), self._clock.now()
        for index, release in self._releases.items():
            tensions[index] = release.pull(now)
        for index, name in enumerate(self.names):
            if name in demand.impedances and state.active[index]:
                lower, upper = self._rig.limits.lower[index], state.upper_now[index]
                spring = self._clearance.soften(demand.impedances[name], index)
                tension = spring.tension(float(state.lengths[index]), float(state.speeds[index]))
                tensions[index] = min(max(tension, lower), upper)
        return tensions

    def _lose(self, index: int, error: HardwareError) -> None:
        self.active[index] = self.complete = False
        self._late_ages[index] = math.inf
        self._statistics.lost[self.names[index]] = str(error)
        self._note("lost", str(error), self.names[index])
        assert self._seen is not None
        now, client = self._clock.now(), self._clients[index]
        expired = now - float(self._seen.ages[index]) + self._settings.ttl
        tension, taut = float(self.tensions[index]), float(self._rig.limits.lower[index])
        self._releases[index] = release_of(
            error, client.state, tension, taut, self._group.slews[index], now=now, expired=expired
        )
        if self._settings.on_loss == "stop":
            raise error
        with suppress(HardwareError):
            client.send(Stop())
        if not self.active.any():
            raise HardwareError(f"no module is left; the last one: {error}")


def require_following(client: ModuleClient) -> None:
    """Refuse a module that has released, refused a set-point, was stopped from outside or restarted."""
    client.check()
    late = client.state is State.IDLE and not client.endpoint.followed  # what it was before
    if client.state not in FOLLOWING_STATES and not late:
        state = State.IDLE if client.state is None else client.state
        stopped = f'module "{client.name}" is {state.name}: it was stopped from outside, or restarted'
        raise ModuleFault(stopped, client.name, state)


def require_plausible(name: str, before: Received | None, received: Received) -> None:
    """Refuse telemetry that cannot be true, by a `ModuleFault` that names the module, the quantity and the value.

    It came after the one `before`, of a module that follows set-points.
    """
    now = received.message

    def refuse(report: str, code: Code | Fault) -> NoReturn:
        raise ModuleFault(f'module "{name}" reports {report}', name, code)

    for field, unit in TELEMETRY_UNITS.items():
        if not math.isfinite(value := getattr(now, field)):
            refuse(f"a {field} of {value} {unit}: its firmware or its link is broken", Code.BAD_VALUE)
    if now.faults:
        fault = f"a fault ({now.faults.name or int(now.faults)}) and keeps pulling ({now.state.name})"
        refuse(f"{fault}; update its firmware, it must release its cable", now.faults)
    if before is None:
        return
    earlier = before.message
    # By the slower clock: that of a simulated module stands still while its computer gives it no time.
    seconds = max(1e-6 * ((now.time_us - earlier.time_us) % CLOCK_WRAP_US), received.time - before.time)
    jump = now.length - (earlier.length + 0.5 * (earlier.speed + now.speed) * seconds)
    if abs(jump) > MAX_LENGTH_JUMP_M + 0.25 * MAX_ACCELERATION_M_S2 * seconds**2:
        more = f"{1e3 * abs(jump):.0f} mm {'more' if jump > 0.0 else 'less'} than its speed explains"
        jumped = f"a length of {now.length:.3f} m, {more} in {1e3 * seconds:.0f} ms"
        refuse(f"{jumped}; look at its encoder, and calibrate its length", Fault.ENCODER)
