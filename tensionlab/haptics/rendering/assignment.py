"""Assignment of effects: the parts that modules render at their own rate, and the remainder for the host.

A module knows its own cable only: it pulls with ``feed_forward + stiffness max(length - rest, 0) + damping
max(speed of paying out, 0) + amplitude sin(2 pi frequency t)``. A `SplitEffect` has an impedance along one axis.
`assign` gives it to the cable that lies best along that axis, or to all cables that pull along it
(`tensionlab.haptics.rendering.field`), whichever a hand will feel nearer to what is desired.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import EffectDemand, Impedance
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, EffectError
from tensionlab.haptics.effects.contact import Texture
from tensionlab.haptics.effects.effect import AxisImpedance, Effect, Memory, Motion, Rendered, is_split
from tensionlab.haptics.rendering.fidelity import WEAK_JND
from tensionlab.haptics.rendering.field import (
    MAX_GAP,
    CableRanges,
    Prediction,
    allocate_field,
    predict,
    stable_share,
)
from tensionlab.haptics.rendering.stability import cap_stiffness, max_damping, stiffnesses
from tensionlab.model.module import Module
from tensionlab.model.wall_stiffness import HAND_DAMPING, MARGIN, MIN_COSINE, MIN_HAND_MASS_KG, MODULE_STIFFNESS
from tensionlab.support.arrays import Floats

MAX_APPROACH_M = 0.5  # farther from a wall no module renders it: set-points come many times before contact
# Share of the host's largest lag by which it looks ahead: looking further than it is late drives a hand.
LEAD = 0.5
# A hand that slides along a surface, as force across makes it, is damped less: by three times that force's share.
YIELDING = 3.0
MIN_FIELD_COSINE = 0.05  # of a cable of a field: one across the axis adds stiffness across it only


@dataclass(frozen=True)
class ModuleLimits:
    """Limits of a module in N, N/m, N s/m, m and N/s; it refuses an impedance that exceeds one of them.

    The defaults are those of the firmware. The lower tension holds under a vibration too, by more feed-forward;
    ``length`` is that of a cable at rest, ``slew`` the fastest change of a tension.
    """

    lower: float = 0.5
    upper: float = 6.0
    stiffness: float = MODULE_STIFFNESS
    damping: float = 10.0
    length: float = 5.0
    slew: float = 60.0


STANDARD_LIMITS = ModuleLimits()
# Fastest vibration of the host, in cycles per set-point: at 0.44 it is 3 dB weaker, above 0.5 another frequency.
MAX_CYCLES_PER_STEP = 0.42


class CableState(NamedTuple):
    """Lengths (m,) in m, unit vectors (m, d) from the hand, and modules (m,) that may render an impedance."""

    lengths: Floats
    directions: Floats
    available: NDArray[np.bool_]
    modules: tuple[Module, ...] = ()

    def gain(self, part: AxisImpedance | None, cable: int | None = None) -> float:
        """Return the gain of a part's vibration at the end of a cable, or the mean of all; 1 if not known."""
        modules = self.modules if cable is None else self.modules[cable : cable + 1]
        if part is None or not part.amplitude or not modules:
            return 1.0
        return sum(module.gain_at(part.frequency) for module in modules) / len(modules)


class EffectMemory(NamedTuple):
    """Memories of an effect as rendered, and as desired: at its own stiffness; and whether a field rendered it."""

    rendered: Memory = None
    desired: Memory = None
    by_field: bool = False


class RenderPlan(NamedTuple):
    """Impedances of the modules, and the remainder for the host.

    ``force`` (d,) in N is host-side, for the other cables; ``impedances`` are module-side, by the number of
    the cable, and ``expected`` (d,) is their force on the hand, with what the host takes back of it and adds
    (`predict` of `tensionlab.haptics.rendering.field`). ``desired`` (d,) is the force of the effects at their
    own stiffness, without the vibrations that modules render. ``memories`` and ``demands`` are by effect.
    """

    force: Floats
    impedances: dict[int, Impedance]
    expected: Floats
    desired: Floats
    memories: tuple[EffectMemory, ...]
    bypass_slew: bool
    demands: tuple[EffectDemand, ...]


