"""Events and state of a run, for clients of the bridge."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from tensionlab.demand import Demand, RigState, SoftenedEffects, measured_wrench
from tensionlab.haptics.bridge.messages import BridgeEvent, BridgeState
from tensionlab.haptics.rendering.effect_fidelity import FidelityRecord
from tensionlab.haptics.rendering.fidelity import Fidelity
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

MIN_SHARE = 1e-3  # a smaller share of the force counts as none
CEILING_CHANGE = 0.25  # smallest relative change of the host stiffness limit that is an event
DERATING_CHANGE_N = 0.5  # smallest change of a module's upper tension limit that is an event
JUDGED_CYCLES = 400  # number of latest cycles whose fidelity is reported
REPEAT_S = 1.0  # period of rates; a condition that was absent for this time has ended, and is an event again
NO_LIMITER = "NONE"
UNKNOWN = "UNKNOWN"
IDLE: dict[str, Any] = {
    "tensions": None,
    "limiters": "IDLE",
    "active": True,
    "rendering": False,
    "braked": False,
    "brakes": UNKNOWN,
}  # of each module before the first cycle


class LatestCycle(NamedTuple):
    """Latest cycle of a run, with the state of its renderer."""

    state: RigState
    demand: Demand
    share: float
    ceiling: float
    delay: float


class RunEvents:
    """Latest state of a run, and events for what changes from cycle to cycle.

    ``limiters`` and ``brakes`` name the numbers in `RigState.limiters` and `RigState.brakes`, ``frames`` returns
    the number of frames received. ``send`` is called with each event; set it before the run.
    """

    send: Callable[[BridgeEvent], None]

    def __init__(
        self, rig: Rig, limiters: Mapping[int, str], brakes: Mapping[int, str], frames: Callable[[], int]
    ) -> None:
        self._names = [module.name for module in rig.modules]
        self._limiters, self._brakes, self._frames = limiters, brakes, frames
        self._upper, self._sent_upper = rig.limits.upper, rig.limits.upper.copy()
        self._still: Floats = np.zeros(rig.n)
        self._home: Floats = rig.home
        self._latest: LatestCycle | None = None
        self._window: tuple[float, int, int] | None = None  # of rates: its begin, and the frames and cycles then
        self._longest_gap = 0.0  # between two cycles in the window, in s
        self._ceiling = 0.0
        self._softened = SoftenedEffects()
        self._record = FidelityRecord(rig, JUDGED_CYCLES)
        self._judged: tuple[float, dict[str, Fidelity]] = (-math.inf, {})  # when, and the fidelity
        self._limited: dict[tuple[int, str], float] = {}  # latest time of each limiter of a module

    def take(self, state: RigState, demand: Demand, share: float, renderer: Renderer) -> None:
        """Take a cycle, and the share of the force that was rendered in it."""
        previous_cycle = self._latest
        self._latest = LatestCycle(state, demand, share, renderer.ceiling, renderer.delay)
        previous_share = 0.0 if previous_cycle is None else previous_cycle.share
        if share < MIN_SHARE <= previous_share:
            self._event(state.time, "silent", "no frames come: the force is 0")
        if previous_share < MIN_SHARE <= share:
            self._event(state.time, "fresh", "frames come: the force fades in")
        self._record.add(state, demand)
        self._send_stiffness(state, demand, renderer)
        self._send_derating(state)
        if previous_cycle is not None:
            self._send_modules(previous_cycle.state, state)
        self._send_limiters(state)
        self._send_rates(state, 0.0 if previous_cycle is None else state.time - previous_cycle.state.time)

    def note(self, kind: str, text: str) -> None:
        """Send another event that happens now."""
        self._event(0.0 if self._latest is None else self._latest.state.time, kind, text)

    def state(self, sequence: int) -> BridgeState:
        """Return the state of the rig, as the answer to a frame."""
        if self._latest is None:  # no cycle yet
            idle: dict[str, Any] = {key: [value] * len(self._names) for key, value in IDLE.items()}
            idle |= dict.fromkeys(("desired", "demanded", "measured"), self._still.tolist())
            idle |= dict.fromkeys(("time", "ceiling", "delay", "fresh"), 0.0)
            idle |= {"softened": {}, "fidelity": {}, "noticed": {}}
            return BridgeState(sequence=sequence, position=self._home.tolist(), **idle)
        state, demand, share, ceiling, delay = self._latest
        if state.time - self._judged[0] >= REPEAT_S:  # here, since it takes longer than a cycle may
            self._judged = state.time, self._record.fidelity()
        fidelities = {name: fidelity for name, fidelity in self._judged[1].items() if name in demand.effects}
        demanded = self._still if demand.wrench is None else np.asarray(demand.wrench)
        measured = measured_wrench(state.structure, state.tensions, state.active)
        return BridgeState(
            sequence=sequence,
            time=state.time,
            position=state.pose.position.tolist(),
            desired=(demanded if demand.desired is None else np.asarray(demand.desired)).tolist(),
            demanded=demanded.tolist(),
            softened={
                name: {key: rendered for key, (_, rendered) in effect.softened.items()}
                for name, effect in demand.effects.items()
                if effect.softened
            },
            fidelity={name: fidelity.numbers() for name, fidelity in fidelities.items()},
            noticed={
                name: list(fidelity.failures()) for name, fidelity in fidelities.items() if fidelity.failures()
            },
            measured=_or_none(measured),
            tensions=_or_none(state.tensions),
            limiters=[self._limiters[int(limiter)] for limiter in state.limiters],
            active=state.active.tolist(),
            rendering=[name in demand.impedances for name in self._names],
            braked=[name in demand.brakes for name in self._names],
            brakes=[self._brakes.get(int(brake), UNKNOWN) for brake in state.brakes],
            ceiling=ceiling,
            delay=delay,
            fresh=share,
        )

    def _send_modules(self, before: RigState, state: RigState) -> None:
        for index, name in enumerate(self._names):
            if before.active[index] and not state.active[index]:
                self._event(state.time, "lost", "no longer takes part", module=name)
                continue
            if state.faults[index] & ~before.faults[index]:
                self._event(state.time, "fault", f"has a fault: {state.faults[index]}", module=name)
            if state.brakes[index] != before.brakes[index]:
                brake = self._brakes.get(int(state.brakes[index]), UNKNOWN)
                self._event(state.time, "brake", f"its brake is {brake}", module=name)

    def _send_limiters(self, state: RigState) -> None:
        """Send the begin and end of each limiter; one that comes and goes from cycle to cycle is sent once."""
        for index in map(int, np.flatnonzero(state.active)):
            limiter = self._limiters[int(state.limiters[index])]
            if limiter == NO_LIMITER:
                continue
            if (index, limiter) not in self._limited:
                self._event(state.time, "limit", f"limited by: {limiter}", module=self._names[index])
            self._limited[index, limiter] = state.time
        for (index, limiter), latest in list(self._limited.items()):
            if state.time - latest >= REPEAT_S:
                del self._limited[index, limiter]
                self._event(state.time, "limit", f"no longer limited by: {limiter}", module=self._names[index])

    def _send_derating(self, state: RigState) -> None:
        """Send changes of the modules' upper tension limits, and their full recovery."""
        whole = (state.upper_now == self._upper) & (self._sent_upper < self._upper)
        for index in np.flatnonzero((np.abs(state.upper_now - self._sent_upper) >= DERATING_CHANGE_N) | whole):
            self._sent_upper[index] = upper = float(state.upper_now[index])
            text = f"pulls with up to {upper:.2f} N of {self._upper[index]:g} N, to stay cool enough"
            self._event(state.time, "derated", text, module=self._names[index], upper=upper)

    def _send_stiffness(self, state: RigState, demand: Demand, renderer: Renderer) -> None:
        """Send changes of the host stiffness limit, and of the effects that are rendered softer."""
        now, ceiling = state.time, renderer.ceiling
        if abs(ceiling - self._ceiling) > CEILING_CHANGE * self._ceiling:
            self._ceiling = ceiling
            text = f"host stiffness limit {ceiling:.0f} N/m, loop latency {1e3 * renderer.delay:.0f} ms"
            self._event(now, "ceiling", text, ceiling=ceiling, delay=renderer.delay)
        for softening in self._softened.update(now, demand.effects):
            numbers = {"stiffness": softening.desired, "ceiling": softening.rendered}
            self._event(now, "stiff", softening.text, effect=softening.effect, **numbers)

    def _send_rates(self, state: RigState, gap: float) -> None:
        """Send once a second the rates of cycles and frames."""
        now, frames = state.time, self._frames()
        begin, frames_then, cycle_then = self._window = self._window or (now, frames, state.cycle)
        longest = self._longest_gap = max(self._longest_gap, gap)
        if (passed := now - begin) >= REPEAT_S:
            cycles, received = (state.cycle - cycle_then) / passed, (frames - frames_then) / passed
            text = (
                f"{cycles:.1f} cycles and {received:.1f} frames a second; the longest gap {1e3 * longest:.0f} ms"
            )
            self._event(now, "rate", text, cycles=cycles, gap=longest, frames=received)
            self._window, self._longest_gap = (now, frames, state.cycle), 0.0

    def _event(self, time: float, kind: str, text: str, **more: float | str) -> None:
        self.send(BridgeEvent.model_validate({"time": time, "kind": kind, "text": text, **more}))


def _or_none(numbers: Floats) -> list[float | None]:
    return [None if np.isnan(number) else number for number in numbers.tolist()]
