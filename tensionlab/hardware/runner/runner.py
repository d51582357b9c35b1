"""Runner: renders demands on modules in cycles at a steady rate, and stops all modules whatever happens."""

from __future__ import annotations

import gc
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Solver
from tensionlab.demand import Demand, DemandSource, Pose, RigState
from tensionlab.errors import HardwareError, LinkTimeout
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.messages import Stop
from tensionlab.hardware.runner import guard
from tensionlab.hardware.runner.length_check import LengthMonitor
from tensionlab.hardware.runner.module_monitor import ModuleMonitor
from tensionlab.hardware.runner.pretension import misfit, reel_in, require_possible
from tensionlab.hardware.runner.program import require_demand
from tensionlab.hardware.runner.records import Cycle, RunEvent, RunSink
from tensionlab.hardware.runner.settings import Clock, RealClock, RunSettings
from tensionlab.hardware.runner.state_estimation import (
    MAX_LENGTH_ERROR_M,
    Observation,
    PoseTracker,
    SetPointDelays,
    any_reaches,
    at_one_time,
    observe,
    velocity,
)
from tensionlab.hardware.runner.statistics import DEMAND_STOPPED, DURATION_REACHED, EMERGENCY_STOP, Statistics
from tensionlab.hardware.runner.watchdog import STOPPING_SIGNALS, Hung, Interrupted, Interrupts, Watchdog
from tensionlab.hardware.sharing import SharedRun
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.formatting import format_count
from tensionlab.support.operating_system import ESTOP_SIGNAL

FIRST_TELEMETRY_TIMEOUT_S = 2.0
MAX_EARLY_S = 1e-3  # a cycle that begins so long before its deadline means that the clock went back
# Longest time for a solver's first answer, before modules are armed (some import large libraries).
WARM_UP_S = 30.0
MIN_HUNG_S = 0.5  # a cycle that takes as long, and no less than set-points live, has hung
MISFIT_S = 0.25  # how long lengths may fit no pose in a run: a cable may be slack for a moment
THREAD_SWITCH_S = 5e-4  # how long a cycle that is due may wait for another thread of this process

Tracker = Callable[[float], Pose]  # function that returns the pose at a time of the run in s


