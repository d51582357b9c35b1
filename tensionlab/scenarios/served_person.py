"""The simulated person of a scenario, who holds the cables of served modules, and is seen by a tracker."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.demand import Pose
from tensionlab.haptics.bridge.client_state import HAND
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tensionlab.hardware.simulation.world import COMPLIANT_STEP_S
from tensionlab.model.pose import frame_of
from tensionlab.scenarios import Person, PersonPlan, Scenario, Script, Waypoint

TRACKED = 90.0
"""How often a tracker tells where everything is, in Hz: as those of head-mounted displays do."""
WAY_BACK = 1.0
"""How long the way back to the start takes, in s."""
Track = Callable[[Mapping[str, Floats], float], None]
"""Hears where bodies are, by name, in m, and the time in s since 1970."""
UP = (State.ARMED, State.RUNNING)
"""States of a module that pulls."""


class ServedPerson:
    """Holds the cables of all modules of a scenario's rig.

    It stands still at its start until all modules are armed; then its script begins. When all have been stopped,
    it goes back there. Modules that are armed meanwhile find it on its way, and its script begins after that.

    Parameters
    ----------
    scenario : Scenario
    track : callable, optional
        Hears 90 times a second where the hand and the bodies are, by their names, and when that was.

    Attributes
    ----------
    far_ends : dict of str to callable
        How long each module's cable is now, in m.
    """

    def __init__(self, scenario: Scenario, track: Track | None = None) -> None:
        self._plan, self._rig, self._track = scenario.person, scenario.rig, track
        self._person, self._since = Person(self._plan, self._rig), 0.0
        self._lengths: Floats = self._rig.lengths(*self._person.pose)
        self._played, self._back_at = False, -np.inf
        self._began, self._tracked = time.time(), 0
        self.far_ends: dict[str, Callable[[], float]] = {
            module.name: partial(self._length, index) for index, module in enumerate(self._rig.modules)
        }

    def take(self, modules: Sequence[SimulatedModule]) -> None:
        """Feel what all modules pull with, and move: a watcher of `serve`, at each ms."""
        samples = [module.sample for module in modules]
        now = samples[0].seconds
        self._follow([sample.state in UP for sample in samples], now)
        self._person.apply_tensions(np.array([sample.tension for sample in samples]))
        pose = self._person(
            now + COMPLIANT_STEP_S - self._since
        )  # where the cables are to be after the modules' next step
        self._lengths = self._rig.lengths(*pose)
        due = int(now * TRACKED)
        if self._track is not None and due > self._tracked:
            self._tracked = due
            # By the modules' time: what they do late, on a busy machine, was not slow.
            self._track({HAND: pose.position, **_places(pose)}, self._began + now)

    def _follow(self, up: list[bool], now: float) -> None:
        """Begin, go back, or be back, as the modules are."""
        if self._played and not any(up):
            self._become(way_back(self._plan, self._person.pose), now)
            self._person.begin()
            self._played, self._back_at = False, now + WAY_BACK
        elif not self._played and all(up) and now >= self._back_at:
            self._become(self._plan, now)
            self._person.begin()
            self._played = True

    def _become(self, plan: PersonPlan, now: float) -> None:
        self._person, self._since = Person(plan, self._rig), now

    def _length(self, index: int) -> float:
        return float(self._lengths[index])


def way_back(plan: PersonPlan, pose: Pose) -> PersonPlan:
    """How does somebody get from a pose to where a plan starts?"""

    def back(script: Script, here: Floats) -> Script:
        there = script.position(0.0)
        return Script((Waypoint(0.0, tuple(here.tolist())), Waypoint(WAY_BACK, tuple(there.tolist()))))

    places = _places(pose)
    bodies = {name: back(script, places[name]) for name, script in plan.bodies.items()}
    return replace(plan, script=back(plan.script, pose.position), bodies=bodies)


def _places(pose: Pose) -> dict[str, Floats]:
    """Where is the origin of each body?"""
    frames = pose.frames or {}
    return {name: np.asarray(frame_of(where).position, dtype=np.float64) for name, where in frames.items()}
