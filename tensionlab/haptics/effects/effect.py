"""What is an effect? A pure function from how a hand moves to the force on it.

Every effect is a frozen dataclass of its parameters with one method, `render`. What it remembers from one step
to the next (a bristle of friction, a proxy on a surface) it returns and is handed back: nothing is hidden, and
the same motion gives the same force. All quantities are in SI units and world axes; d is the dimension of space.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.arrays import Floats

Memory = Any
"""What an effect remembers: None before its first step, then whatever it returned. Each effect has its own."""
LEAP = 10.0
"""Faster than this, in m/s, nobody moves: who tracks a hand has put it elsewhere."""


@dataclass(frozen=True, eq=False)
class Motion:
    """How does the hand move, or whatever the cables hold?

    Attributes
    ----------
    position : (..., d) array
        In m.
    velocity : (..., d) array
        In m/s.
    time : float or (...) array
        In s, on the clock on which events (a shot, a grasp) have their times.
    step : float
        Time since the step before, in s.
    age : float or (...) array
        How old position and velocity are, in s.
    """

    position: Floats
    velocity: Floats
    time: float | Floats = 0.0
    step: float = 0.001
    age: float | Floats = 0.0


class Rendered(NamedTuple):
    """Which force acts on the hand now?

    Attributes
    ----------
    force : (..., d) array
        In N.
    memory
        For the effect's next step.
    sudden : bool or (...) array of bool
        Whether this force is meant to leap, so that the limit on its change has to stand aside.
    """

    force: Floats
    memory: Memory = None
    sudden: bool | NDArray[np.bool_] = False


class Effect(Protocol):
    """What every effect can do. Broadcasts over leading axes of the motion."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Which force acts on the hand, and what is to be remembered?"""
        ...


def relative(motion: Motion, to: Motion) -> Motion:
    """How does one hand move, seen from another? For what is between the two, as a bow."""
    return replace(motion, position=motion.position - to.position, velocity=motion.velocity - to.velocity)


def dot(a: Floats, b: Floats) -> Floats:
    """Inner product of vectors (..., d)."""
    product: Floats = np.einsum("...i,...i->...", a, b)
    return product


def length_of(vector: Floats) -> Floats:
    """Length of vectors (..., d)."""
    return np.sqrt(dot(vector, vector))


def along(vector: Floats) -> Floats:
    """Unit vectors along vectors (..., d); zero for zero."""
    size = length_of(vector)[..., None]
    return vector / np.where(size > 0.0, size, 1.0)


def smoothstep(share: ArrayLike) -> Floats:
    """A smooth way from 0 to 1, level at both ends: ``3 s² - 2 s³``, with s held in [0, 1]."""
    s = np.clip(share, 0.0, 1.0)
    smooth: Floats = s * s * (3.0 - 2.0 * s)
    return smooth
