"""Effects as pure functions: the motion of a hand in, the force on it out.

Every effect is a frozen dataclass of its parameters. Its memory from one step to the next (a bristle of friction,
a proxy on a surface) is returned and passed back in: the same motion and memory give the same force. All
quantities are in SI units and world axes; d is the dimension of space.

A stiff or vibrating part of an effect cannot wait for a link (see `tensionlab.haptics.rendering.stability`):
modules render it at their own rate. A `SplitEffect` has an impedance along one axis for a module, and a remainder
for the host.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.support.arrays import Floats

# Memory of an effect: a NamedTuple of its own, such as `Bristle`; None before the first step and for effects
# without one. Given the memory of another kind of effect, an effect starts afresh.
Memory = tuple[object, ...] | None
MAX_HAND_SPEED_M_S = 10.0  # a faster hand was moved by its tracker


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of the hand, or of what the cables hold."""

    position: Floats  # (..., d), in m
    velocity: Floats  # (..., d), in m/s
    time: float | Floats = 0.0  # in s, (...), on the clock of events such as a shot or a grasp
    step: float = 0.001  # time since the previous step, in s


class Rendered(NamedTuple):
    """Force on the hand (..., d) in N, and the memory for the next step.

    ``bypass_slew`` (...) is true where the force is meant to jump, so that the slew limit does not apply.
    """

    force: Floats
    memory: Memory = None
    bypass_slew: bool | NDArray[np.bool_] = False


class Effect(Protocol):
    """Effect that a host can render. Broadcasts over leading axes of the motion."""

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the force on the hand, and the memory for the next step."""
        ...


@dataclass(frozen=True, eq=False)
class AxisImpedance:
    """Module-side part of an effect: an impedance along an axis.

    A push along the axis of ``feed_forward + max(stiffness compression + damping its rate, 0) + amplitude
    sin(2 pi frequency t)`` N, spring and damper in contact only.
    """

    axis: Floats  # unit vector along which it pushes the hand, (d,)
    compression: float = 0.0  # penetration of the hand now, against the axis, in m; negative before contact
    stiffness: float = 0.0  # in N/m
    damping: float = 0.0  # in N s/m
    feed_forward: float = 0.0  # in N
    amplitude: float = 0.0  # in N
    frequency: float = 0.0  # in Hz
    reach: float = math.inf  # further compression up to which it holds, in m

    def push(self, velocity: Floats) -> Floats:
        """Return this force (d,) in N without the vibration, for a hand with a velocity (d,)."""
        size = self.feed_forward
        if self.compression > 0.0:
            size += max(self.stiffness * self.compression - self.damping * float(self.axis @ velocity), 0.0)
        return size * self.axis


class SplitEffect(Effect, Protocol):
    """Effect with a part for a module. Both methods take one motion, not a batch."""

    def module_side(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """Return the part for a module now; None if there is none."""
        ...

    def host_side(self, motion: Motion, memory: Memory = None) -> Rendered:
        """Return the remainder for the host while a module renders its part."""
        ...


def is_split(effect: object) -> TypeGuard[SplitEffect]:
    """Return whether an effect has a part for a module; `isinstance` takes 50 times as long for a protocol."""
    return hasattr(effect, "module_side") and hasattr(effect, "host_side")


def relative(motion: Motion, to: Motion) -> Motion:
    """Return a motion relative to that of another hand, ``to``, for what is between the two, such as a bow."""
    return Motion(motion.position - to.position, motion.velocity - to.velocity, motion.time, motion.step)


def dot(a: Floats, b: Floats) -> Floats:
    """Return the inner product of vectors (..., d)."""
    product: Floats = np.vecdot(a, b)
    return product


def norm(vector: Floats) -> Floats:
    """Return the length of vectors (..., d)."""
    return np.sqrt(dot(vector, vector))


def normalized(vector: Floats) -> Floats:
    """Return unit vectors along vectors (..., d); zero for zero."""
    size = norm(vector)[..., None]
    return vector / np.where(size > 0.0, size, 1.0)


def smoothstep(share: ArrayLike) -> Floats:
    """Return ``3 s² - 2 s³`` with s held in [0, 1]: from 0 to 1, level at both ends."""
    s = np.clip(share, 0.0, 1.0)
    smooth: Floats = s * s * (3.0 - 2.0 * s)
    return smooth
