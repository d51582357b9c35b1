"""Modules of a run while they are armed: what they report, their limits now, their set-points, and lost ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tensionlab.demand import Demand, RigState
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.guard import Derating, NextTensions, ReleasedModules, next_tensions
from tensionlab.hardware.runner.module_monitor import ModuleMonitor
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.settings import Clock, RunSettings
from tensionlab.hardware.runner.state_estimation import Flags, Observation, any_exceeds, observe, set_point_delays
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers


class ArmedModules:
    """Modules of a run, in the order of the rig; made when the group has been prepared.

    `tensions` (m,) in N are those of the latest set-points, at first the minimum tensions. `note` takes the kind
    of an event, its text, and the name of the module.
    """

    def __init__(
        self,
        rig: Rig,
        group: ModuleGroup,
        settings: RunSettings,
        clock: Clock,
        statistics: Statistics,
        note: Callable[[str, str, str], None],
    ) -> None:
        self._rig, self._group, self._settings, self._clock = rig, group, settings, clock
        self._statistics, self._note = statistics, note
        self.names = [client.name for client in group.clients]
        minimum = np.array([info.tension_lower for info in group.infos])
        self.tensions = np.minimum(minimum, rig.limits.lower)  # equal, but for single precision, or below
        self._max_change = min(group.slews) / settings.rate  # of a tension from one cycle to the next, in N
        self._derating = Derating(rig.limits, np.array(group.continuous), self.names)
        self._released = ReleasedModules(rig.limits.lower, group.slews, settings.ttl)
        self._monitor = ModuleMonitor(group, settings.ttl, settings.on_loss, self._lost)
        self._delays = set_point_delays(rig.m, settings.rate)
        self._late_ages = np.full(rig.m, 2e-3 * settings.telemetry_ms)
        self._seen: Observation | None = None

    @property
    def active(self) -> Flags:
        """Modules that take part, (m,); it changes as modules are lost."""
        return self._monitor.active

    @property
    def complete(self) -> bool:
        """Whether all modules take part."""
        return self._monitor.complete

    @property
    def limits(self) -> TensionLimits:
        """Tension limits now: the rig's, or less where a winding is warm."""
        return self._derating.limits

    def read(self) -> tuple[Observation, Floats]:
        """Read and check the modules; return what they report, and the ages (m,) of their set-points in s."""
        now = self._clock.now()
        seen = self._seen = observe(self._group)
        for index, text in self._derating.update(seen.thermal):
            self._note("derated", text, self.names[index])
        self._statistics.derated = self._derating.lowest
        delays, at_least = self._delays.delays(seen.last_sequence, now)
        self._monitor.check(seen, at_least, self._derating, now)
        if not self.complete:  # the last report of a silent module is no measurement any more
            seen = seen._replace(tensions=np.where(seen.ages > self._settings.ttl, np.nan, seen.tensions))
        return seen, delays

    def count_late(self, seen: Observation) -> None:
        """Count the modules whose telemetry is late."""
        if any_exceeds(seen.ages, self._late_ages):
            late = seen.ages >= self._late_ages
            self._statistics.late_telemetry.update(np.array(self.names)[late].tolist())

    def go_to(self, chosen: Floats, free: Flags) -> NextTensions:
        """Set the tensions of the `free` modules (m,) on their way to those chosen, guarded by `next_tensions`."""
        guarded = next_tensions(self.tensions, chosen, free, self.limits, self._max_change, self.names)
        self.tensions = guarded.tensions
        return guarded

    def send(self, demand: Demand) -> Integers:
        """Send set-points, and return their sequence numbers (m,); -1 where none was sent."""
        sequences = self._monitor.send(self.tensions, demand, self._settings.ttl_ms)
        self._delays.send(sequences, self._clock.now())
        return sequences

    def fixed_tensions(self, demand: Demand, state: RigState) -> Floats:
        """Return the tensions (m,) in N of modules with an impedance, and of lost ones that have not released."""
        tensions = self._released.pulls(self._clock.now())
        for index, name in enumerate(self.names):
            if name in demand.impedances and state.active[index]:
                least, most = self._rig.limits.lower[index], state.upper_now[index]
                spring = demand.impedances[name]
                tension = spring.tension(float(state.lengths[index]), float(state.speeds[index]))
                tensions[index] = min(max(tension, least), most)
        return tensions

    def _lost(self, index: int, error: HardwareError) -> None:
        self._statistics.lost[self.names[index]] = str(error)
        self._note("lost", str(error), self.names[index])
        assert self._seen is not None
        now, client = self._clock.now(), self._group.clients[index]
        heard = now - float(self._seen.ages[index])
        self._released.add(index, float(self.tensions[index]), heard, now, client.state, error)
