"""What a client asks for, as a demand source of the runner: its effects, on a hand that it or the cables track."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Protocol

import numpy as np

from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, EffectError
from tensionlab.haptics.bridge.client_state import HAND, Mailbox
from tensionlab.haptics.effects.effect import Effect, Motion, smoothstep
from tensionlab.haptics.rendering.assignment import EffectFailed
from tensionlab.haptics.rendering.filtering import fade_in
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.model.rig import Rig


class Inner(Protocol):
    """What a client's effects go to: a demand source that takes them, and a share of all force.

    Attributes
    ----------
    renderer : Renderer
        Of its effects.
    """

    renderer: Renderer

    def __call__(self, state: RigState, over: Mapping[str, Effect], share: float) -> Demand:
        """What is to be felt now? At a share of 0, no force, and no brake."""
        ...


NOTHING: Mapping[str, Effect] = MappingProxyType({})
Told = Callable[[RigState, Demand, float, Renderer], None]
"""Hears of each cycle: the state, what was asked for, the share of the force that was there, and the renderer."""


class BridgedDemand:
    """Renders what is in a mailbox. A demand source.

    A client that falls silent fades to no force; then, and before the first frame, the cables are held taut. One
    whose effects fail loses them and the command, and the cycle goes on without: the force fades by the slew.

    Parameters
    ----------
    mailbox : Mailbox
    inner : Inner
        Gets the client's effects: `FreeEffects`, or a scenario's demand.
    told : callable, optional
        See `Told`.
    note : callable, optional
        Hears what else happens: a kind of event, and a text.
    """

    def __init__(
        self,
        mailbox: Mailbox,
        inner: Inner,
        told: Told | None = None,
        note: Callable[[str, str], None] | None = None,
    ) -> None:
        self._mailbox, self._inner, self._told, self._note = mailbox, inner, told, note
        self._fade, self._latest = 0.0, 0.0

    def __call__(self, state: RigState) -> Demand:
        """What to render now?"""
        age = self._mailbox.age(time.monotonic())
        self._fade = float(fade_in(age, state.time - self._latest, self._fade))
        self._latest = state.time
        share = float(smoothstep(self._fade))
        demand = self._rendered(state, share)
        if self._told is not None:
            self._told(state, demand, share, self._inner.renderer)
        return replace(demand, stop=self._mailbox.stop_wanted)

    def _rendered(self, state: RigState, share: float) -> Demand:
        """Return what is to be rendered: with the client's effects or, if these fail, without."""
        effects = self._mailbox.effects
        if not effects:
            return self._inner(state, NOTHING, share)
        try:
            return _require_finite(self._inner(state, effects, share))
        except Exception as error:
            if isinstance(error, EffectFailed) and error.effect not in effects:
                raise  # the scenario's own
            if not isinstance(error, EffectError) or error.__cause__ is not None:
                logging.getLogger(__name__).exception(
                    "an effect of a client failed"
                )  # not by its parameters alone
            why = f"{error if isinstance(error, EffectError) else f'{type(error).__name__}: {error}'}"
            self._mailbox.dismiss(f"the effects are removed: {why}"[:MAX_MESSAGE_CHARACTERS])
            if self._note is not None:
                self._note("removed", why)
            return self._inner(state, NOTHING, share)


def _require_finite(demand: Demand) -> Demand:
    numbers = [each for spring in demand.impedances.values() for each in vars(spring).values()]
    if not (np.isfinite(numbers).all() and (demand.wrench is None or np.isfinite(demand.wrench).all())):
        raise EffectError("what the effects ask for is not finite")
    return demand


class FreeEffects:
    """The client's effects and nothing else.

    The hand is where the client says, or, if it does not, where the cables say.

    Parameters
    ----------
    rig : Rig
    mailbox : Mailbox

    Attributes
    ----------
    renderer : Renderer
    """

    def __init__(self, rig: Rig, mailbox: Mailbox) -> None:
        self._dimension, self._mailbox, self._latest = rig.dimension, mailbox, 0.0
        self.renderer = Renderer(rig)

    def __call__(self, state: RigState, over: Mapping[str, Effect], share: float) -> Demand:
        """What is to be felt now?"""
        return self.renderer(over, self._motion(state), state, share)

    def _motion(self, state: RigState) -> Motion:
        step = max(state.time - self._latest, 1e-4)
        self._latest = state.time
        tracked = self._mailbox.motion(HAND, time.monotonic())
        if tracked is not None:
            return Motion(tracked.position, tracked.velocity, state.time, step, tracked.age)
        velocity = state.twist[: self._dimension]
        return Motion(state.pose.position, velocity, state.time, step, float(np.min(state.ages)))


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
        position = rig.home if hand is None else hand.position
        return Pose(position, frames=frames)

    return tracker
