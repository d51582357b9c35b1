"""What does dry friction feel like?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.errors import EffectError
from tensionlab.haptics.effects.effect import Memory, Motion, Rendered, dot, length_of
from tensionlab.haptics.effects.parameters import (
    Damping,
    Force,
    FrictionCoefficient,
    PositiveStiffness,
    require_parameters,
)


class Bristle(NamedTuple):
    """What does friction remember?

    Attributes
    ----------
    position : (..., d) array
        Of the step before, in m.
    stretch : (..., d) array
        z, the bristle's, in m.
    sliding : (...) array of bool
    """

    position: Floats
    stretch: Floats
    sliding: NDArray[np.bool_]


@dataclass(frozen=True)
class Friction:
    """What does dry friction feel like? A bristle that holds the hand, and gives way when pulled too hard.

    The implicit return mapping (Kikuuwe, Takesue, Sano, Mochiyama and Fujimoto 2006, "Admittance and impedance
    representations of friction based on implicit Euler integration"), for the way dp since the step before, of
    length T: ``z* = z + dp``, ``f* = s0 z* + s1 (z* - z)/T``; if ``|f*| > F_c`` it slides, ``f = F_c f*/|f*|``
    and ``z = (f + s1 z/T)/(s0 + s1/T)``, else it sticks, ``f = f*`` and ``z = z*``. The force on the hand is -f.
    F_c is ``mu_s F_n`` while it sticks and ``mu_d F_n`` while it slides. Passive, exactly so with the force at the
    end of each step: ``f·dp >= s0/2 |z|²`` after, less that before. Leaps when it comes loose, by
    ``(mu_s - mu_d) F_n``.

    Parameters
    ----------
    load : float
        F_n in N, where nothing else presses; 1 is a default of this project.
    static, dynamic : float
        mu_s and mu_d; 0.5 and 0.35 are defaults of this project.
    stiffness, damping : float
        s0 in N/m and s1 in N s/m; 400 and 2 are defaults of this project.
    """

    load: Force = 1.0
    static: FrictionCoefficient = 0.5
    dynamic: FrictionCoefficient = 0.35
    stiffness: PositiveStiffness = 400.0
    damping: Damping = 2.0

    def __post_init__(self) -> None:
        require_parameters(self)
        if self.dynamic > self.static:
            raise EffectError(
                f"Friction: dynamic is {self.dynamic}, above static, {self.static}; give dynamic <= static"
            )

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Rub under its own load, in all directions."""
        return self.rub(motion, np.full(motion.position.shape[:-1], self.load), None, memory)

    def rub(self, motion: Motion, load: Floats, normal: Floats | None, memory: Memory = None) -> Rendered:
        """Which force does it exert under a load, along a surface?

        Parameters
        ----------
        motion : Motion
        load : (...) array
            F_n in N.
        normal : (..., d) array or None
            Unit normal of the surface; None: every direction rubs.
        memory : Bristle or None
        """
        if memory is None:
            still = np.zeros(motion.position.shape[:-1], dtype=np.bool_)
            memory = Bristle(motion.position, np.zeros_like(motion.position), still)
        moved = _tangential(motion.position - memory.position, normal)
        before = _tangential(memory.stretch, normal)
        rate = self.damping / motion.step
        trial = self.stiffness * (before + moved) + rate * moved
        size = length_of(trial)
        limit = np.where(memory.sliding, self.dynamic, self.static) * load
        sliding = size > limit
        # Once it gives way it resists with mu_d at once, not from the next step on.
        share = np.where(sliding, self.dynamic * load / np.where(size > 0.0, size, 1.0), 1.0)
        force = share[..., None] * trial
        slid = (force + rate * before) / (self.stiffness + rate)
        stretch = np.where(sliding[..., None], slid, before + moved)
        return Rendered(-force, Bristle(motion.position, stretch, sliding))


def _tangential(vector: Floats, normal: Floats | None) -> Floats:
    return vector if normal is None else vector - dot(vector, normal)[..., None] * normal