class EffectFailed(EffectError):  # noqa: N818 - what happened
    """Effect, by its index or name, that failed or whose force is not finite."""

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
    host_step: float = 0.0,
) -> RenderPlan:
    """Return the impedances of modules that render parts of effects, and the remaining force of the host.

    In the order of the effects, the most important first, each part goes to the free cable that lies best
    along its axis, within 45 degrees, or to all free cables on its side, where `predict` finds a smaller
    error. The host renders what modules would not render better, no stiffer than ``host_stiffness`` in N/m
    (see `tensionlab.haptics.rendering.stability.stiffness_cap`). It leaves out a vibration that is too fast
    for its set-points, which come every ``host_step`` s or once a step of the motion. Any error in an effect,
    or a force that is not finite, raises `EffectFailed`.
    """
    free = np.array(cables.available, dtype=bool)
    force = expected = desired = np.zeros(motion.position.shape)
    impedances: dict[int, Impedance] = {}
    kept: list[EffectMemory] = []
    demands: list[EffectDemand] = []
    bypass = False
    host_step = max(host_step, motion.step)
    known = memories or (EffectMemory(),) * len(effects)
    for index, (effect, memory) in enumerate(zip(effects, known, strict=True)):
        try:
            part = _module_side(effect, motion, memory.rendered)
            springs = None
            if part is not None:
                springs = _module_springs(
                    part, motion.velocity, cables, free, limits, host_stiffness, memory.by_field
                )
            rendered, wanted, softened = _host_side(
                effect, motion, memory, part, springs, host_stiffness, host_step
            )
            gain = cables.gain(part, None if springs is None else next(iter(springs.impedances)))
            if springs is None and part is not None and not part.feed_forward:
                rendered = rendered._replace(force=rendered.force / gain)
            if "frequency" not in softened:
                softened |= _too_fast(effect, part, motion, limits, cables, springs)
            demand = _demand(effect, part, motion, memory.rendered, wanted.force, springs is not None, softened)
            demands.append(replace(demand, gain=gain))
            if part is not None and springs is not None:
                free[list(springs.impedances)] = False
                impedances |= springs.impedances
                expected = expected + springs.force
                desired = desired + part.push(motion.velocity)
            force, desired = force + rendered.force, desired + wanted.force
        except Exception as error:
            reason = str(error) if isinstance(error, EffectError) else f"{type(error).__name__}: {error}"
            raise EffectFailed(index, reason) from error
        if not np.isfinite(force + expected + desired).all():
            raise EffectFailed(index, "its force is not finite")
        kept.append(EffectMemory(rendered.memory, wanted.memory, springs is not None and springs.by_field))
        bypass = bypass or bool(np.asarray(rendered.bypass_slew).any())
    return RenderPlan(force, impedances, expected, desired, tuple(kept), bypass, tuple(demands))


Softened = dict[str, tuple[float, float]]  # desired and rendered values by parameter, as in `EffectDemand`