class Runner:
    """Runner of a demand on the modules of a rig.

    Each cycle reads the modules, finds the pose, calls the demand, allocates, checks, sends and logs. What the rig
    requires, such as the weight of its platform, is rendered besides. Whatever ends a run (its time, the demand,
    an error, a signal), all modules are stopped.

    Parameters
    ----------
    rig : Rig
    modules : ModuleGroup
        Its modules: `connect` reaches real ones, `World.group` those of a simulated world.
    solver : str or Solver
        As in `tensionlab.allocate`. An unproven answer is never sent; that of newton is, in its place.
    demand : callable
        ``demand(state)`` returns the `Demand` of each cycle, given the `RigState`.
    settings : RunSettings, optional
        Rate, time to live, and what to do when a module is lost.
    sinks : iterable of RunSink, optional
        Sinks for cycles and events, such as a `RunLog`; closed at the end of the run. A `SharedRun` is added if
        there is none.
    clock : Clock, optional
        That of a simulated world, if the modules are in one.
    tracker : callable, optional
        Returns the pose, in place of the cable lengths.

    Attributes
    ----------
    latest : Cycle or None
    statistics : Statistics
    sinks : list of RunSink
        May be changed until the run begins.

    Raises
    ------
    HardwareError
        If rig and modules do not belong together, or the pose cannot be known.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import Demand, Runner, World, WorldClock
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> world, pull = World(rig), Demand(np.array([0.0, 0.0, 1.5]))
    >>> runner = Runner(rig, world.group(), "newton", lambda state: pull, clock=WorldClock(world))
    >>> _ = runner.run(seconds=1.0)
    >>> tl.Status(int(runner.latest.allocation.status)).name
    'EXACT'
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
        self._names = [client.name for client in modules.clients]
        if self._names != [module.name for module in rig.modules]:
            raise HardwareError(f'rig "{rig.name}" has other modules than {", ".join(self._names)}')
        self.rig, self.modules = rig, modules
        self.settings = RunSettings() if settings is None else settings
        self.latest: Cycle | None = None
        self.statistics = Statistics()
        self.sinks = list(sinks)
        self._solver = solver
        self._allocator = guard.GuardedAllocator(solver, self.settings.policy)
        self._taut = guard.GuardedAllocator(guard.EXACT_SOLVER)  # lowest tensions, whatever the solver optimises
        self._demand, self._tracker = demand, tracker
        self._required = rig.required.gravity or rig.required.wrench is not None
        self._clock = RealClock(modules.clients) if clock is None else clock
        self._lengths = PoseTracker(rig) if tracker is None else None
        self._length_monitor = LengthMonitor(rig, lambda text: self.note("unchecked", text))
        self._derating = guard.Derating(
            rig.limits, np.full(rig.m, np.inf), self._names
        )  # until the modules have reported
        self._monitor = ModuleMonitor(modules, self.settings.ttl, self.settings.on_loss, self._lost)
        self._before = rig.limits.lower.copy()
        self._delays = SetPointDelays(rig.m, self.settings.rate)
        self._late_ages = np.full(rig.m, 2e-3 * self.settings.telemetry_ms)
        self._max_change = 0.0  # of a tension from one cycle to the next, in N
        self._released: guard.ReleasedModules | None = None
        self._seen: Observation | None = None
        self._fitted_at = 0.0
        self._watchdog: Watchdog | None = None

    def run(self, seconds: float | None = None) -> Statistics:
        """Arm all modules, render, and stop them.

        Parameters
        ----------
        seconds : float, optional
            How long, above 0; until the demand or a signal ends it if left out.

        Returns
        -------
        Statistics
            Also where a signal ended the run: Ctrl-C is a way to do so.

        Raises
        ------
        HardwareError
            After all modules have been commanded to stop. Errors of the demand and of the solver come through as
            they are.

        Notes
        -----
        A solver or a demand that does not return is interrupted. Where it cannot be, in a native call, the
        modules are stopped and the process ends, with exit status 1 and a line on stderr.
        """
        if seconds is not None and not 0.0 < seconds < math.inf:
            raise HardwareError(f"a run takes a finite time above 0 s; got {seconds:g}")
        interrupts = Interrupts()
        if not any(isinstance(sink, SharedRun) for sink in self.sinks):
            self.sinks.append(SharedRun(self.rig, self._solver, self.settings, self.modules.clients))
        with interrupts.caught(STOPPING_SIGNALS):
            gc.freeze()  # what is there by now is not looked through again while a cycle waits
            patience = sys.getswitchinterval()
            sys.setswitchinterval(THREAD_SWITCH_S)
            try:
                with self._watched(interrupts):
                    self._begin()
                    self.statistics.ended = self._render(seconds)
            except Interrupted as interrupted:
                self.statistics.emergency = interrupted.number == ESTOP_SIGNAL
                self.statistics.ended = EMERGENCY_STOP if self.statistics.emergency else f"signal {interrupted}"
            except Hung as hung:
                self.statistics.ended = str(hung)
                raise HardwareError(str(hung)) from None
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
        self._derating = guard.Derating(self.rig.limits, np.array(self.modules.continuous), self._names)
        for sink in self.sinks:
            sink.begin(dict(zip(self._names, self.modules.infos, strict=True)), self.statistics)
        if self._lengths is not None:
            self.modules.require_lengths()
        self._max_change = min(self.modules.slews) / self.settings.rate
        taut = np.array([info.tension_lower for info in self.modules.infos])
        self._before = np.minimum(taut, self.rig.limits.lower)  # equal, but for single precision, or below
        deadline = self._clock.now() + FIRST_TELEMETRY_TIMEOUT_S
        while not np.isfinite(observe(self.modules).ages).all():
            if self._clock.now() > deadline:
                silent = [client.name for client in self.modules.clients if client.telemetry is None]
                raise LinkTimeout(f"no telemetry from {', '.join(silent)} within {FIRST_TELEMETRY_TIMEOUT_S:g} s")
            self._clock.wait_until(self._clock.now() + 1e-3 * self.settings.telemetry_ms)
        if self._lengths is not None:
            require_possible(self.rig, observe(self.modules).lengths)
        self._step("the first answer of the solver", WARM_UP_S)
        home = self.rig.structure_matrix(self.rig.home, frames=self.rig.at_rest)
        self._allocator(home, np.zeros(self.rig.n), self._monitor.active, self.rig.limits)
        self._rest()
        self._clock.wait_until(self._clock.now())  # simulated modules catch up with that before they are armed
        self._released = guard.ReleasedModules(self.rig.limits.lower, self.modules.slews, self.settings.ttl)
        self.modules.arm(self._before)
        self.note("armed", format_count(self.rig.m, "module"))
        self._pretension()

    def _pretension(self) -> None:
        """Reel in slack cables at the taut minima, unless the tracker says that none is slack."""
        tracker, known = self._tracker, [info.length_known for info in self.modules.infos]

        def expected() -> Floats:
            assert tracker is not None
            return np.where(known, self.rig.lengths(*tracker(0.0)), np.nan)

        if (
            tracker is not None
            and (np.abs(observe(self.modules).lengths - expected()) <= MAX_LENGTH_ERROR_M).all()
        ):
            return

        def cycle() -> Observation:
            self._clock.wait_until(self._clock.now() + 1.0 / self.settings.rate)
            seen, _ = self._look()
            self._send(self._before, Demand())
            return seen

        reel_in(self.rig, cycle, self._monitor.active, self._clock, self._lengths, expected if tracker else None)
        self._fitted_at = self._clock.now()

    def _render(self, seconds: float | None) -> str:
        """Do cycles until the last one, and return what ended the run.

        Deadlines are multiples of the period, whatever a cycle takes; those that it runs over are left out.
        """
        period, start, due = 1.0 / self.settings.rate, self._clock.now(), 0
        hung = max(MIN_HUNG_S, self.settings.ttl)
        while seconds is None or due * period < seconds:
            self._clock.wait_until(start + due * period)
            now = self._clock.now() - start
            if now < due * period - MAX_EARLY_S:
                raise HardwareError(f"the clock went back by {due * period - now:g} s")
            self._step(f"cycle {self.statistics.cycles}", hung)
            if not self._cycle(now, now - due * period):
                return DEMAND_STOPPED
            self._rest()
            next_due = max(due + 1, int((self._clock.now() - start) * self.settings.rate + 1.0))
            self.statistics.missed += next_due - due - 1
            due = next_due
        return DURATION_REACHED

    def _cycle(self, now: float, start_delay: float) -> bool:
        """Do one cycle; False if the demand is to stop."""
        began = time.perf_counter()
        seen, delays = self._look()
        state = self._state(now, seen, delays)
        demand = require_demand(self._demand(state), self.rig, f"demand of cycle {state.cycle}")
        if demand.stop:
            return False
        taut = demand.wrench is None
        demand = self._with_required(demand, state)
        limits = self._derating.limits
        free = state.active
        if demand.impedances:
            free = free & [name not in demand.impedances for name in self._names]
        if demand.wrench is None:
            wrench = state.structure @ np.where(free, limits.lower, 0.0)
        else:
            wrench = np.asarray(demand.wrench)
            if demand.impedances or not self._monitor.complete:
                wrench = wrench - state.structure @ self._pulls(demand, state)
        allocator = self._taut if taut else self._allocator
        allocation, fallback_used = allocator(state.structure, wrench, free, limits)
        if not taut and self._length_monitor.must_limit(allocation.tensions):
            demand, wrench = self._limited(demand, state, free, wrench, allocation.tensions)
            allocation, fallback_used = allocator(state.structure, wrench, free, limits)
        tensions, commanded, slew_limited = guard.next_tensions(
            self._before, allocation.tensions, free, limits, self._max_change, self._names
        )
        self._before = tensions
        sequences = self._send(self._before, demand)
        compute_time = time.perf_counter() - began
        self.latest = Cycle(
            state, demand, wrench, allocation, fallback_used, commanded, sequences, start_delay, compute_time
        )
        self.statistics.add(
            int(allocation.status),
            start_delay,
            compute_time,
            fallback_used=fallback_used,
            slew_limited=slew_limited,
        )
        for sink in self.sinks:
            sink.write(self.latest)
        return True

    def _look(self) -> tuple[Observation, Floats]:
        """Read and check the modules; return what they report, and how old their set-points are."""
        now = self._clock.now()
        seen = self._seen = observe(self.modules)
        for index, text in self._derating.update(seen.thermal):
            self.note("derated", text, self._names[index])
        self.statistics.derated = self._derating.lowest
        delays, at_least = self._delays.delays(seen.last_sequence, now)
        self._monitor.check(seen, at_least, self._derating, now)
        if not self._monitor.complete:  # what a silent module said last is no measurement any more
            seen = seen._replace(tensions=np.where(seen.ages > self.settings.ttl, np.nan, seen.tensions))
        return seen, delays

    def _send(self, tensions: Floats, demand: Demand) -> Integers:
        """Send set-points, and return their sequence numbers; -1 where none was sent."""
        sequences = self._monitor.send(tensions, demand, self.settings.ttl_ms)
        self._delays.send(sequences, self._clock.now())
        return sequences

    def _state(self, now: float, seen: Observation, delays: Floats) -> RigState:
        active = self._monitor.active.copy()
        if self._lengths is None:
            assert self._tracker is not None
            pose = self._tracker(now)
            structure = self.rig.structure_matrix(*pose)
            motion = velocity(structure, seen.speeds, active)
        else:
            lengths = at_one_time(seen.lengths, seen.speeds, seen.ages)
            pose, structure = self._lengths.follow(lengths, active)
            motion = self._lengths.velocity(seen.speeds, active)
            clock = self._clock.now()
            self._length_monitor.check(self._lengths, lengths, seen.speeds, self._before, active, clock)
            if self._lengths.fits:
                self._fitted_at = clock
            elif clock - self._fitted_at > MISFIT_S:
                raise HardwareError(misfit(self.rig, self._lengths, lengths, active))
        if any_reaches(seen.ages, self._late_ages):
            late = seen.ages >= self._late_ages
            self.statistics.late_telemetry.update(np.array(self._names)[late].tolist())
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

    def _with_required(self, demand: Demand, state: RigState) -> Demand:
        """Return a demand with what the rig requires besides, such as the weight of its platform."""
        required = self._required_wrench(state)
        if required is None:
            return demand
        wrench = required if demand.wrench is None else demand.wrench + required
        return replace(
            demand, wrench=wrench, desired=None if demand.desired is None else demand.desired + required
        )

    def _required_wrench(self, state: RigState) -> Floats | None:
        if not self._required:
            return None
        required = self.rig.required.middle(self.rig, state.pose.rotation)
        return required if required.any() else None

    def _limited(
        self, demand: Demand, state: RigState, free: NDArray[np.bool_], wrench: Floats, tensions: Floats
    ) -> tuple[Demand, Floats]:
        """Return a demand and its wrench (n,) for the free modules, limited for drifts that are not noticed.

        The tensions (m,) render the wrench without the limit. With it, the wrench is nearer to what is rendered
        without a demand: what the rig requires, or all cables at their lower limits.
        """
        limits, required = self._derating.limits, self._required_wrench(state)
        if required is None:
            at_rest = np.where(free, limits.lower, 0.0)
            rest = state.structure @ at_rest
        else:
            rest = required
            at_rest = self._taut(state.structure, rest, free, limits)[0].tensions
        share = self._length_monitor.share(at_rest, tensions)
        limited = rest + share * (state.structure @ tensions - rest)
        assert demand.wrench is not None
        desired = demand.wrench if demand.desired is None else demand.desired
        return replace(demand, wrench=demand.wrench + limited - wrench, desired=desired), limited

    def _pulls(self, demand: Demand, state: RigState) -> Floats:
        """Return the tensions of modules with an impedance, and of lost ones that have not released yet."""
        assert self._released is not None
        pulls = self._released.pulls(self._clock.now())
        for index, name in enumerate(self._names):
            if name in demand.impedances and state.active[index]:
                least, most = self.rig.limits.lower[index], state.upper_now[index]
                spring = demand.impedances[name]
                pull = spring.tension(float(state.lengths[index]), float(state.speeds[index]))
                pulls[index] = min(max(pull, least), most)
        return pulls

    def _lost(self, index: int, error: HardwareError) -> None:
        self.statistics.lost[self._names[index]] = str(error)
        self.note("lost", str(error), self._names[index])
        assert self._released is not None
        assert self._seen is not None
        now, client = self._clock.now(), self.modules.clients[index]
        heard = now - float(self._seen.ages[index])
        self._released.add(index, float(self._before[index]), heard, now, client.state, error)

    @contextmanager
    def _watched(self, interrupts: Interrupts) -> Iterator[None]:
        """Watch over the steps of a run, where its clock advances during a step."""
        if not getattr(self._clock, "real_time", False):
            yield
            return

        def interrupt(why: str) -> None:
            for client in self.modules.clients:
                with suppress(HardwareError):
                    client.send(Stop())
            interrupts.throw(Hung(why))

        with Watchdog(interrupt, self._abandon) as self._watchdog:
            yield

    def _step(self, name: str, seconds: float) -> None:
        if self._watchdog is not None:
            self._watchdog.begin(name, seconds)

    def _rest(self) -> None:
        if self._watchdog is not None:
            self._watchdog.rest()

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

    def note(self, kind: str, text: str, module: str | None = None) -> None:
        """Give an event, such as a phase of the demand, to all sinks; from any thread."""
        cycle, now = (-1, 0.0) if self.latest is None else (self.latest.state.cycle, self.latest.state.time)
        event = RunEvent(cycle, now, kind, text, module or "")
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
        with suppress(HardwareError):  # of a full disk, the run has heard already
            self.note("ended", self.statistics.ended)
            for name, why in self.statistics.unconfirmed.items():
                self.note("unconfirmed", why, name)
        self._to_sinks(lambda sink: sink.close(self.statistics))
