"""What do clients hear of a run: its state on asking, and what has changed unasked?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.demand import Demand, RigState
from tensionlab.haptics.bridge.messages import Event, State
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.model.rig import Rig

SILENT = 1e-3
"""A share of the force below this is none."""
QUARTER = 0.25
"""A change of the stiffness ceiling by more than this share of it is told."""
DERATED_N = 0.5
"""A change of a module's upper tension limit by so much is told, in N."""
AGAIN = 1.0
"""Time in s after which rates are told anew, and that an effect is stiffer than what is rendered."""
UNKNOWN = "UNKNOWN"


class Noted(NamedTuple):
    """The latest cycle."""

    state: RigState
    demand: Demand
    share: float
    ceiling: float
    delay: float


class Second(NamedTuple):
    """Since when rates are counted, frames and cycles then, and the longest gap since."""

    begin: float
    frames: int
    cycle: int
    gap: float


class News:
    """Keeps the latest of a run, and tells what changes from cycle to cycle.

    Parameters
    ----------
    rig : Rig
    limits, brakes : mapping of int to str
        Names of the numbers in `RigState.limiters` and `RigState.brakes`.
    frames : callable
        How many frames have come so far?

    Attributes
    ----------
    tell : callable
        Hears each event; set it before the run.
    """

    tell: Callable[[Event], None]

    def __init__(
        self, rig: Rig, limits: Mapping[int, str], brakes: Mapping[int, str], frames: Callable[[], int]
    ) -> None:
        self._names = [module.name for module in rig.modules]
        self._limits, self._brakes, self._frames = limits, brakes, frames
        self._upper, self._told_upper = rig.limits.upper, rig.limits.upper.copy()
        self._still: Floats = np.zeros(rig.n)
        self._home: Floats = rig.home
        self._latest: Noted | None = None
        self._second: Second | None = None
        self._ceiling = 0.0
        self._stiff: dict[str, float] = {}

    def take(self, state: RigState, demand: Demand, share: float, renderer: Renderer) -> None:
        """Note a cycle: see `Told` in `tensionlab.haptics.bridge.source`."""
        before = self._latest
        self._latest = Noted(state, demand, share, renderer.ceiling, renderer.delay)
        self._tell_share(state, 0.0 if before is None else before.share, share)
        self._tell_stiffness(state, renderer)
        self._tell_derating(state)
        if before is not None:
            self._tell_modules(before.state, state)
        self._tell_rates(state, 0.0 if before is None else state.time - before.state.time)

    def note(self, kind: str, text: str) -> None:
        """Tell something else that happened now."""
        self._event(0.0 if self._latest is None else self._latest.state.time, kind, text)

    def state(self, sequence: int) -> State:
        """How is the rig, as the answer to a frame?"""
        count = len(self._names)
        if self._latest is None:  # no cycle yet
            return State(
                sequence=sequence,
                time=0.0,
                position=self._home.tolist(),
                asked=self._still.tolist(),
                pulled=self._still.tolist(),
                tensions=[None] * count,
                limits=["IDLE"] * count,
                active=[True] * count,
                rendering=[False] * count,
                braked=[False] * count,
                brakes=[UNKNOWN] * count,
                ceiling=0.0,
                delay=0.0,
                fresh=0.0,
            )
        state, demand, share, ceiling, delay = self._latest
        known = np.nan_to_num(state.tensions)
        return State(
            sequence=sequence,
            time=state.time,
            position=state.pose.position.tolist(),
            asked=(self._still if demand.wrench is None else np.asarray(demand.wrench)).tolist(),
            pulled=(state.structure @ known).tolist(),
            tensions=[None if np.isnan(tension) else float(tension) for tension in state.tensions],
            limits=[self._limits[int(limit)] for limit in state.limiters],
            active=state.active.tolist(),
            rendering=[name in demand.impedances for name in self._names],
            braked=[name in demand.brakes for name in self._names],
            brakes=[self._brakes.get(int(brake), UNKNOWN) for brake in state.brakes],
            ceiling=ceiling,
            delay=delay,
            fresh=share,
        )

    def _tell_share(self, state: RigState, before: float, share: float) -> None:
        if share < SILENT <= before:
            self._event(state.time, "silent", "no frames come: there is no force any more")
        if before < SILENT <= share:
            self._event(state.time, "fresh", "frames come: the force comes in")

    def _tell_modules(self, before: RigState, state: RigState) -> None:
        for index, name in enumerate(self._names):
            if before.active[index] and not state.active[index]:
                self._event(state.time, "lost", "does not take part any more", module=name)
                continue
            if state.faults[index] & ~before.faults[index]:
                self._event(state.time, "fault", f"has a fault: {state.faults[index]}", module=name)
            elif state.limiters[index] != before.limiters[index]:
                limit = self._limits[int(state.limiters[index])]
                self._event(state.time, "limit", f"held back by: {limit}", module=name)
            if state.brakes[index] != before.brakes[index]:
                brake = self._brakes.get(int(state.brakes[index]), UNKNOWN)
                self._event(state.time, "brake", f"its brake is {brake}", module=name)

    def _tell_derating(self, state: RigState) -> None:
        """Tell which modules may not pull as hard as before, or may again."""
        whole = (state.upper_now == self._upper) & (self._told_upper < self._upper)
        for index in np.flatnonzero((np.abs(state.upper_now - self._told_upper) >= DERATED_N) | whole):
            self._told_upper[index] = upper = float(state.upper_now[index])
            text = f"pulls with up to {upper:.2f} N of {self._upper[index]:g} N, so that it does not get too hot"
            self._event(state.time, "derated", text, module=self._names[index], upper=upper)

    def _tell_stiffness(self, state: RigState, renderer: Renderer) -> None:
        """Tell how stiff the host may be, where that changes, and which effects are to be stiffer."""
        now, ceiling = state.time, renderer.ceiling
        if abs(ceiling - self._ceiling) > QUARTER * self._ceiling:
            self._ceiling = ceiling
            late = f"the loop is {1e3 * renderer.delay:.0f} ms late"
            text = f"what no module renders may have {ceiling:.0f} N/m now: {late}"
            self._event(now, "ceiling", text, ceiling=ceiling, delay=renderer.delay)
        for name, cut in renderer.cut.items():
            if now >= self._stiff.get(name, -AGAIN) + AGAIN:
                parameter, wanted = next(iter(cut.items()))
                text = f'"{name}": {parameter} is {wanted:g} N/m, {ceiling:.0f} N/m are rendered, by the host'
                self._event(now, "stiff", text, effect=name, stiffness=wanted, ceiling=ceiling)
            self._stiff[name] = now  # told again when it has not been so for a while

    def _tell_rates(self, state: RigState, gap: float) -> None:
        """Tell once a second how often what happens."""
        now, frames = state.time, self._frames()
        second = self._second or Second(now, frames, state.cycle, 0.0)
        second = second._replace(gap=max(second.gap, gap))
        if (passed := now - second.begin) >= AGAIN:
            cycles, came = (state.cycle - second.cycle) / passed, (frames - second.frames) / passed
            text = f"{cycles:.1f} cycles and {came:.1f} frames a second; the longest gap {1e3 * second.gap:.0f} ms"
            self._event(now, "rate", text, cycles=cycles, gap=second.gap, frames=came)
            second = Second(now, frames, state.cycle, 0.0)
        self._second = second

    def _event(self, time: float, kind: str, text: str, **more: float | str) -> None:
        self.tell(Event.model_validate({"time": time, "kind": kind, "text": text, **more}))
