"""Runner: renders demands on modules in cycles at a steady rate, and stops all modules whatever happens."""

from __future__ import annotations

import gc
import math
import os
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import replace

import numpy as np

from tensionlab.allocation import Solver
from tensionlab.demand import Demand, DemandSource, Pose, RigState, SoftenedEffects
from tensionlab.errors import HardwareError, LinkTimeout
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.messages import Stop
from tensionlab.hardware.runner import records
from tensionlab.hardware.runner.armed_modules import ArmedModules
from tensionlab.hardware.runner.guard import EXACT_SOLVER, AllocateFree, GuardedAllocator
from tensionlab.hardware.runner.pretension import explain_lengths, require_possible, take_up_slack
from tensionlab.hardware.runner.program import require_demand
from tensionlab.hardware.runner.records import Cycle, RunEvent, RunSink, Statistics
from tensionlab.hardware.runner.settings import Clock, RealClock, RunSettings
from tensionlab.hardware.runner.state_estimation import (
    MAX_LENGTH_ERROR_M,
    Flags,
    LengthMonitor,
    Observation,
    PoseTracker,
    observe,
    synchronise,
    velocity,
)
from tensionlab.hardware.runner.watchdog import STOPPING_SIGNALS, Hung, Interrupted, Interrupts, Watchdog
from tensionlab.hardware.sharing import SharedRun
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_count
from tensionlab.support.operating_system import ESTOP_SIGNAL, real_time

FIRST_TELEMETRY_TIMEOUT_S = 2.0
MAX_EARLY_S = 1e-3  # a cycle starting this long before its deadline means the clock was set back
WARM_UP_S = 30.0  # longest time for a solver's first answer, before modules are armed: some import large libraries
MIN_HUNG_S = 0.5  # a cycle that takes this long, and at least the time to live of set-points, has hung
MISFIT_S = 0.25  # longest time without a pose that fits the cable lengths (a cable may go slack briefly)
THREAD_SWITCH_S = 5e-4  # longest time for which a cycle that is due waits for another thread of this process

Tracker = Callable[[float], Pose]  # function that returns the pose at a time of the run in s


