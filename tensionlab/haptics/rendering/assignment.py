"""Assignment of effects: which part a module renders at its own rate, and what is left for the host.

A module knows its own cable only: it pulls with ``feed_forward + stiffness max(length - rest, 0) + damping
max(speed of paying out, 0) + amplitude sin(2 pi frequency t)``. A `SplitEffect` says what happens along one axis,
and `assign` finds the cable that lies best along it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import Impedance
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, EffectError
from tensionlab.haptics.effects.effect import AxisImpedance, Effect, Memory, Motion, Rendered, is_split
from tensionlab.haptics.rendering.stability import capped, cut_stiffnesses
from tensionlab.support.arrays import Floats

# Further out of contact than this, no module renders a wall: set-points come many times before it could.
MAX_APPROACH_M = 0.5
# Between axis and cable, below which no cable is good enough: the published threshold of a convincing direction.
MIN_COSINE = math.cos(math.radians(45.0))


@dataclass(frozen=True)
class ModuleLimits:
    """What a module renders at most, in N, N/m, N s/m and m; it refuses an impedance as a whole that goes beyond.

    The defaults are those of the firmware's parameters. The lower tension is held under a vibration too, by as
    much more feed-forward; ``length`` is that of a cable at rest.
    """

    lower: float = 0.5
    upper: float = 6.0
    stiffness: float = 500.0
    damping: float = 10.0
    length: float = 5.0


STANDARD_LIMITS = ModuleLimits()
# Fastest vibration that the host renders, per step: above half a cycle it would come out as another frequency
# (Nyquist's); 5 % more, as steps are not all of one length.
MAX_CYCLES_PER_STEP = 0.525


class CableState(NamedTuple):
    """Cables of a rig as they are now.

    Their lengths (m,) in m, unit vectors (m, d) from the hand to the modules, and which modules may render an
    impedance (m,).
    """

    lengths: Floats
    directions: Floats
    available: NDArray[np.bool_]


class EffectMemory(NamedTuple):
    """What an effect remembers as it is rendered, and as it is desired: at its own stiffness."""

    rendered: Memory = None
    desired: Memory = None


class Cut(NamedTuple):
    """Stiffness in N/m, or frequency of a vibration in Hz, that is not rendered as desired."""

    desired: float
    rendered: float


class RenderPlan(NamedTuple):
    """Which module renders what, and what is left for the host.

    ``force`` (d,) in N is host-side, for the other cables; ``impedances`` are module-side, by the number of the
    cable, and ``expected`` (d,) is the force on the hand by those (`expected_force`). ``desired`` (d,) is the
    force that the effects would exert at their own stiffness, without the vibrations that modules render. Memories
    are those of the effects; ``cut`` has, for each effect, the stiffnesses that are not rendered as they are, and
    the ``frequency`` of a vibration that is left out.
    """

    force: Floats
    impedances: dict[int, Impedance]
    expected: Floats
    desired: Floats
    memories: tuple[EffectMemory, ...]
    bypass_slew: bool
    cut: tuple[dict[str, Cut], ...]


class EffectFailed(EffectError):  # noqa: N818 - what happened
    """Effect, by its index or name, that could not be rendered, or whose force is no number."""

    def __init__(self, effect: int | str, reason: str) -> None:
        super().__init__(f"effect {effect!r} failed: {reason}"[:MAX_MESSAGE_CHARACTERS])
        self.effect, self.reason = effect, reason


def assign(
    effects: Sequence[Effect],
    motion: Motion,
    cables: CableState,
    limits: ModuleLimits = STANDARD_LIMITS,
    host_stiffness: float = math.inf,
    memories: Sequence[EffectMemory] | None = None,
) -> RenderPlan:
    """Return which module renders which part of some effects, and the force that is left for the host.

    In the order of the effects, the most important first, each part goes to the cable that lies best along its
    axis and is still free. An effect that finds none within 45 degrees is rendered by the host as a whole, no
    stiffer than ``host_stiffness`` in N/m: see `tensionlab.haptics.rendering.stability.stiffness_cap`; a vibration
    faster than half the host's rate is left out. Whatever goes wrong in an effect, and a force that is not finite,
    raises `EffectFailed`.
    """
    free = np.array(cables.available, dtype=bool)
    force, expected, desired = (np.zeros_like(motion.position) for _ in range(3))
    impedances: dict[int, Impedance] = {}
    kept: list[EffectMemory] = []
    cut: list[dict[str, Cut]] = []
    bypass = False
    known = memories or (EffectMemory(),) * len(effects)
    for index, (effect, (memory, desired_memory)) in enumerate(zip(effects, known, strict=True)):
        try:
            part = _module_side(effect, motion, memory)
            cable = None if part is None else _best_cable(part, cables.directions, free)
            if cable is None and part is not None and _too_fast(part, motion):
                rendered = wanted = _without_vibration(effect, part, motion, memory)
                cut.append({"frequency": Cut(part.frequency, 0.0)})
            elif part is None or cable is None:
                rendered = wanted = capped(effect, host_stiffness).render(motion, memory)
                idle = is_split(effect) and part is None  # its stiff part is not where the hand is
                softer = _cut(cut_stiffnesses(effect, host_stiffness), host_stiffness)
                if softer:
                    wanted = effect.render(motion, desired_memory)
                cut.append({} if idle else softer)
            else:
                free[cable] = False
                direction = cables.directions[cable]
                impedances[cable] = along_cable(part, float(cables.lengths[cable]), direction, limits)
                expected = expected + expected_force(part, direction, motion.velocity, host_stiffness)
                rest = capped(effect, host_stiffness, host_side=True)
                assert is_split(effect)
                assert is_split(rest)
                rendered = wanted = rest.host_side(motion, memory)
                softer = _cut(cut_stiffnesses(effect, host_stiffness, host_side=True), host_stiffness)
                if softer:
                    wanted = effect.host_side(motion, desired_memory)
                desired = desired + part.push(motion.velocity)
                cut.append(softer | _cut_by_module(effect, impedances[cable], float(part.axis @ direction)))
            force, desired = force + rendered.force, desired + wanted.force
        except Exception as error:
            reason = str(error) if isinstance(error, EffectError) else f"{type(error).__name__}: {error}"
            raise EffectFailed(index, reason) from error
        if not all(np.isfinite(each).all() for each in (force, expected, desired)):
            raise EffectFailed(index, "its force is not finite")
        kept.append(EffectMemory(rendered.memory, wanted.memory))
        bypass = bypass or bool(np.any(rendered.bypass_slew))
    return RenderPlan(force, impedances, expected, desired, tuple(kept), bypass, tuple(cut))


def _too_fast(part: AxisImpedance, motion: Motion) -> bool:
    """Return whether the host cannot render the vibration of a part."""
    return part.amplitude > 0.0 and part.frequency * motion.step > MAX_CYCLES_PER_STEP


def _without_vibration(effect: Effect, part: AxisImpedance, motion: Motion, memory: Memory) -> Rendered:
    """Return the force of an effect whose part for a module the host renders without its vibration."""
    assert is_split(effect)
    rest = effect.host_side(motion, memory)
    return rest._replace(force=rest.force + part.push(motion.velocity))


def _cut(stiffnesses: Mapping[str, float], rendered: float) -> dict[str, Cut]:
    return {name: Cut(stiffness, rendered) for name, stiffness in stiffnesses.items()}


def _cut_by_module(effect: Effect, impedance: Impedance, cosine: float) -> dict[str, Cut]:
    """Return which stiffness of an effect its module does not render, whose cable is at a cosine to the axis."""
    rendered = impedance.stiffness * cosine**2
    above = rendered * (1.0 + 1e-9)  # rounding is no cut
    hosts = cut_stiffnesses(effect, above, host_side=True)
    cut = {name: each for name, each in cut_stiffnesses(effect, above).items() if name not in hosts}
    return _cut(cut, rendered)


def _module_side(effect: Effect, motion: Motion, memory: Memory) -> AxisImpedance | None:
    """Return what a module is to render of an effect; None for one that the hand is far away from."""
    part = effect.module_side(motion, memory) if is_split(effect) else None
    if part is None or part.compression >= -MAX_APPROACH_M or part.feed_forward or part.amplitude:
        return part
    return None


def _best_cable(part: AxisImpedance, directions: Floats, free: NDArray[np.bool_]) -> int | None:
    """Return the free cable that lies best along the axis of a part; None where none lies within 45 degrees."""
    if not free.any():
        return None
    cosines = np.where(free, directions @ part.axis, -1.0)
    best = int(np.argmax(cosines))
    return best if cosines[best] >= MIN_COSINE else None


def along_cable(
    part: AxisImpedance, length: float, direction: Floats, limits: ModuleLimits = STANDARD_LIMITS
) -> Impedance:
    """Return the impedance of a cable (length in m, unit vector from the hand) that renders a part along its axis.

    Where the hand goes in by dx, a cable at cosine c to the axis pays out c dx, and only c of its tension is along
    the axis; so stiffness and damping grow with ``1/c²``, forces with ``1/c``. The module damps whenever its cable
    pays out, in contact or not: it gets the damping only once there is contact. What is beyond the module's limits
    is cut to them.
    """
    c = float(part.axis @ direction)
    amplitude = min(part.amplitude / c, (limits.upper - limits.lower) / 2)
    lowest = limits.lower + amplitude if amplitude else 0.0
    return Impedance(
        rest=min(max(length - c * part.compression, 0.0), limits.length),
        stiffness=min(part.stiffness / c**2, limits.stiffness),
        damping=min(part.damping / c**2, limits.damping) if part.compression >= 0.0 else 0.0,
        feed_forward=min(max(part.feed_forward / c, lowest), limits.upper),
        amplitude=amplitude,
        frequency=part.frequency,
    )


def expected_force(
    part: AxisImpedance, direction: Floats, velocity: Floats, host_stiffness: float = math.inf
) -> Floats:
    """Return the force (d,) on the hand that is expected of a module's part, vibration aside, in N.

    A cable at the angle a to the axis also pulls across it, by tan a; the host takes that back, as late as it is.
    So a spring K on the module looks, to a slow hand, like one along the axis and a matrix of damping, ``tau K
    [[0, tan a], [tan a, tan² a]]``. With the hand's own b it takes no energy out of nowhere up to ``tau K = b
    (1 + sqrt(1 + 4/tan² a))/2``: the bound of a host that renders it all, if the cable lies across, and none if it
    lies along the axis. Of what is stiffer, only that share is taken back, and the force is off the axis, by
    no more than the cable is. This project's own.
    """
    push, c = part.push(velocity), float(part.axis @ direction)
    cable = float(push @ part.axis) / c * direction
    bound = host_stiffness * (1.0 + math.sqrt(1.0 + 4.0 * c**2 / max(1.0 - c**2, 1e-12))) / 2.0
    share = min(bound / part.stiffness, 1.0) if part.stiffness > 0.0 else 1.0
    return cable + share * (push - cable)
