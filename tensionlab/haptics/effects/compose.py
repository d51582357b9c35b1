"""How do several effects make one, and how does one come in, or go when nobody knows where the hand is?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.effect import Effect, Memory, Motion, Rendered, smoothstep
from tensionlab.haptics.effects.on_module import AxisImpedance, OnModule
from tensionlab.haptics.effects.parameters import Duration, DurationOrNone, require_parameters


@dataclass(frozen=True)
class Sum:
    """What do several effects feel like together? Their forces add up.

    Parameters
    ----------
    parts : tuple of Effect
        To send parts of them to modules, give them to `divide`.
    """

    parts: tuple[Effect, ...]

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Add the forces; the memory is a tuple of the parts' own."""
        memories = memory or (None,) * len(self.parts)
        force = np.zeros_like(motion.position)
        sudden: bool | NDArray[np.bool_] = False
        kept = []
        for part, own in zip(self.parts, memories, strict=True):
            done = part.render(motion, own)
            force = force + done.force
            sudden = np.logical_or(sudden, done.sudden)
            kept.append(done.memory)
        return Rendered(force, tuple(kept), sudden)


@dataclass(frozen=True)
class Ramp:
    """What does an effect feel like that comes in slowly? Its force, times a share that rises from 0 to 1.

    The share is ``clip((time - begin) / duration, 0, 1)``. Continuous, if the effect is.

    Parameters
    ----------
    effect : Effect
    begin : float
        Time of the motion at which it starts to rise, in s.
    duration : float
        In s. The default is the force rise of CHAI3D's devices (Conti et al. 2003, "The CHAI libraries").
    """

    effect: Effect
    begin: float = 0.0
    duration: Duration = 2.0

    def __post_init__(self) -> None:
        require_parameters(self)

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Scale the force; the effect itself goes on as if nothing were."""
        done = self.effect.render(motion, memory)
        return done._replace(force=self.share(motion)[..., None] * done.force)

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """Scale what its effect says."""
        return _scaled(self.effect, motion, memory, float(self.share(motion)))

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Scale what its effect leaves."""
        done = _left(self.effect, motion, memory)
        return done._replace(force=self.share(motion)[..., None] * done.force)

    def share(self, motion: Motion) -> Floats:
        """Which share of the force is there by now?"""
        return np.clip((np.asarray(motion.time) - self.begin) / self.duration, 0.0, 1.0)


PATIENCE, FADE = 0.10, 0.15
"""Age of a motion that changes nothing, and how long a force then takes to go, in s: defaults of this project. The
patience is five frames at 50 Hz; both together are the 0.25 s after which modules give up."""


def way_in(
    age: float | Floats, step: float, before: float | Floats | None, patience: float = PATIENCE, fade: float = FADE
) -> Floats:
    """How far in is what depends on somebody's word, from 0 to 1? Its share of the force is `smoothstep` of that.

    It is out when nothing has been heard for ``patience + fade``, and comes in no faster than in ``fade``.

    Parameters
    ----------
    age : float or array
        Time since the latest word, in s; may be infinite.
    step : float
        Time since the step before, in s.
    before : float or array or None
        The way then; None: as far in as the age allows.
    patience, fade : float
        In s.
    """
    allowed = np.clip((patience + fade - np.asarray(age)) / fade, 0.0, 1.0)
    return allowed if before is None else np.minimum(allowed, before + step / fade)


@dataclass(frozen=True)
class WhileFresh:
    """What does an effect feel like when nobody knows any more where the hand is? It goes to zero, smoothly.

    The force is that of the last known motion, times a share that goes from 1 to 0 by a smoothstep, between
    ``patience`` and ``patience + fade`` of age. Once the motion is known again, the share comes back no faster
    than in ``fade``. Continuous, if the effect is.

    Parameters
    ----------
    effect : Effect
    patience : float
        Age that changes nothing, in s; see `PATIENCE`.
    fade : float
        In s; see `FADE`.
    """

    effect: Effect
    patience: DurationOrNone = PATIENCE
    fade: Duration = FADE

    def __post_init__(self) -> None:
        require_parameters(self)

    @property
    def silent_after(self) -> float:
        """At which age is there no force any more, in s?"""
        return self.patience + self.fade

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Scale the force; the memory is the effect's own, and the way back from 0 to 1 so far."""
        inner, way = memory or (None, None)
        done = self.effect.render(motion, inner)
        way = self._way(motion, way)
        return done._replace(force=smoothstep(way)[..., None] * done.force, memory=(done.memory, way))

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """Scale what its effect says; a module that hears nothing any more times out by itself."""
        inner, way = memory or (None, None)
        return _scaled(self.effect, motion, inner, float(smoothstep(self._way(motion, way))))

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Scale what its effect leaves."""
        inner, way = memory or (None, None)
        done = _left(self.effect, motion, inner)
        way = self._way(motion, way)
        return done._replace(force=smoothstep(way)[..., None] * done.force, memory=(done.memory, way))

    def _way(self, motion: Motion, before: Floats | None) -> Floats:
        return way_in(motion.age, motion.step, before, self.patience, self.fade)


def _scaled(effect: Effect, motion: Motion, memory: Memory, share: float) -> AxisImpedance | None:
    part = effect.on_module(motion, memory) if isinstance(effect, OnModule) else None
    if part is None:
        return None
    return replace(
        part,
        stiffness=share * part.stiffness,
        damping=share * part.damping,
        feed_forward=share * part.feed_forward,
        amplitude=share * part.amplitude,
    )


def _left(effect: Effect, motion: Motion, memory: Memory) -> Rendered:
    return effect.on_host(motion, memory) if isinstance(effect, OnModule) else effect.render(motion, memory)