def _host_side(
    effect: Effect,
    motion: Motion,
    memory: EffectMemory,
    part: AxisImpedance | None,
    springs: ModuleSprings | None,
    host_stiffness: float,
    host_step: float,
) -> tuple[Rendered, Rendered, Softened]:
    """Return what the host renders of an effect, the same at the effect's own stiffness, and what is softened."""
    if part is not None and springs is None and part.amplitude:
        assert is_split(effect)
        if part.frequency * host_step > MAX_CYCLES_PER_STEP:
            rest = effect.host_side(motion, memory.rendered)
            rest = rest._replace(force=rest.force + part.push(motion.velocity))
            return rest, rest, {"frequency": (part.frequency, 0.0)}
    soft, softer = cap_stiffness(effect, host_stiffness, host_side=springs is not None)
    if springs is None:
        rendered = wanted = soft.render(motion, memory.rendered)
        if softer:
            wanted = effect.render(motion, memory.desired)
        if is_split(effect) and part is None:
            softer = {}  # its stiff part is not where the hand is
        return rendered, wanted, {name: (each, host_stiffness) for name, each in softer.items()}
    assert is_split(effect)
    assert is_split(soft)
    rendered = wanted = soft.host_side(motion, memory.rendered)
    if softer:
        wanted = effect.host_side(motion, memory.desired)
    softened = {name: (each, host_stiffness) for name, each in softer.items()}
    along, across = springs.predicted.along, springs.predicted.across
    if part is not None and part.stiffness > along * (1.0 + 1e-9):  # rounding softens nothing
        on_host = stiffnesses(effect, host_side=True)
        own = stiffnesses(effect).items()
        softened |= {name: (each, along) for name, each in own if each > along and name not in on_host}
    if across > WEAK_JND * along:
        softened["stiffness across"] = (0.0, across)
    return rendered, wanted, softened


def _too_fast(
    effect: Effect,
    part: AxisImpedance | None,
    motion: Motion,
    limits: ModuleLimits,
    cables: CableState,
    springs: ModuleSprings | None,
) -> Softened:
    """Return the amplitude of a vibration, or height of ripples, that tensions or the loop are too slow for."""
    if part is None:
        return {}
    if isinstance(effect, Texture) and part.compression > 0.0:
        ripples = effect.ripples
        fade = float(ripples.fade(np.asarray(effect.frequency_at(motion) * ripples.period), motion.step))
        return {"ripples.height": (ripples.height, fade * ripples.height)} if fade < 1.0 else {}
    if not part.amplitude:
        return {}
    largest = limits.slew / (2.0 * math.pi * part.frequency) * cables.gain(part)
    for cable, each in {} if springs is None else springs.impedances.items():
        largest = each.amplitude * cables.gain(part, cable) * float(part.axis @ cables.directions[cable])
    return {"amplitude": (part.amplitude, largest)} if part.amplitude > largest * (1.0 + 1e-9) else {}


def _demand(
    effect: Effect,
    part: AxisImpedance | None,
    motion: Motion,
    memory: Memory,
    force: Floats,
    on_module: bool,
    softened: Softened,
) -> EffectDemand:
    """Return what an effect desires, given its host-side force and whether its part is on a module."""
    damping = getattr(effect, "damping", getattr(effect, "linear", 0.0))
    if part is None:
        return EffectDemand(force, damping=damping, softened=softened)
    if part.amplitude and is_split(effect):
        force = effect.host_side(motion, memory).force + part.push(motion.velocity)
        return EffectDemand(force, 0.0, 0.0, part.frequency, part.amplitude, softened=softened)
    frequency = effect.frequency_at(motion) if isinstance(effect, Texture) else 0.0
    whole = force + part.push(motion.velocity) if on_module else force
    return EffectDemand(whole, part.stiffness, max(damping, part.damping), frequency, softened=softened)


def _module_side(effect: Effect, motion: Motion, memory: Memory) -> AxisImpedance | None:
    """Return the part of an effect for a module; None if the hand is far away from it."""
    part = effect.module_side(motion, memory) if is_split(effect) else None
    if part is None or part.compression >= -MAX_APPROACH_M or part.feed_forward or part.amplitude:
        return part
    return None


def _best_cable(part: AxisImpedance, directions: Floats, free: NDArray[np.bool_]) -> int | None:
    """Return the free cable that lies best along the axis of a part; None if none lies within 45 degrees."""
    if not free.any():
        return None
    cosines = np.where(free, directions @ part.axis, -1.0)
    best = int(np.argmax(cosines))
    return best if cosines[best] >= MIN_COSINE else None


