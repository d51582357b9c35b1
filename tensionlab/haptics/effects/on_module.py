"""Which part of an effect must a module render by itself, at its own rate?

What is stiff, or vibrates, cannot wait for a link (see `tensionlab.haptics.rendering.stability`). A module knows
its own cable only: it pulls with ``feed_forward + stiffness max(length - rest, 0) + damping max(speed of paying
out, 0) + amplitude sin(2 pi frequency t)``. So an effect that has such a part says what happens along one axis,
and `divide` finds the cable that lies best along it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.demand import Impedance
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, EffectError
from tensionlab.haptics.effects.effect import Effect, Memory, Motion, Rendered
from tensionlab.haptics.rendering.stability import beyond, capped

AHEAD_M = 0.5
"""Further out of contact than this, in m, no module renders a wall: set-points come many times before it could."""
ALIGNED = math.cos(math.radians(45.0))
"""Cosine between axis and cable below which no cable is good enough: the published threshold of a convincing
direction."""


@dataclass(frozen=True, eq=False)
class AxisImpedance:
    """What is to happen along an axis, faster than a host can ask for it?

    A push along the axis of ``feed_forward + stiffness max(compression, 0) + damping max(its rate, 0)
    + amplitude sin(2 pi frequency t)`` N.

    Attributes
    ----------
    axis : (d,) array
        Unit vector along which it pushes the hand.
    compression : float
        How far the hand is in now, against the axis, in m; negative before contact.
    stiffness, damping : float
        In N/m and N s/m.
    feed_forward, amplitude, frequency : float
        In N, N and Hz.
    """

    axis: Floats
    compression: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    feed_forward: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.0

    def push(self, velocity: Floats) -> Floats:
        """Which force is that (d,), vibration aside, in N? The velocity (d,) is the hand's."""
        size = self.feed_forward
        if self.compression > 0.0:
            size += self.stiffness * self.compression + self.damping * max(-float(self.axis @ velocity), 0.0)
        return size * self.axis


@dataclass(frozen=True)
class ModuleLimits:
    """What does a module render at most? It refuses an impedance as a whole that goes beyond.

    The defaults are those of the firmware's parameters.

    Attributes
    ----------
    lower, upper : float
        Tensions in N. The lower one is held under a vibration too, by as much more feed-forward.
    stiffness, damping : float
        In N/m and N s/m.
    length : float
        Of a cable at rest, in m.
    """

    lower: float = 0.5
    upper: float = 6.0
    stiffness: float = 500.0
    damping: float = 10.0
    length: float = 5.0


class EffectFailed(EffectError):  # noqa: N818 - what happened
    """An effect that could not be rendered, or whose force is no number.

    Attributes
    ----------
    effect : int or str
        Its index, in the order in which effects were given, or its name.
    why : str
    """

    def __init__(self, effect: int | str, why: str) -> None:
        super().__init__(f"effect {effect!r} failed: {why}"[:MAX_MESSAGE_CHARACTERS])
        self.effect, self.why = effect, why


@runtime_checkable
class OnModule(Effect, Protocol):
    """What an effect can do that has a part for a module. Both take one motion, not a batch."""

    def on_module(self, motion: Motion, memory: Memory = None) -> AxisImpedance | None:
        """What must a module render now? None: nothing, as things are."""
        ...

    def on_host(self, motion: Motion, memory: Memory = None) -> Rendered:
        """What is left for the host while a module does that?"""
        ...


def along_cable(
    part: AxisImpedance, length: float, direction: Floats, limits: ModuleLimits | None = None
) -> Impedance:
    """What must a module render so that this happens along the axis?

    Where the hand goes in by dx, a cable at cosine c to the axis pays out c dx, and only c of its tension is along
    the axis; so stiffness and damping grow with ``1/c²``, forces with ``1/c``. The module damps whenever its cable
    pays out, in contact or not: it gets the damping only once there is contact. What is beyond the module's limits
    is cut to them.

    Parameters
    ----------
    part : AxisImpedance
    length : float
        Of the cable, in m.
    direction : (d,) array
        Unit vector of the cable, from the hand to the module.
    limits : ModuleLimits or None
        None: those of the firmware as it comes.
    """
    limits = limits or ModuleLimits()
    c = float(part.axis @ direction)
    amplitude = min(part.amplitude / c, (limits.upper - limits.lower) / 2)
    least = limits.lower + amplitude if amplitude else 0.0
    return Impedance(
        rest=min(max(length - c * part.compression, 0.0), limits.length),
        stiffness=min(part.stiffness / c**2, limits.stiffness),
        damping=min(part.damping / c**2, limits.damping) if part.compression >= 0.0 else 0.0,
        feed_forward=min(max(part.feed_forward / c, least), limits.upper),
        amplitude=amplitude,
        frequency=part.frequency,
    )


