"""Scenario as a demand source: desired force, impedances and brakes, cycle by cycle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tensionlab.demand import Demand, Pose, RigState
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S, Effect, Motion, relative
from tensionlab.haptics.rendering.brakes import BrakeContact, brake_strengths, decide
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.model.pose import frame_of
from tensionlab.scenarios.scenario import BrakeTarget, Scenario
from tensionlab.support.arrays import Floats

FADE_IN_S = 0.25  # fade-in of all force: the hand's position is unknown when a run begins
Notify = Callable[[str, str], None]  # receives a kind of event (phase, brake) and its text


class ScenarioDemand:
    """Demand source of a scenario, which may be repeated.

    ``notify`` is called when a phase begins, and when the decision about the brakes changes.
    """

    def __init__(self, scenario: Scenario, notify: Notify | None = None, *, repeat: bool = False) -> None:
        self._scenario = scenario
        self._period = scenario.seconds if repeat else math.inf
        self._own = {name for phase in scenario.phases for name in phase.effects}
        self._notify: Notify = notify if notify is not None else lambda kind, text: None
        self.renderer = Renderer(scenario.rig)
        self._strengths = brake_strengths(scenario.rig)
        self._last: tuple[float, Pose] | None = None  # time and pose
        self._phases: tuple[str, ...] = ()
        self._contact: BrakeContact | None = None
        self._brake_text = ""

    def __call__(
        self, state: RigState, overrides: Mapping[str, Effect] | None = None, share: float = 1.0
    ) -> Demand:
        """Return the demand of this cycle.

        Overrides replace the scenario's effects of the same names, in their phases; others are rendered all the
        time. ``share`` is the share of all force, from 0 to 1; at 0 no brake is on, either.
        """
        scenario = self._scenario
        share = share * min(state.time / FADE_IN_S, 1.0)
        motion = self._motion(state)
        phases = scenario.active_phases(float(motion.time))
        names = tuple(phase.name for phase in phases)
        for name in names:
            if name not in self._phases:
                self._notify("phase", name)
        self._phases = names
        effects: dict[str, Effect] = {}
        for phase in phases:
            effects |= phase.effects
        for name, effect in (overrides or {}).items():
            if name in effects or name not in self._own:
                effects[name] = effect
        demand = self.renderer(effects, motion, state, share)
        holds = [phase.hold for phase in phases if phase.hold is not None and share > 0.0]
        return replace(demand, brakes=self._brakes(holds[0], motion, state) if holds else self._release())

    def _motion(self, state: RigState) -> Motion:
        """Return the motion of the hand in the frame of the effects.

        Its velocity is the difference of its positions: that of the cables is incomplete, and anchors move too.
        """
        pose = state.pose
        last_time, last = self._last or (-math.inf, None)
        step = 1.0 / self._scenario.rate if last is None else max(state.time - last_time, 1e-4)
        self._last = (state.time, pose)
        velocity = _velocity(pose.position, None if last is None else last.position, step)
        time = math.fmod(state.time, self._period)
        hand = Motion(pose.position, velocity, time, step)
        frame = self._scenario.frame
        if frame is None:
            return hand
        origin = body_origin(pose, frame)
        velocity = _velocity(origin, None if last is None else body_origin(last, frame), step)
        return relative(hand, replace(hand, position=origin, velocity=velocity))

    def _brakes(self, target: BrakeTarget, motion: Motion, state: RigState) -> frozenset[str]:
        """Return the names of the modules whose brakes should be on."""
        rig = self._scenario.rig
        decision = decide(
            state.structure[: rig.dimension],
            motion.position,
            motion.velocity,
            target.wall(motion.position),
            rig.limits,
            np.where(state.active, self._strengths, 0.0),
            self._contact,
            replace(target.timing, latency=target.timing.latency + self.renderer.delay),
            target.cap,
        )
        self._contact = decision.contact
        locked = [module.name for module, on in zip(rig.modules, decision.locked, strict=True) if on]
        text = f"{decision.reason}: {', '.join(locked)}" if locked else decision.reason
        if text != self._brake_text:
            self._brake_text = text
            self._notify("brake", text)
        return frozenset(locked)

    def _release(self) -> frozenset[str]:
        if self._contact is not None:
            self._notify("brake", "no hold")
        self._contact, self._brake_text = None, ""
        return frozenset()


def _velocity(here: Floats, there: Floats | None, step: float) -> Floats:
    """Return the velocity between two positions; zero after a jump, or without a position before."""
    velocity = np.zeros_like(here) if there is None else (here - there) / step
    return velocity if float(np.linalg.norm(velocity)) <= MAX_HAND_SPEED_M_S else np.zeros_like(here)


def body_origin(pose: Pose, frame: str | None) -> Floats:
    """Return the origin of a body frame, (d,) in m, or of the world."""
    if frame is None:
        return np.zeros_like(pose.position)
    return np.asarray(frame_of((pose.frames or {})[frame]).position, dtype=np.float64)
