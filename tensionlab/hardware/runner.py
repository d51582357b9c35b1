"""Render forces on modules: read, ask, allocate, check, send and log, at a steady rate; stop whatever happens."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from tensionlab.demand import Demand, DemandSource, Floats, Pose, RigState
from tensionlab.errors import HardwareError, LinkTimeout
from tensionlab.hardware.claims import ESTOP_SIGNAL
from tensionlab.hardware.group import ModuleGroup
from tensionlab.hardware.run.clock import Clock, RealClock
from tensionlab.hardware.run.cycle import Cycle
from tensionlab.hardware.run.demands import require_demand
from tensionlab.hardware.run.derating import Derating
from tensionlab.hardware.run.guard import EXACT_SOLVER, GuardedAllocator, approach, require_within
from tensionlab.hardware.run.interrupts import ENDING, Interrupted, Interrupts
from tensionlab.hardware.run.observe import Observation, observe
from tensionlab.hardware.run.pose_tracker import PoseTracker, velocity
from tensionlab.hardware.run.roll import Roll
from tensionlab.hardware.run.settings import RunSettings
from tensionlab.hardware.run.statistics import Statistics
from tensionlab.model.rig import Rig
from tensionlab.solvers.contract import Solver

if TYPE_CHECKING:
    from tensionlab.hardware.log import RunLog

FIRST_TELEMETRY = 2.0
"""How long to wait for it, in s."""
BACK = 1e-3
"""A cycle that begins so long before its deadline, in s, means that the clock went back."""
SEQUENCES = 256
"""Numbers of set-points; then they begin anew."""
SWITCH = 5e-4
"""How long a cycle that is due may wait for another thread of this process, in s."""

Tracker = Callable[[float], Pose]
"""Where is the point or the platform, at a time of the run in s?"""


class Runner:
    """Renders what a demand asks for on the modules of a rig.

    Each cycle reads the modules, finds the pose, asks the demand, allocates, checks, sends and logs. Whatever ends
    a run (its time, the demand, an error, a signal), all modules are stopped.

    Parameters
    ----------
    rig : Rig
    modules : ModuleGroup
        Its modules: `connect` reaches real ones, `World.group` those of a simulated world.
    solver : str or Solver
        As in `tensionlab.allocate`. An answer that is not proved is never sent; that of newton is, in its place.
    demand : callable
        ``demand(state)`` tells the `Demand` of each cycle, given the `RigState`.
    settings : RunSettings, optional
        Rate, time to live, and what to do about losses.
    log : RunLog, optional
        Takes every cycle; closed at the end of the run.
    clock : Clock, optional
        That of a simulated world, if the modules are in one.
    tracker : callable, optional
        Tells the pose in place of the cable lengths.

    Attributes
    ----------
    latest : Cycle or None
    statistics : Statistics
    log : RunLog or None
        May be set until the run begins.

    Raises
    ------
    HardwareError
        If rig and modules do not belong together, or the pose cannot be known.
    """

    def __init__(
        self,
        rig: Rig,
        modules: ModuleGroup,
        solver: str | Solver,
        demand: DemandSource,
        settings: RunSettings | None = None,
        *,
        log: RunLog | None = None,
        clock: Clock | None = None,
        tracker: Tracker | None = None,
    ) -> None:
        self._names = [client.name for client in modules.clients]
        if self._names != [module.name for module in rig.modules]:
            raise HardwareError(f'rig "{rig.name}" has other modules than {", ".join(self._names)}')
        self.rig, self.modules = rig, modules
        self.settings = RunSettings() if settings is None else settings
        self.latest: Cycle | None = None
        self.statistics = Statistics()
        self._allocator = GuardedAllocator(rig.limits, solver, self.settings.nearest)
        self._taut = GuardedAllocator(rig.limits, EXACT_SOLVER)  # least tensions, whatever the solver is after
        self._demand, self._tracker = demand, tracker
        self.log = log
        self._clock = RealClock() if clock is None else clock
        self._lengths = PoseTracker(rig) if tracker is None else None
        self._derating = Derating(rig.limits, np.full(rig.m, np.inf), self._names)  # until the modules have told
        self._roll = Roll(modules, self.settings.ttl, self.settings.on_loss, self._lost)
        self._before = rig.limits.lower.copy()
        self._sent_at = np.full((SEQUENCES, rig.m), np.nan)  # when each set-point was sent, in s of the run
        self._indices = np.arange(rig.m)

    def run(self, seconds: float | None = None) -> Statistics:
        """Arm all modules, render, and stop them.

        Parameters
        ----------
        seconds : float, optional
            How long; until the demand or a signal ends it if left out.

        Returns
        -------
        Statistics
            Also where a signal ended the run: Ctrl-C is a way to do so.

        Raises
        ------
        HardwareError
            What went wrong, after all modules have been told to stop. Errors of the demand and of the solver
            come through as they are.
        """
        interrupts = Interrupts()
        with interrupts.caught((*ENDING, ESTOP_SIGNAL)):
            gc.collect()
            gc.freeze()  # what is there by now is not looked through again while a cycle waits
            patience = sys.getswitchinterval()
            sys.setswitchinterval(SWITCH)
            try:
                self._begin()
                self.statistics.ended = self._render(seconds)
            except Interrupted as interrupted:
                self.statistics.emergency = interrupted.number == ESTOP_SIGNAL
                self.statistics.ended = f"signal {interrupted}"
            except BaseException as error:
                self.statistics.ended = f"{type(error).__name__}: {error}"
                raise
            finally:
                interrupts.ignore()
                sys.setswitchinterval(patience)
                gc.unfreeze()
                self._end()
        return self.statistics

    def _begin(self) -> None:
        """Have all modules report, and arm them."""
        self.modules.prepare(self.rig, self.settings.telemetry_ms)
        self._derating = Derating(self.rig.limits, np.array(self.modules.continuous), self._names)
        if self.log is not None:
            self.log.modules(dict(zip(self._names, self.modules.infos, strict=True)))
        if self._lengths is not None:
            self.modules.require_lengths()
        deadline = self._clock.now() + FIRST_TELEMETRY
        while not np.isfinite(observe(self.modules).ages).all():
            if self._clock.now() > deadline:
                silent = [client.name for client in self.modules.clients if client.telemetry is None]
                raise LinkTimeout(f"no telemetry from {', '.join(silent)} within {FIRST_TELEMETRY:g} s")
            self._clock.wait_until(self._clock.now() + 1e-3 * self.settings.telemetry_ms)
        self.modules.arm(self.rig.limits.lower)
        self._note("armed", f"{self.rig.m} modules")

    def _render(self, seconds: float | None) -> str:
        """Do cycles until one of them is the last; why was it?

        Deadlines are multiples of the period, whatever a cycle takes; those that it runs over are left out.
        """
        period, start, due = 1.0 / self.settings.rate, self._clock.now(), 0
        while seconds is None or due * period < seconds:
            self._clock.wait_until(start + due * period)
            now = self._clock.now() - start
            if now < due * period - BACK:
                raise HardwareError(f"the clock went back by {due * period - now:g} s")
            if not self._cycle(now, now - due * period):
                return "the demand"
            next_due = max(due + 1, int((self._clock.now() - start) * self.settings.rate + 1.0))
            self.statistics.missed += next_due - due - 1
            due = next_due
        return f"after {seconds:g} s"

    def _cycle(self, now: float, late: float) -> bool:
        """Do one cycle; False if the demand is to stop."""
        began = time.perf_counter()
        seen = observe(self.modules)
        for index, text in self._derating.update(seen.thermal):
            self._note("derated", text, self._names[index])
        self.statistics.derated = self._derating.lowest
        self._roll.call(seen, self._derating)
        state = self._state(now, seen)
        demand = require_demand(self._demand(state), self.rig, f"demand of cycle {state.cycle}")
        if demand.stop:
            return False
        limits = self._derating.limits
        free = state.active
        if demand.impedances:
            free = free & [name not in demand.impedances for name in self._names]
        if demand.wrench is None:
            wrench = state.structure @ np.where(free, limits.lower, 0.0)
            allocation, replaced = self._taut(state.structure, wrench, free, limits)
        else:
            wrench = np.asarray(demand.wrench)
            if demand.impedances:
                wrench = wrench - state.structure @ self._pulls(demand, state)
            allocation, replaced = self._allocator(state.structure, wrench, free, limits)
        require_within(allocation.tensions, limits, free, self._names)
        wanted = np.where(free, allocation.tensions, self._before)
        self._before = approach(self._before, wanted, min(self.modules.slews) / self.settings.rate)
        sequences = self._roll.send(self._before, demand, self.settings.ttl_ms)
        self._sent_at[sequences % SEQUENCES, self._indices] = np.where(sequences < 0, np.nan, now)
        work = time.perf_counter() - began
        sent = np.where(free, self._before, np.nan)
        self.latest = Cycle(state, demand, wrench, allocation, replaced, sent, sequences, late, work)
        self.statistics.take(self.latest, slewed=self._before is not wanted)
        if self.log is not None:
            self.log.write(self.latest)
        return True

    def _state(self, now: float, seen: Observation) -> RigState:
        active = self._roll.active.copy()
        if self._lengths is None:
            assert self._tracker is not None
            pose = self._tracker(now)
            structure = self.rig.structure_matrix(*pose)
            motion = velocity(structure, seen.speeds, active)
        else:
            pose, structure = self._lengths.follow(seen.lengths, active)
            motion = self._lengths.velocity(seen.speeds, active)
        late = seen.ages > 2e-3 * self.settings.telemetry_ms
        if late.any():
            self.statistics.late_telemetry.update(np.array(self._names)[late].tolist())
        delays = now - self._sent_at[seen.taken % SEQUENCES, self._indices]
        return RigState(
            self.statistics.cycles,
            now,
            pose,
            motion,
            structure,
            active=active,
            delays=delays,
            upper_now=self._derating.limits.upper,
            **seen._asdict(),
        )

    def _pulls(self, demand: Demand, state: RigState) -> Floats:
        """How hard do the modules pull that render an impedance, by what is known of their cables?"""
        pulls = np.zeros(self.rig.m)
        for index, name in enumerate(self._names):
            if name in demand.impedances and state.active[index]:
                least, most = self.rig.limits.lower[index], state.upper_now[index]
                spring = demand.impedances[name]
                pull = spring.tension(float(state.lengths[index]), float(state.speeds[index]))
                pulls[index] = min(max(pull, least), most)
        return pulls

    def _lost(self, index: int, error: HardwareError) -> None:
        self.statistics.lost[self._names[index]] = str(error)
        self._note("lost", str(error), self._names[index])

    def _note(self, kind: str, text: str, module: str | None = None) -> None:
        if self.log is not None:
            self.log.note(kind, text, module)

    def _end(self) -> None:
        """Stop all modules; say in the log why, and which did not confirm it."""
        unconfirmed = self.modules.emergency_stop() if self.statistics.emergency else self.modules.stop()
        self.statistics.unconfirmed = {name: str(error) for name, error in unconfirmed.items()}
        with suppress(HardwareError):  # of a full disk, the run has heard already
            self._note("ended", self.statistics.ended)
            for name, why in self.statistics.unconfirmed.items():
                self._note("unconfirmed", why, name)
        if self.log is not None:
            self.log.close(self.statistics)