class Runner:
    """Runner of a demand on the modules of a rig.

    Each cycle reads the modules, finds the pose, calls the demand, allocates, checks, sends and logs. What the rig
    requires, such as the weight of its platform, is rendered in addition. Whatever ends a run (its time, the
    demand, an error, a signal), all modules are stopped. HardwareError if the modules do not belong to the rig, or
    its pose cannot be determined.

    Parameters
    ----------
    rig : Rig
    modules : ModuleGroup
        Its modules: `connect` reaches real ones, `World.group` those of a simulated world.
    solver : str or Solver
        As in `tensionlab.allocate`. An unproven answer is never sent: that of newton is sent instead.
    demand : callable
        ``demand(state)`` returns the `Demand` of each cycle, given the `RigState`.
    settings : RunSettings, optional
    sinks : iterable of RunSink, optional
        Sinks for cycles and events, such as a `RunLog`; closed at the end of the run.
    clock : Clock, optional
        That of a simulated world, if the modules are in one.
    tracker : callable, optional
        Returns the pose at a time of the run, in place of the cable lengths.

    Attributes
    ----------
    latest : Cycle or None
    statistics : Statistics
    sinks : list of RunSink
        May be changed until the run begins.
    """

    def __init__(
        self,
        rig: Rig,
        modules: ModuleGroup,
        solver: str | Solver,
        demand: DemandSource,
        settings: RunSettings | None = None,
        *,
        sinks: Iterable[RunSink] = (),
        clock: Clock | None = None,
        tracker: Tracker | None = None,
    ) -> None:
        rig.require_position("runs")
        names = [client.name for client in modules.clients]
        if names != [module.name for module in rig.modules]:
            raise HardwareError(f'rig "{rig.name}" has other modules than {", ".join(names)}')
        self.rig, self.modules = rig, modules
        self.settings = RunSettings() if settings is None else settings
        self.latest: Cycle | None = None
        self.statistics = Statistics()
        self.sinks = list(sinks)
        self._solver, self._demand, self._tracker = solver, demand, tracker
        self._allocator: AllocateFree = GuardedAllocator(solver, self.settings.policy)
        self._lowest = GuardedAllocator(EXACT_SOLVER)  # lowest tensions, whatever the solver optimises
        self._clock = RealClock(modules.clients) if clock is None else clock
        self._pose_tracker = PoseTracker(rig) if tracker is None else None
        self._length_monitor = LengthMonitor(rig, lambda text: self.note("unchecked", text))
        self._softened = SoftenedEffects()
        self._fitted_at = 0.0  # time of the latest pose that fitted the cable lengths

    def run(self, seconds: float | None = None) -> Statistics:
        """Arm all modules, render for some seconds, or until the demand or a signal ends it, and stop them.

        A signal such as Ctrl-C is no error. A `HardwareError`, and errors of the demand and of the solver as they
        are, come after all modules have been commanded to stop. A solver or a demand that does not return is
        interrupted. Where it cannot be, in a native call, the modules are stopped and the process ends, with exit
        status 1 and a line on stderr.
        """
        if seconds is not None and not 0.0 < seconds < math.inf:
            raise HardwareError(f"a run takes a finite time above 0 s; got {seconds:g}")
        interrupts = Interrupts()

        def interrupt(why: str) -> None:
            for client in self.modules.clients:
                with suppress(HardwareError):
                    client.send(Stop())
            interrupts.throw(Hung(why))

        self._watchdog = Watchdog(interrupt, self._abandon)
        in_real_time = getattr(self._clock, "real_time", False)
        watched = self._watchdog.watching() if in_real_time else nullcontext()
        if not any(isinstance(sink, SharedRun) for sink in self.sinks):
            self.sinks.append(SharedRun(self.rig, self._solver, self.settings, self.modules.clients))
        with interrupts.caught(STOPPING_SIGNALS):
            gc.freeze()  # present objects are not searched again while a cycle waits
            switch_interval = sys.getswitchinterval()
            sys.setswitchinterval(THREAD_SWITCH_S)
            try:
                with watched, ExitStack() as scheduled:
                    modules = self._begin()
                    # Threads inherit it: the watchdog's, and those of sinks, have started before.
                    if in_real_time and self.settings.processor is not None:
                        granted = scheduled.enter_context(real_time(self.settings.processor))
                        self.note("scheduling", "; ".join(granted))
                    self._arm(modules)
                    self.statistics.ended = self._render(modules, seconds)
            except Interrupted as interrupted:
                self.statistics.emergency = emergency = interrupted.number == ESTOP_SIGNAL
                self.statistics.ended = records.EMERGENCY_STOP if emergency else f"signal {interrupted}"
            except Hung as hung:
                self.statistics.ended = str(hung)
                raise HardwareError(str(hung)) from None
            except BaseException as error:
                self.statistics.ended = f"{type(error).__name__}: {error}"
                raise
            finally:
                interrupts.ignore()
                sys.setswitchinterval(switch_interval)
                gc.unfreeze()
                self._end()
        return self.statistics

    def _begin(self) -> ArmedModules:
        """Have all modules report, and the solver give its first answer."""
        rig, settings, clock = self.rig, self.settings, self._clock
        self.modules.prepare(rig, settings.telemetry_ms)
        modules = ArmedModules(rig, self.modules, settings, clock, self.statistics, self.note)
        for sink in self.sinks:
            sink.begin(dict(zip(modules.names, self.modules.infos, strict=True)), self.statistics)
        if self._pose_tracker is not None:
            self.modules.require_lengths()
        deadline = clock.now() + FIRST_TELEMETRY_TIMEOUT_S
        while not np.isfinite(observe(self.modules).ages).all():
            if clock.now() > deadline:
                silent = [client.name for client in self.modules.clients if client.telemetry is None]
                raise LinkTimeout(f"no telemetry from {', '.join(silent)} within {FIRST_TELEMETRY_TIMEOUT_S:g} s")
            clock.wait_until(clock.now() + 1e-3 * settings.telemetry_ms)
        if self._pose_tracker is not None:
            require_possible(rig, observe(self.modules).lengths)
        self._watchdog.begin("the first answer of the solver", WARM_UP_S)
        home = rig.structure_matrix(rig.home, frames=rig.at_rest)
        self._allocator(home, np.zeros(rig.n), modules.active, rig.limits)
        if settings.rate_limited:
            self._allocator = modules.allocate_within_rates
        self._watchdog.rest()
        return modules

    def _arm(self, modules: ArmedModules) -> None:
        """Arm all modules, and take up slack at the minimum tensions unless the tracker says that none is."""
        self._clock.wait_until(self._clock.now())  # simulated modules catch up before they are armed
        self.modules.arm(modules.tensions)
        self.note("armed", format_count(self.rig.m, "module"))
        known = np.array([info.length_known for info in self.modules.infos])

        def by_place() -> Floats:
            assert self._tracker is not None
            return np.where(known, self.rig.lengths(*self._tracker(0.0)), np.nan)

        def cycle() -> Observation:
            self._clock.wait_until(self._clock.now() + 1.0 / self.settings.rate)
            seen, _ = modules.read()
            modules.send(Demand())
            return seen

        expected = None if self._tracker is None else by_place
        if expected is None or not (abs(observe(self.modules).lengths - expected()) <= MAX_LENGTH_ERROR_M).all():
            take_up_slack(self.rig, cycle, modules.active, self._clock, self._pose_tracker, expected)
        self._fitted_at = self._clock.now()

    def _render(self, modules: ArmedModules, seconds: float | None) -> str:
        """Do cycles until the last one, and return what ended the run.

        Deadlines are multiples of the period, whatever the duration of a cycle; those that pass meanwhile are
        left out.
        """
        period, start, due = 1.0 / self.settings.rate, self._clock.now(), 0
        hung = max(MIN_HUNG_S, self.settings.ttl)
        modules.start = start
        while seconds is None or due * period < seconds:
            self._clock.wait_until(start + due * period)
            now = self._clock.now() - start
            if now < due * period - MAX_EARLY_S:
                raise HardwareError(f"the clock went back by {due * period - now:g} s")
            self._watchdog.begin(f"cycle {self.statistics.cycles}", hung)
            if not self._cycle(modules, now, now - due * period):
                return records.DEMAND_STOPPED
            self._watchdog.rest()
            next_due = max(due + 1, int((self._clock.now() - start) * self.settings.rate + 1.0))
            self.statistics.missed += next_due - due - 1
            due = next_due
        return records.DURATION_REACHED

    def _cycle(self, modules: ArmedModules, now: float, start_delay: float) -> bool:
        """Do one cycle; False if the demand is to stop."""
        began = time.perf_counter()
        state = self._state(modules, now)
        demand = require_demand(self._demand(state), self.rig, f"demand of cycle {state.cycle}")
        if demand.stop:
            return False
        lowest = demand.wrench is None
        allocator = self._lowest if lowest else self._allocator
        required = None
        if self.rig.required.gravity or self.rig.required.wrench is not None:
            required = self.rig.required.middle(self.rig, state.pose.rotation)
        if required is not None and required.any():
            desired = None if demand.desired is None else demand.desired + required
            wrench = required if demand.wrench is None else demand.wrench + required
            demand = replace(demand, wrench=wrench, desired=desired)
        free, limits = state.active, modules.limits
        if demand.impedances:
            free = free & [name not in demand.impedances for name in modules.names]
        if demand.wrench is None:
            wrench = state.structure @ np.where(free, limits.lower, 0.0)
        else:
            wrench = np.asarray(demand.wrench)
            if demand.impedances or not modules.complete:
                wrench = wrench - state.structure @ modules.fixed_tensions(demand, state)
        allocation, fallback_used = allocator(state.structure, wrench, free, limits)
        if demand.wrench is not None and not lowest and self._length_monitor.must_limit(allocation.tensions):
            limited = self._limited_wrench(modules, state, free, required, allocation.tensions)
            desired = demand.wrench if demand.desired is None else demand.desired
            demand = replace(demand, wrench=demand.wrench + limited - wrench, desired=desired)
            wrench = limited
            allocation, fallback_used = allocator(state.structure, wrench, free, limits)
        commanded, slew_limited = modules.go_to(allocation.tensions, free)
        sequences = modules.send(demand)
        compute_time = time.perf_counter() - began
        self.latest = Cycle(
            state, demand, wrench, allocation, fallback_used, commanded, sequences, start_delay, compute_time
        )
        counted = {"fallback_used": fallback_used, "slew_limited": slew_limited}
        self.statistics.add(int(allocation.status), start_delay, compute_time, **counted)
        for sink in self.sinks:
            sink.write(self.latest)
        for change in self._softened.update(state.time, demand.effects):
            self.note("softened", change.text)
        return True

    def _state(self, modules: ArmedModules, now: float) -> RigState:
        """Return the state by the modules' reports, at a time of the run in s."""
        seen, delays = modules.read()
        active, lengths = modules.active.copy(), synchronise(seen.lengths, seen.speeds, seen.ages)
        if self._tracker is not None:
            pose = self._tracker(now)
            structure = self.rig.structure_matrix(*pose)
            twist = velocity(structure, seen.speeds, active)
        else:
            assert self._pose_tracker is not None
            pose, structure = self._pose_tracker.follow(lengths, active)
            twist = self._pose_tracker.native.velocity(seen.speeds, active)
            clock = self._clock.now()
            self._length_monitor.check(self._pose_tracker, lengths, seen.speeds, modules.tensions, active, clock)
            if self._pose_tracker.fits:
                self._fitted_at = clock
            elif clock - self._fitted_at > MISFIT_S:
                raise HardwareError(explain_lengths(self.rig, self._pose_tracker, lengths, active))
        modules.count_late(seen)
        clearance = modules.keep_clear(pose, structure)
        known = {"active": active, "delays": delays, "clearance": clearance, **seen._asdict()}
        known |= {"lengths": lengths, "upper_now": modules.limits.upper}
        del known["bearable"]  # it is in the upper limits
        return RigState(self.statistics.cycles, now, pose, twist, structure, **known)

    def _limited_wrench(
        self, modules: ArmedModules, state: RigState, free: Flags, required: Floats | None, tensions: Floats
    ) -> Floats:
        """Return the wrench (n,) that tensions (m,) render, limited for drifts that are not noticed.

        It goes towards what is rendered without a demand: what the rig requires, or the lower limits.
        """
        at_rest = np.where(free, modules.limits.lower, 0.0)
        if required is not None and required.any():
            at_rest = self._lowest(state.structure, required, free, modules.limits)[0].tensions
        rest = required if required is not None and required.any() else state.structure @ at_rest
        share = self._length_monitor.share(at_rest, tensions)
        limited: Floats = rest + share * (state.structure @ tensions - rest)
        return limited

    def _abandon(self, why: str) -> None:
        """Stop all modules and end the process, in another thread than the run's, which does not return."""
        try:
            self.statistics.ended = why
            with suppress(HardwareError):
                self._end()
            show_cursor = "\x1b[?25h" if sys.stdout.isatty() else ""  # a live table has hidden it
            unconfirmed = ", ".join(self.statistics.unconfirmed)
            more = f"; not confirmed by {unconfirmed}" if unconfirmed else ""
            print(f"{show_cursor}tensionlab: {why}{more}; the process ends", file=sys.stderr, flush=True)
        finally:
            os._exit(1)

    def note(self, kind: str, text: str, module: str = "") -> None:
        """Give an event, such as a phase of the demand, to all sinks; from any thread."""
        cycle, now = (-1, 0.0) if self.latest is None else (self.latest.state.cycle, self.latest.state.time)
        event = RunEvent(cycle, now, kind, text, module)
        self._to_sinks(lambda sink: sink.note(event))

    def _to_sinks(self, give: Callable[[RunSink], None]) -> None:
        """Give something to every sink, then raise the first error."""
        errors = []
        for sink in self.sinks:
            try:
                give(sink)
            except HardwareError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def _end(self) -> None:
        """Stop all modules; note in the log why, and which did not confirm it."""
        unconfirmed = self.modules.emergency_stop() if self.statistics.emergency else self.modules.stop()
        self.statistics.unconfirmed = {name: str(error) for name, error in unconfirmed.items()}
        with suppress(HardwareError):  # the run has already heard of a full disk
            self.note("ended", self.statistics.ended)
            for name, why in self.statistics.unconfirmed.items():
                self.note("unconfirmed", why, name)
        self._to_sinks(lambda sink: sink.close(self.statistics))