def felt(part: AxisImpedance, direction: Floats, velocity: Floats, cap: float = math.inf) -> Floats:
    """Which force (d,) is the hand to feel of what a module does, vibration aside, in N?

    A cable at the angle a to the axis also pulls across it, by tan a; the host takes that back, as late as it is.
    So a spring K on the module looks, to a slow hand, like one along the axis and a matrix of damping, ``tau K
    [[0, tan a], [tan a, tan² a]]``. With the hand's own b it takes no energy out of nowhere up to ``tau K = b
    (1 + sqrt(1 + 4/tan² a))/2``: the bound of a host that renders it all, if the cable lies across, and none if it
    lies along the axis. Of what is stiffer, only that share is taken back, and the force is felt off the axis, by
    no more than the cable is. This project's own.

    Parameters
    ----------
    part : AxisImpedance
    direction : (d,) array
        Unit vector of the cable, from the hand to the module.
    velocity : (d,) array
        Of the hand, in m/s.
    cap : float
        How stiff the host may be, in N/m.
    """
    push, c = part.push(velocity), float(part.axis @ direction)
    cable = float(push @ part.axis) / c * direction
    most = cap * (1.0 + math.sqrt(1.0 + 4.0 * c**2 / max(1.0 - c**2, 1e-12))) / 2.0
    share = min(most / part.stiffness, 1.0) if part.stiffness > 0.0 else 1.0
    return cable + share * (push - cable)


class Divided(NamedTuple):
    """Who renders what?

    Attributes
    ----------
    force : (d,) array
        For the host to ask the other cables for, in N.
    impedances : dict of int to Impedance
        By the number of the cable.
    pushed : (d,) array
        Force that the hand is to feel of those, vibration aside, in N: see `felt`.
    memory : tuple
        Of the effects, for the next step.
    sudden : bool
        As in `Rendered`.
    cut : tuple of dict
        Of each effect, the stiffnesses that the host does not render as they are: see `beyond`.
    """

    force: Floats
    impedances: dict[int, Impedance]
    pushed: Floats
    memory: tuple[Memory, ...]
    sudden: bool
    cut: tuple[dict[str, float], ...]


def divide(
    effects: Sequence[Effect],
    motion: Motion,
    memory: tuple[Memory, ...] | None,
    lengths: Floats,
    directions: Floats,
    able: NDArray[np.bool_] | None = None,
    limits: ModuleLimits | None = None,
    cap: float = math.inf,
) -> Divided:
    """Which part of some effects goes to which module, and what is left for the host?

    In the order of the effects, each part goes to the cable that lies best along its axis and is still free. An
    effect that finds none within 45 degrees is rendered by the host as a whole.

    Parameters
    ----------
    effects : sequence of Effect
        Most important first.
    motion : Motion
        One, not a batch.
    memory : tuple or None
        What `divide` returned before; None at first.
    lengths : (m,) array
        Of the cables, in m.
    directions : (m, d) array
        Unit vectors of the cables, from the hand to the modules.
    able : (m,) array of bool or None
        Modules that may render an impedance; None: all.
    limits : ModuleLimits or None
        Of the modules; None: those of the firmware as it comes.
    cap : float
        How stiff the host may be, in N/m: see `tensionlab.haptics.rendering.stability.stiffness_cap`.

    Raises
    ------
    EffectFailed
        Whatever goes wrong in an effect, and a force that is not finite.
    """
    free = np.ones(len(lengths), dtype=bool) if able is None else np.array(able, dtype=bool)
    force, pushed = np.zeros_like(motion.position), np.zeros_like(motion.position)
    impedances: dict[int, Impedance] = {}
    memories, cut, sudden = [], [], False
    for index, (effect, own) in enumerate(zip(effects, memory or (None,) * len(effects), strict=True)):
        try:
            done, stiff = None, beyond(effect, cap)
            part = _part(effect, motion, own)
            if isinstance(effect, OnModule) and part is None:
                stiff = {}  # not where the hand is
            elif isinstance(effect, OnModule) and part is not None and free.any():
                cosines = np.where(free, directions @ part.axis, -1.0)
                best = int(np.argmax(cosines))
                if cosines[best] >= ALIGNED:
                    impedances[best] = along_cable(part, float(lengths[best]), directions[best], limits)
                    free[best] = False
                    pushed = pushed + felt(part, directions[best], motion.velocity, cap)
                    done = capped(effect, cap, OnModule).on_host(motion, own)
                    stiff = beyond(effect, cap, OnModule)
            if done is None:
                done = capped(effect, cap).render(motion, own)
            force = force + done.force
        except Exception as error:
            why = str(error) if isinstance(error, EffectError) else f"{type(error).__name__}: {error}"
            raise EffectFailed(index, why) from error
        if not (np.isfinite(force).all() and np.isfinite(pushed).all()):
            raise EffectFailed(index, "its force is not finite")
        memories.append(done.memory)
        cut.append(stiff)
        sudden = sudden or bool(np.any(done.sudden))
    return Divided(force, impedances, pushed, tuple(memories), sudden, tuple(cut))


def _part(effect: Effect, motion: Motion, memory: Memory) -> AxisImpedance | None:
    """Return what a module is to render of an effect; None for one that the hand is far away from."""
    part = effect.on_module(motion, memory) if isinstance(effect, OnModule) else None
    if part is None or part.compression >= -AHEAD_M or part.feed_forward or part.amplitude:
        return part
    return None
