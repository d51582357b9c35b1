"""What a client asks for, as a demand source of the runner: its effects, on a hand that it or the cables track."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

from tensionlab.demand import Demand, Floats, Pose, RigState
from tensionlab.haptics.bridge.mailbox import Mailbox
from tensionlab.haptics.effects.effect import Effect, Memory, Motion, smoothstep
from tensionlab.model.rig import Rig

HAND = "hand"
"""The body that the cables pull on."""
PATIENCE, FADE = 0.10, 0.15
"""After so many s without a frame the force goes to zero, within so many more."""


class BridgedDemand:
    """Renders the effects in a mailbox. A demand source.

    The hand is where the client says, or, if it does not, where the cables say. A client that falls silent fades
    to no force; then, and before the first frame, the cables are held taut.

    Parameters
    ----------
    rig : Rig
    mailbox : Mailbox
    told : callable
        Hears, each cycle, the state, the wrench asked for, and the share of it that was there.
    """

    def __init__(
        self, rig: Rig, mailbox: Mailbox, told: Callable[[RigState, Floats, float], None] | None = None
    ) -> None:
        self._rig, self._mailbox, self._told = rig, mailbox, told
        self._memories: dict[str, tuple[Effect, Memory]] = {}
        self._share = 0.0
        self._latest = 0.0

    def __call__(self, state: RigState) -> Demand:
        """What to render now?"""
        now = time.monotonic()
        step = max(state.time - self._latest, 1e-4)
        self._latest = state.time
        motion = self._motion(state, now, step)
        force = self._force(self._mailbox.effects, motion)
        # Silence takes the force away at its own pace; frames that come again bring it back no faster than that.
        fresh = 1.0 - float(smoothstep((self._mailbox.age(now) - PATIENCE) / FADE))
        self._share = min(fresh, self._share + step / FADE)
        wrench = np.zeros(self._rig.n)
        wrench[: self._rig.dimension] = self._share * force
        if self._told is not None:
            self._told(state, wrench, self._share)
        return Demand(wrench if self._share > 0.0 else None, stop=self._mailbox.stop_wanted)

    def _motion(self, state: RigState, now: float, step: float) -> Motion:
        d = self._rig.dimension
        tracked = self._mailbox.motion(HAND, now)
        if tracked is not None and tracked.position.shape == (d,):
            return Motion(tracked.position, tracked.velocity, state.time, step, tracked.age)
        return Motion(state.pose.position, state.twist[:d], state.time, step, float(np.min(state.ages)))

    def _force(self, effects: Mapping[str, Effect], motion: Motion) -> Floats:
        """Add the forces of all effects. One that is changed forgets, unless only its parameters are others."""
        total: Floats = np.zeros(self._rig.dimension)
        kept: dict[str, tuple[Effect, Memory]] = {}
        for name, effect in effects.items():
            before, memory = self._memories.get(name, (effect, None))
            rendered = effect.render(motion, memory if type(before) is type(effect) else None)
            total = total + rendered.force
            kept[name] = (effect, rendered.memory)
        self._memories = kept
        return total


def tracked_pose(rig: Rig, mailbox: Mailbox) -> Callable[[float], Pose]:
    """Where are the point and the bodies that modules ride on, by the client's frames? A tracker of the runner.

    What no frame has told yet is at home, and at rest.
    """

    def tracker(_: float) -> Pose:
        now = time.monotonic()
        hand = mailbox.motion(HAND, now)
        frames = {}
        for name, rest in rig.at_rest.items():
            body = mailbox.motion(name, now)
            frames[name] = rest if body is None else (body.position, body.rotation)
        position = rig.home if hand is None or hand.position.shape != rig.home.shape else hand.position
        return Pose(position, frames=frames)

    return tracker
