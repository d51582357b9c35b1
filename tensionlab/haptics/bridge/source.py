"""Demand source of the bridge: the client's effects, on a hand tracked by the client or by the cables."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Protocol

import numpy as np

from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, EffectError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.events import RunEvents
from tensionlab.haptics.bridge.messages import HAND
from tensionlab.haptics.effects.effect import Effect, Motion, smoothstep
from tensionlab.haptics.rendering.assignment import EffectFailed
from tensionlab.haptics.rendering.renderer import Renderer, fade_in


class Inner(Protocol):
    """Demand source that takes a client's effects, and a share of the whole force."""

    renderer: Renderer

    def __call__(self, state: RigState, overrides: Mapping[str, Effect], share: float) -> Demand:
        """Return the demand of this cycle. At a share of 0: no force, and no brake."""
        ...


NO_EFFECTS: Mapping[str, Effect] = MappingProxyType({})


class BridgedDemand:
    """Demand source that renders a client's effects.

    The force fades while a client is silent; then, and before the first frame, the cables are held taut. A client
    whose effects fail loses them and the command; the cycle continues without them, and the force fades by the
    slew limit. ``inner`` gets the effects: `FreeEffects`, or a scenario's demand.
    """

    def __init__(self, client: ClientState, inner: Inner, events: RunEvents | None = None) -> None:
        self._client, self._inner, self._events = client, inner, events
        self._fade, self._latest = 0.0, 0.0

    def __call__(self, state: RigState) -> Demand:
        """Return the demand of this cycle."""
        age = self._client.age(self._client.clock())
        self._fade = float(fade_in(age, state.time - self._latest, self._fade))
        self._latest = state.time
        share = float(smoothstep(self._fade))
        demand = self._rendered(state, share)
        if self._events is not None:
            self._events.take(state, demand, share, self._inner.renderer)
        return replace(demand, stop=self._client.stop_requested)

    def _rendered(self, state: RigState, share: float) -> Demand:
        """Return the demand with the client's effects or, if they fail, without."""
        effects = self._client.effects
        if not effects:
            return self._inner(state, NO_EFFECTS, share)
        try:
            return _require_finite(self._inner(state, effects, share))
        except Exception as error:
            if isinstance(error, EffectFailed) and error.effect not in effects:
                raise  # the scenario's own
            if not isinstance(error, EffectError) or error.__cause__ is not None:  # not its parameters alone
                logging.getLogger(__name__).exception("an effect of a client failed")
            reason = str(error) if isinstance(error, EffectError) else f"{type(error).__name__}: {error}"
            self._client.dismiss(f"the effects are removed: {reason}"[:MAX_MESSAGE_CHARACTERS])
            if self._events is not None:
                self._events.note("removed", reason)
            return self._inner(state, NO_EFFECTS, share)


def _require_finite(demand: Demand) -> Demand:
    numbers = list(demand.impedances.values())
    wrenches = [wrench for wrench in (demand.wrench, demand.desired) if wrench is not None]
    if not (np.isfinite(numbers).all() and np.isfinite(wrenches).all()):
        raise EffectError("the force of the effects is not finite")
    return demand


class FreeEffects:
    """Demand source of the client's effects alone, on a hand tracked by the client or else by the cables."""

    def __init__(self, client: ClientState) -> None:
        self._client, self._latest = client, 0.0
        self.renderer = Renderer(client.rig)

    def __call__(self, state: RigState, overrides: Mapping[str, Effect], share: float) -> Demand:
        """Return the demand of this cycle."""
        return self.renderer(overrides, self._motion(state), state, share)

    def _motion(self, state: RigState) -> Motion:
        step = max(state.time - self._latest, 1e-4)
        self._latest = state.time
        tracked = self._client.motion(HAND, self._client.clock())
        if tracked is not None:
            return Motion(tracked.position, tracked.velocity, state.time, step)
        velocity = state.twist[: self._client.rig.dimension]
        return Motion(state.pose.position, velocity, state.time, step)


def tracked_pose(client: ClientState) -> Callable[[float], Pose]:
    """Return a tracker for the runner: the point and the bodies with modules, by the client's frames.

    A body that no frame has yet is at home, and at rest.
    """
    rig = client.rig

    def tracker(_: float) -> Pose:
        now = client.clock()
        hand = client.motion(HAND, now)
        frames = {}
        for name, rest in rig.at_rest.items():
            body = client.motion(name, now)
            frames[name] = rest if body is None else (body.position, body.rotation)
        return Pose(rig.home if hand is None else hand.position, frames=frames)

    return tracker