def along_cable(
    part: AxisImpedance,
    length: float,
    direction: Floats,
    limits: ModuleLimits = STANDARD_LIMITS,
    gain: float = 1.0,
) -> Impedance:
    """Return the impedance of a cable (length in m, unit vector from the hand) that renders a part along its axis.

    If the hand goes in by dx, a cable at cosine c to the axis pays out c dx, and the share c of its tension is
    along the axis; so stiffness and damping grow with ``1/c²``, forces with ``1/c``. The module damps whenever its
    cable pays out, so it gets the damping only in contact. Values are cut to the module's limits. The amplitude is
    corrected by the ``gain`` of a vibration from the motor to the end of the cable, which is taut at both.
    """
    c = float(part.axis @ direction)
    amplitude = min(part.amplitude / (c * gain), (limits.upper - limits.lower) / (2.0 * max(gain, 1.0)))
    if part.frequency:
        amplitude = min(amplitude, limits.slew / (2.0 * math.pi * part.frequency))
    lowest = limits.lower + amplitude * max(gain, 1.0) if amplitude else 0.0
    return Impedance(
        rest=min(max(length - c * part.compression, 0.0), limits.length),
        stiffness=min(part.stiffness / c**2, limits.stiffness),
        damping=min(part.damping / c**2, limits.damping) if part.compression >= 0.0 else 0.0,
        feed_forward=min(max(part.feed_forward / c, lowest), limits.upper),
        amplitude=amplitude,
        frequency=part.frequency,
    )


class ModuleSprings(NamedTuple):
    """Impedances of modules for a part, by the number of the cable, and what a hand feels of their stiffness.

    ``force`` (d,) is theirs on the hand in N, without vibration, with the host's corrections.
    """

    impedances: dict[int, Impedance]
    force: Floats
    predicted: Prediction
    by_field: bool


def _module_springs(
    part: AxisImpedance,
    velocity: Floats,
    cables: CableState,
    free: NDArray[np.bool_],
    limits: ModuleLimits,
    host_stiffness: float,
    was_field: bool,
) -> ModuleSprings | None:
    """Return what modules render of a part, by one cable or a field; None if the host alone is better.

    A change from or to a field, which a person feels, has to be noticeably better.
    """
    late = LEAD * MARGIN * HAND_DAMPING / host_stiffness if host_stiffness else 0.0
    way = late * (velocity - float(part.axis @ velocity) * part.axis)  # along the surface, until set-points act
    later = cables._replace(lengths=cables.lengths - cables.directions @ way)
    best, by_field = None, False
    if (cable := _best_cable(part, cables.directions, free)) is not None:
        way_out, gain = cables.directions[cable], cables.gain(part, cable)
        one = {cable: along_cable(part, float(later.lengths[cable]), way_out, limits, gain)}
        best = one, _predict(part, one, cables, host_stiffness)
    # Not for a spring that ends before a late host can end it.
    if part.stiffness > 0.0 and part.amplitude == part.feed_forward == 0.0 and math.isinf(part.reach):
        error = 1.0 - min(host_stiffness / part.stiffness, 1.0) if best is None else best[1].error
        error *= 1.0 + WEAK_JND if was_field else 1.0 - WEAK_JND
        if error > WEAK_JND:  # a smaller one cannot be felt
            field = along_field(part, velocity, later, free, limits, host_stiffness)
            predicted = _predict(part, field, cables, host_stiffness)
            if by_field := bool(field) and predicted.error < error:
                best = field, predicted
    if best is None:
        return None
    return ModuleSprings(
        best[0], _expected(part, velocity, cables.directions, *best, way, late), best[1], by_field
    )


def _predict(
    part: AxisImpedance, impedances: Mapping[int, Impedance], cables: CableState, host_stiffness: float
) -> Prediction:
    directions = cables.directions[list(impedances)]
    stiffness = np.array([each.stiffness for each in impedances.values()])
    matrix = (directions.T * stiffness) @ directions
    return predict(matrix, part.axis, part.stiffness, host_stiffness / (1.0 - LEAD))


