"""Filters between effects and the demand: velocity low-pass, slew limit, largest force, fade-in."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tensionlab.errors import EffectError
from tensionlab.haptics.effects.effect import Motion, norm
from tensionlab.haptics.effects.parameters import Number, PositiveForce, checked_dataclass
from tensionlab.haptics.rendering.stability import Observed, PassivityController
from tensionlab.support.arrays import Floats

MAX_FORCE_N = 1000.0  # largest force that is desired of any rig
# Age of a motion at which the force begins to fade (five frames at 50 Hz), and duration of the fade; together the
# 0.25 s after which modules time out. Defaults of this project.
FADE_DELAY_S, FADE_S = 0.10, 0.15


def low_pass(new: Floats, before: Floats | None, cutoff: float, step: float) -> Floats:
    """Return a low-passed signal, first order: ``y + (1 - exp(-2 pi f T)) (x - y)``.

    x is new, y the previous result (None: it starts with x), f the cutoff in Hz, and T the step in s.
    """
    if before is None:
        return new
    return before - math.expm1(-2.0 * math.pi * cutoff * step) * (new - before)


def limit_force_slew(
    desired: Floats, before: Floats, change: float, bypass: bool | NDArray[np.bool_] = False
) -> Floats:
    """Return forces (..., d) moved towards the desired ones by at most ``change`` N, or fully where ``bypass``."""
    way = desired - before
    return before + np.where(np.asarray(bypass)[..., None], way, limit_force(way, change))


def limit_force(force: Floats, limit: float) -> Floats:
    """Return forces (..., d) in N, those longer than the limit shortened to it."""
    return force * (limit / np.maximum(norm(force), limit))[..., None]


def fade_in(age: float | Floats, step: float, before: float | Floats | None) -> Floats:
    """Return the fade of a force that depends on messages, from 0 to 1; its share of the force is `smoothstep`.

    It is 0 when no message has come for ``FADE_DELAY_S + FADE_S``, and rises to 1 in ``FADE_S`` at the fastest.
    ``age`` is the time in s since the latest message, ``step`` the time since the previous fade ``before``.
    """
    allowed = np.clip((FADE_DELAY_S + FADE_S - np.asarray(age)) / FADE_S, 0.0, 1.0)
    return allowed if before is None else np.minimum(allowed, before + step / FADE_S)


class StageMemory(NamedTuple):
    """Memory of the stages: low-passed velocity, slewed force, and the passivity observer's memory."""

    velocity: Floats
    force: Floats
    observed: Observed | None = None


@checked_dataclass(EffectError)
class Stages:
    """Stages that every force passes.

    Effects see the low-passed velocity; their force is limited in size and slew, and then the passivity controller
    corrects it. A force that is meant to jump, such as a recoil, bypasses the slew limit; modules have their own,
    60 N/s per cable by default. Without ``max_force``, a force that no rig renders would be as slow to fade as to
    build up. The defaults are choices of this project. The allocator scales down infeasible forces later.
    """

    controller: PassivityController | None = None
    cutoff: Annotated[Number, Field(gt=0.0, le=1e12)] = 60.0
    """Cutoff of the velocity's low-pass, in Hz."""
    slew: Annotated[Number, Field(gt=0.0, le=1e12)] = 200.0
    """Largest change of the force, in N/s."""
    max_force: PositiveForce = MAX_FORCE_N
    """Largest force, in N."""

    def smooth(self, motion: Motion, memory: StageMemory | None) -> Motion:
        """Return the motion with its velocity low-passed, for the effects."""
        before = None if memory is None else memory.velocity
        return replace(motion, velocity=low_pass(motion.velocity, before, self.cutoff, motion.step))

    def filter(
        self, force: Floats, motion: Motion, bypass: bool | NDArray[np.bool_], memory: StageMemory | None
    ) -> tuple[Floats, StageMemory]:
        """Return the force to demand instead of the effects' force (..., d), and the memory for the next step.

        The motion is that of `smooth`; ``bypass`` is true where the force is meant to jump.
        """
        before = np.zeros_like(force) if memory is None else memory.force
        slewed = limit_force_slew(limit_force(force, self.max_force), before, self.slew * motion.step, bypass)
        if self.controller is None:
            return slewed, StageMemory(motion.velocity, slewed)
        # After the slew: the observer must know the commanded force, and its damper must not be slowed.
        safe, _, observed = self.controller.correct(slewed, motion, None if memory is None else memory.observed)
        return safe, StageMemory(motion.velocity, slewed, observed)
