"""A scenario as a demand source: what is to be felt now, and which brakes are to hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.demand import Demand, Pose, RigState
from tensionlab.haptics.brakes.choice import brake_strengths
from tensionlab.haptics.brakes.contact import Catch, Decision, decide
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S, Effect, Motion, relative
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.model.pose import frame_of
from tensionlab.scenarios.brake_target import Hold
from tensionlab.scenarios.scenario import Scenario

NOTHING: Mapping[str, Effect] = MappingProxyType({})
STARTING = 0.25
"""How long all force takes to come in, in s: nobody knows where the hand is when a run begins."""
Told = Callable[[str, str], None]
"""Hears what happens: a kind (phase, brake) and a text."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Where hand and bodies were in a cycle."""

    time: float
    pose: Pose


class ScenarioDemand:
    """Asks for what a scenario wants. A demand source.

    Parameters
    ----------
    scenario : Scenario
    tell : callable, optional
        Hears when a phase begins, and what is decided about brakes.
    repeat : bool
        Whether it begins anew when it is over.

    Attributes
    ----------
    renderer : Renderer
        Which knows how late the loop is, and how stiff it may be.
    """

    def __init__(self, scenario: Scenario, tell: Told | None = None, *, repeat: bool = False) -> None:
        self._scenario = scenario
        self._period = scenario.seconds if repeat else math.inf
        self._own = {name for phase in scenario.phases for name in phase.effects}
        self._tell: Told = tell if tell is not None else lambda kind, text: None
        self.renderer = Renderer(scenario.rig)
        self._strengths = brake_strengths(scenario.rig)
        self._names = [module.name for module in scenario.rig.modules]
        self._before: Seen | None = None
        self._phases: tuple[str, ...] = ()
        self._catch: Catch | None = None
        self._why = ""

    def __call__(self, state: RigState, over: Mapping[str, Effect] = NOTHING, share: float = 1.0) -> Demand:
        """What is to be felt now?

        Parameters
        ----------
        state : RigState
        over : mapping of str to Effect
            In place of the scenario's own by the same names, when it is their time; others are felt all the time.
        share : float
            Of all force, from 0 to 1. At 0 no brake is on, either.
        """
        scenario = self._scenario
        share = share * min(state.time / STARTING, 1.0)
        motion = self._motion(state)
        phases = scenario.now(float(motion.time))
        names = tuple(phase.name for phase in phases)
        for name in names:
            if name not in self._phases:
                self._tell("phase", name)
        self._phases = names
        effects: dict[str, Effect] = {}
        for phase in phases:
            effects |= phase.effects
        effects |= {name: each for name, each in over.items() if name in effects or name not in self._own}
        demand = self.renderer(effects, motion, state, share)
        holds = [phase.hold for phase in phases if phase.hold is not None and share > 0.0]
        brakes = self._brakes(holds[0], motion, state) if holds else self._let_go("no hold")
        return replace(demand, brakes=brakes)

    def _motion(self, state: RigState) -> Motion:
        """How does the hand move, seen from where effects are?

        Its speed is that of its places: that of the cables lacks what they do not see, and anchors move too.
        """
        pose, before = state.pose, self._before
        step = 1.0 / self._scenario.rate if before is None else max(state.time - before.time, 1e-4)
        age = float(np.min(state.ages))
        there = None if before is None else before.pose.position
        time = math.fmod(state.time, self._period)
        hand = Motion(pose.position, _speed(pose.position, there, step), time, step, age)
        self._before = Seen(state.time, pose)
        frame = self._scenario.seen_from
        if frame is None:
            return hand
        here = _origin(pose, frame)
        there = None if before is None else _origin(before.pose, frame)
        return relative(hand, replace(hand, position=here, velocity=_speed(here, there, step)))

    def _brakes(self, hold: Hold, motion: Motion, state: RigState) -> frozenset[str]:
        """Which brakes are to be on?"""
        rig = self._scenario.rig
        decision = decide(
            state.structure[: rig.dimension],
            motion.position,
            motion.velocity,
            hold.wall(motion.position),
            rig.limits,
            np.where(state.active, self._strengths, 0.0),
            self._catch,
            hold.late_by(self.renderer.delay),
            hold.cap,
        )
        self._catch = decision.catch
        self._say(decision)
        return frozenset(name for name, on in zip(self._names, decision.locked, strict=True) if on)

    def _say(self, decision: Decision) -> None:
        locked = [name for name, on in zip(self._names, decision.locked, strict=True) if on]
        text = f"{decision.why}: {', '.join(locked)}" if locked else decision.why
        if text != self._why:
            self._why = text
            self._tell("brake", text)

    def _let_go(self, why: str) -> frozenset[str]:
        if self._catch is not None:
            self._tell("brake", why)
        self._catch, self._why = None, ""
        return frozenset()


def _speed(here: Floats, there: Floats | None, step: float) -> Floats:
    speed = np.zeros_like(here) if there is None else (here - there) / step
    return speed if float(np.linalg.norm(speed)) <= MAX_HAND_SPEED_M_S else np.zeros_like(here)


def _origin(pose: Pose, frame: str) -> Floats:
    """Where is the origin of a body frame?"""
    return np.asarray(frame_of((pose.frames or {})[frame]).position, dtype=np.float64)
