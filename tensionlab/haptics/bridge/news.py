"""What do clients hear of a run: its state on asking, and what has changed unasked?"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tensionlab.demand import Floats, RigState
from tensionlab.haptics.bridge.messages import Event, State
from tensionlab.model.rig import Rig

SILENT = 1e-3
"""A share of the force below this is none."""


class News:
    """Keeps the latest of a run, and tells what changes from cycle to cycle.

    Parameters
    ----------
    rig : Rig
    limits : mapping of int to str
        Names of the numbers in `RigState.limits`.

    Attributes
    ----------
    tell : callable
        Hears each event; set it before the run.
    """

    tell: Callable[[Event], None]

    def __init__(self, rig: Rig, limits: Mapping[int, str]) -> None:
        self._names = [module.name for module in rig.modules]
        self._limits = limits
        self._state: RigState | None = None
        self._asked = np.zeros(rig.n)
        self._home: Floats = rig.home
        self._share = 0.0

    def take(self, state: RigState, asked: Floats, share: float) -> None:
        """Note a cycle: state, wrench asked for, share of it that was there."""
        before, fell_silent = self._state, share < SILENT <= self._share
        came_back = self._share < SILENT <= share
        self._state, self._asked, self._share = state, asked, share
        if fell_silent:
            self.tell(Event(time=state.time, kind="silent", text="no frames come: there is no force any more"))
        if came_back:
            self.tell(Event(time=state.time, kind="fresh", text="frames come: the force comes in"))
        if before is None:
            return
        for index, name in enumerate(self._names):
            if before.active[index] and not state.active[index]:
                self._event(state, "lost", "does not take part any more", name)
            elif state.faults[index] & ~before.faults[index]:
                self._event(state, "fault", f"has a fault: {state.faults[index]}", name)
            elif state.limits[index] != before.limits[index]:
                self._event(state, "limit", f"held back by: {self._limits[int(state.limits[index])]}", name)

    def state(self, sequence: int) -> State:
        """How is the rig, as the answer to a frame?"""
        state = self._state
        if state is None:  # no cycle yet
            count = len(self._names)
            return State(
                sequence=sequence,
                time=0.0,
                position=self._home.tolist(),
                asked=self._asked.tolist(),
                pulled=np.zeros_like(self._asked).tolist(),
                tensions=[None] * count,
                limits=["IDLE"] * count,
                active=[True] * count,
                fresh=0.0,
            )
        known = np.nan_to_num(state.tensions)
        return State(
            sequence=sequence,
            time=state.time,
            position=state.pose.position.tolist(),
            asked=self._asked.tolist(),
            pulled=(state.structure @ known).tolist(),
            tensions=[None if np.isnan(tension) else float(tension) for tension in state.tensions],
            limits=[self._limits[int(limit)] for limit in state.limits],
            active=state.active.tolist(),
            fresh=self._share,
        )

    def _event(self, state: RigState, kind: str, text: str, module: str) -> None:
        self.tell(Event(time=state.time, kind=kind, text=text, module=module))
