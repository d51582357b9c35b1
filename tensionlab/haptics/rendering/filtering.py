"""What happens to every force, between an effect and the allocator?

The velocity is low-passed, the effect renders, the force changes only so fast, and the passivity controller looks
after the energy. What the rig cannot render is then scaled down by the allocator, ``nearest="direction"``,
which also keeps the cables taut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.effect import Effect, Memory, Motion, Rendered, length_of
from tensionlab.haptics.effects.parameters import PositiveForce, Range, require_parameters
from tensionlab.haptics.rendering.passivity import Observed, PassivityController

MAX_FORCE_N = 1000.0
"""Largest force that is asked of any rig, in N."""


def low_passed(new: Floats, before: Floats | None, cutoff: float, step: float) -> Floats:
    """What is left of a signal below a frequency? First order: ``y + (1 - exp(-2 pi f T)) (x - y)``.

    Parameters
    ----------
    new : array
        x.
    before : array or None
        y of the step before; None: it begins with x.
    cutoff, step : float
        f in Hz and T in s.
    """
    if before is None:
        return new
    return before - math.expm1(-2.0 * math.pi * cutoff * step) * (new - before)


def slewed(wanted: Floats, before: Floats, most: float, sudden: bool | NDArray[np.bool_] = False) -> Floats:
    """How far may a force go towards the wanted one?

    Straight, and by no more than ``most`` N; all the way where it is meant to leap.

    Parameters
    ----------
    wanted, before : (..., d) arrays
        In N.
    most : float
        In N.
    sudden : bool or (...) array of bool
    """
    change = wanted - before
    size = length_of(change)
    share = np.where(np.asarray(sudden) | (size <= most), 1.0, most / np.where(size > 0.0, size, 1.0))
    return before + share[..., None] * change


def at_most(force: Floats, most: float) -> Floats:
    """Return forces (..., d) in N, those longer than ``most`` N shortened to it."""
    return force * np.minimum(1.0, most / np.maximum(length_of(force), most))[..., None]


class Staged(NamedTuple):
    """What do the stages remember? The velocity and the force of the step before, and what theirs do."""

    velocity: Floats
    force: Floats
    effect: Memory
    observed: Observed | None


@dataclass(frozen=True)
class Stages:
    """What is to be asked for, if an effect is to be felt safely? An effect itself.

    Parameters
    ----------
    effect : Effect
        With its start-up ramp and its end when input is stale: see `Ramp` and `WhileFresh`.
    controller : PassivityController or None
    cutoff : float
        Of the velocity's low-pass, in Hz; 60 is a default of this project.
    slew : float
        Most change of the force, in N/s; 200 is a default of this project. A force that is meant to leap does, a
        recoil say; the modules have their own limit, 60 N/s a cable as they come.
    most : float
        Largest force, in N. Without it, one that no rig renders would take as long to go as it took to come.
    """

    effect: Effect
    controller: PassivityController | None = None
    cutoff: Annotated[float, Range("Hz", 0.0, 1e12, positive=True)] = 60.0
    slew: Annotated[float, Range("N/s", 0.0, 1e12, positive=True)] = 200.0
    most: PositiveForce = MAX_FORCE_N

    def __post_init__(self) -> None:
        require_parameters(self)

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Render the effect, look after its energy, and let the force go there; it begins with none."""
        staged = memory or Staged(motion.velocity, np.zeros_like(motion.position), None, None)
        velocity = low_passed(motion.velocity, staged.velocity, self.cutoff, motion.step)
        motion = replace(motion, velocity=velocity)
        done = self.effect.render(motion, staged.effect)
        slow = slewed(at_most(done.force, self.most), staged.force, self.slew * motion.step, done.sudden)
        force, observed = slow, None
        if self.controller is not None:
            # After the slew: the observer has to know what is really asked for, and its damper must not wait.
            force, _, observed = self.controller.correct(slow, motion, staged.observed)
        return Rendered(force, Staged(velocity, slow, done.memory, observed), done.sudden)