def _expected(
    part: AxisImpedance,
    velocity: Floats,
    directions: Floats,
    impedances: dict[int, Impedance],
    predicted: Prediction,
    way: Floats,
    late: float,
) -> Floats:
    """Return the force of impedances on the hand, corrected as predicted.

    What the host corrects is ``late`` s old when it acts, so it is for a hand that has moved on: along the surface
    by ``way``, and against the axis. The host damps the way out, where modules do not.
    """
    rate, used = -float(part.axis @ velocity), directions[list(impedances)]
    touching = part.compression > 0.0
    then = max(part.compression + late * rate, 0.0) if touching else 0.0  # compression
    cosines = used @ part.axis
    stiffness, damping = np.array([(each.stiffness, each.damping) for each in impedances.values()]).T
    # Without the tension that only keeps a vibrating cable taut.
    pulls = part.feed_forward / cosines
    force = (stiffness * np.maximum(cosines * part.compression + used @ way, 0.0) + pulls) @ used
    dampers = (damping * (max(rate, 0.0) * cosines)) @ used
    coupling = (stiffness * (then * cosines) + pulls) @ used + dampers
    across = dampers - predicted.share * coupling
    added = predicted.added * then
    if touching:
        yielding = 1.0 + YIELDING * predicted.across / predicted.along if predicted.along else 1.0
        largest_damping = max_damping(MIN_HAND_MASS_KG, late / LEAD, 0.0) if late else math.inf
        damped = min(part.damping * yielding, largest_damping) * rate
        added += damped if rate < 0.0 else max(damped, float(dampers @ part.axis))
    added = max(added, -float(force @ part.axis)) - float(across @ part.axis)
    total: Floats = force + across + added * part.axis
    return total


def along_field(
    part: AxisImpedance,
    velocity: Floats,
    cables: CableState,
    free: NDArray[np.bool_],
    limits: ModuleLimits = STANDARD_LIMITS,
    host_stiffness: float = math.inf,
) -> dict[int, Impedance]:
    """Return the impedances, by cable, of free cables that together are nearest to a part.

    They pull along its axis, and their springs end at its surface, so that a hand that withdraws before the host
    knows is not held. Tensions are inside the limits from there to the hand's depth; beyond, a module holds its
    largest tension. A spring softer than a thousandth of a module's largest is left out.
    """
    cosines = cables.directions @ part.axis
    usable = free & (cosines > MIN_FIELD_COSINE)
    lower, upper = np.where(cables.available, limits.lower, 0.0), np.full(len(cosines), limits.upper)
    fall = np.where(usable, cosines * max(part.compression, 0.0), 0.0)
    ranges = CableRanges(
        lower,
        upper,
        np.where(usable, limits.stiffness, 0.0),
        np.where(usable, limits.damping, 0.0),
        fall,
        rise=np.zeros_like(fall),
    )
    rate = max(-float(part.axis @ velocity), 0.0)  # on the way out the springs still need their tensions
    push = max(part.stiffness * part.compression + part.damping * rate, 0.0) * part.axis
    outer = np.outer(part.axis, part.axis)
    found = allocate_field(cables.directions.T, push, part.stiffness * outer, part.damping * outer, ranges)
    if not found.gap <= MAX_GAP:
        return {}
    touching = part.compression >= 0.0
    matrix = (cables.directions.T * found.stiffness) @ cables.directions
    stiffness = stable_share(matrix, part.axis, host_stiffness) * found.stiffness
    return {
        int(cable): Impedance(
            rest=min(max(float(cables.lengths[cable] - cosines[cable] * part.compression), 0.0), limits.length),
            stiffness=float(stiffness[cable]),
            damping=float(found.damping[cable]) if touching else 0.0,
        )
        for cable in np.flatnonzero(found.stiffness > 1e-3 * limits.stiffness)
    }
