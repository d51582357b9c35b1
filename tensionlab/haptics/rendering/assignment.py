"""Assignment of effects: the parts that modules render at their own rate, and the remainder for the host.

A module knows its own cable only: it pulls with ``feed_forward + stiffness max(length - rest, 0) + damping
max(speed of paying out, 0) + amplitude sin(2 pi frequency t)``. A `SplitEffect` has an impedance along one axis.
`assign` gives it to the cable that lies best along that axis, or to all cables that pull along it
(`tensionlab.haptics.rendering.field`), whichever a hand will feel nearer to what is desired.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.demand import EffectDemand, Impedance
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, EffectError
from tensionlab.haptics.effects.contact import Texture
from tensionlab.haptics.effects.effect import AxisImpedance, Effect, Memory, Motion, Rendered, is_split
from tensionlab.haptics.rendering.fidelity import WEAK_JND
from tensionlab.haptics.rendering.field import FREE_WEIGHT, MAX_GAP, TIE_BREAK
from tensionlab.haptics.rendering.stability import DAMPING_SHARE, cap_stiffness, stiffnesses
from tensionlab.model.module import Module
from tensionlab.model.wall_stiffness import HAND_DAMPING, MARGIN, MIN_COSINE, MIN_HAND_MASS_KG, MODULE_STIFFNESS
from tensionlab.support.arrays import Floats

MAX_APPROACH_M = 0.5  # farther from a wall no module renders it: set-points come many times before contact


class SpringRule(NamedTuple):
    """Numbers by which `module_springs` chooses; defaults of this project where they have no source."""

    # Share of the host's largest lag by which it looks ahead: looking further than it is late drives a hand.
    lead: float = 0.5
    # A hand that slides along a surface, as force across makes it, is damped less: the host damps it more by three
    # times that force's share. With the lag tau, stiffness across A and coupling c it loses ``tau c A/Y`` of its
    # damping, Y in N/m: measured of a hand that an arm holds with 30 N/m (benchmarks/impedance_field.py).
    yielding: float = 3.0
    yielding_stiffness: float = 130.0
    min_cosine: float = MIN_COSINE
    min_field_cosine: float = 0.05  # one across the axis adds stiffness across it only
    noticeable: float = WEAK_JND
    max_gap: float = MAX_GAP
    free_weight: float = FREE_WEIGHT
    tie_break: float = TIE_BREAK
    late_damping: float = MARGIN * HAND_DAMPING  # of a host as stiff as it may be, which is late, in N s/m
    hand_mass: float = MIN_HAND_MASS_KG
    damping_share: float = DAMPING_SHARE
    settling: float = 2.0  # time constant of a field's softening, in s


RULE = SpringRule()
NO_GAINS = np.ones(0)  # of a part without vibration


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
# One cable within 20 degrees of its axis renders a vibration alone. Of several, each shakes by more than the last
# number, and their sum is no farther from the axis than the second, as a share.
LONE_COSINE, MAX_GAP_ACROSS, MIN_SWING_N = 0.94, 0.1, 1e-3
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
    """Memories of an effect as rendered, and as desired: at its own stiffness; and the share of its field."""

    rendered: Memory = None
    desired: Memory = None
    share: float = 0.0


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
    along its axis, within 45 degrees, or to all free cables on its side (`module_springs`). The host renders what
    modules would not render better, no stiffer than ``host_stiffness`` in N/m (see
    `tensionlab.haptics.rendering.stability.stiffness_cap`). It leaves out a vibration that is too fast for its
    set-points, which come every ``host_step`` s or once a step of the motion. Any error in an effect, or a force
    that is not finite, raises `EffectFailed`.
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
            springs = push = None
            if part is not None:
                springs = module_springs(part, motion, cables, free, limits, host_stiffness, memory.share)
            rendered, wanted, softened = _host_side(
                effect, motion, memory, part, springs, host_stiffness, host_step
            )
            rendering = [] if springs is None else [*springs.impedances]
            gain = cables.gain(part, rendering[0] if len(rendering) == 1 else None)
            if springs is None and part is not None and not part.feed_forward:
                rendered = rendered._replace(force=rendered.force / gain)
            if "frequency" not in softened:
                softened |= _too_fast(effect, part, motion, limits, cables, springs)
            if part is not None and springs is not None:
                free[list(springs.impedances)] = False
                impedances |= springs.impedances
                expected = expected + springs.force
                push = part.push(motion.velocity)
                desired = desired + push
            force, desired = force + rendered.force, desired + wanted.force
            demands.append(_demand(effect, part, motion, memory.rendered, wanted.force, push, gain, softened))
        except Exception as error:
            reason = str(error) if isinstance(error, EffectError) else f"{type(error).__name__}: {error}"
            raise EffectFailed(index, reason) from error
        if not math.isfinite((force + expected + desired).sum()):
            raise EffectFailed(index, "its force is not finite")
        kept.append(EffectMemory(rendered.memory, wanted.memory, springs.share if springs is not None else 0.0))
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
    soft, softer = cap_stiffness(effect, host_stiffness, side="host" if springs is not None else "both")
    if springs is None:
        rendered = wanted = soft.render(motion, memory.rendered)
        if softer:
            wanted = effect.render(motion, memory.desired)
        if is_split(effect) and part is None:
            softer = {}  # its stiff part is not where the hand is
        return rendered, wanted, {name: (stiffness, host_stiffness) for name, stiffness in softer.items()}
    assert is_split(effect)
    assert is_split(soft)
    rendered = wanted = soft.host_side(motion, memory.rendered)
    if softer:
        wanted = effect.host_side(motion, memory.desired)
    softened = {name: (stiffness, host_stiffness) for name, stiffness in softer.items()}
    along, across = springs.along, springs.across
    if part is not None and part.stiffness > along * (1.0 + 1e-9):  # rounding softens nothing
        own = stiffnesses(effect, side="module")
        softened |= {name: (stiffness, along) for name, stiffness in own.items() if stiffness > along}
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
    if springs is None:
        largest = limits.slew / (2.0 * math.pi * part.frequency) * cables.gain(part)
    else:
        largest = sum(
            impedance.amplitude
            * cables.gain(part, cable)
            * math.cos(2.0 * math.pi * impedance.phase)
            * float(part.axis @ cables.directions[cable])
            for cable, impedance in springs.impedances.items()
        )
    return {"amplitude": (part.amplitude, largest)} if part.amplitude > 1.01 * largest else {}


def _demand(
    effect: Effect,
    part: AxisImpedance | None,
    motion: Motion,
    memory: Memory,
    force: Floats,
    push: Floats | None,
    gain: float,
    softened: Softened,
) -> EffectDemand:
    """Return what an effect desires, given its host-side force and the push of its part, if modules have it."""
    damping = getattr(effect, "damping", getattr(effect, "linear", 0.0))
    if part is None:
        return EffectDemand(force, damping=damping, softened=softened)
    if part.amplitude and is_split(effect):
        force = effect.host_side(motion, memory).force + part.push(motion.velocity)
        return EffectDemand(force, 0.0, 0.0, part.frequency, part.amplitude, gain, softened)
    frequency = effect.frequency_at(motion) if isinstance(effect, Texture) else 0.0
    whole = force if push is None else force + push
    return EffectDemand(whole, part.stiffness, max(damping, part.damping), frequency, softened=softened)


def _module_side(effect: Effect, motion: Motion, memory: Memory) -> AxisImpedance | None:
    """Return the part of an effect for a module; None if the hand is far away from it."""
    part = effect.module_side(motion, memory) if is_split(effect) else None
    if part is None or part.compression >= -MAX_APPROACH_M or part.feed_forward or part.amplitude:
        return part
    return None


class ModuleSprings(NamedTuple):
    """Impedances of modules for a part, by the number of the cable, and what a hand feels of them.

    ``force`` (d,) is theirs on the hand in N, without vibration, with the host's corrections; ``along`` and
    ``across`` are the stiffness in N/m along and across the part's axis, as in `Prediction`. ``share`` is that of
    the best field, which may have to be softened; 0 if they are no field.
    """

    impedances: dict[int, Impedance]
    force: Floats
    along: float
    across: float
    share: float


def along_cables(
    part: AxisImpedance, cables: CableState, free: NDArray[np.bool_], limits: ModuleLimits = STANDARD_LIMITS
) -> dict[int, Impedance]:
    """Return the smallest vibrations of all free cables, by cable, that together are one along a part's axis.

    A cable that pulls against the axis shakes half a turn later. If one reaches its limits, all are smaller, so
    that the direction stays. There are none where one cable lies along the axis, or where cables are too few.
    """
    used, directions = np.flatnonzero(free), cables.directions[free]
    if not part.amplitude or part.feed_forward or not used.size or (directions @ part.axis).max() > LONE_COSINE:
        return {}
    shares = np.linalg.pinv(directions.T) @ part.axis
    if np.linalg.norm(shares @ directions - part.axis) > MAX_GAP_ACROSS:
        return {}
    gains = np.array([cables.gain(part, cable) for cable in used.tolist()])
    swings = part.amplitude * np.abs(shares)
    taut = (limits.upper - limits.lower) / (2.0 * np.maximum(gains, 1.0))
    largest = gains * np.minimum(taut, limits.slew / (2.0 * math.pi * part.frequency))
    swings *= min(float((largest / np.maximum(swings, MIN_SWING_N)).min()), 1.0)
    return {
        cable: Impedance(
            rest=min(float(cables.lengths[cable]), limits.length),
            feed_forward=limits.lower + swing * max(1.0, 1.0 / gain),
            amplitude=swing / gain,
            frequency=part.frequency,
            phase=0.5 * (share < 0.0),
        )
        for cable, swing, gain, share in zip(
            used.tolist(), swings.tolist(), gains.tolist(), shares.tolist(), strict=True
        )
        if swing > MIN_SWING_N
    }


def module_springs(
    part: AxisImpedance,
    motion: Motion,
    cables: CableState,
    free: NDArray[np.bool_],
    limits: ModuleLimits = STANDARD_LIMITS,
    host_stiffness: float = math.inf,
    previous_share: float = 0.0,
) -> ModuleSprings | None:
    """Return what free modules render of a part, by one cable or a field; None if the host alone is better.

    If the hand goes in by dx, a cable at cosine c to the axis pays out c dx, and the share c of its tension is
    along the axis; so one cable has the part's stiffness and damping over c², its forces over c, and its amplitude
    over the module's gain, too; the cable is taut at both ends. The springs of a field (`allocate_field`) end at
    the part's surface, so that a hand that withdraws before the host knows is not held; a spring softer than a
    thousandth of a module's largest is left out. Values are cut to the module's limits; a module damps whenever
    its cable pays out, so it gets the damping only in contact.

    A field has to be noticeably nearer to the part than one cable, or than the host alone; so does a change
    back, where a field rendered it before, with ``previous_share``. It is softened as a whole where a late host
    would let a hand shake across the axis (`stable_share`), or damp it less than the host alone or one cable would
    (`SpringRule`): the latter slowly, because a stiffness that follows the hand late drives it.
    """
    if shaken := along_cables(part, cables, free, limits):
        return ModuleSprings(shaken, np.zeros_like(part.axis), 0.0, 0.0, 0.0)
    springs = _native.module_springs(
        part.axis,
        (
            part.compression,
            part.stiffness,
            part.damping,
            part.feed_forward,
            part.amplitude,
            part.frequency,
            part.reach,
        ),
        motion.velocity,
        cables.lengths,
        cables.directions,
        cables.available,
        free,
        np.array([cables.gain(part, cable) for cable in range(len(free))]) if part.amplitude else NO_GAINS,
        (limits.lower, limits.upper, limits.stiffness, limits.damping, limits.length, limits.slew),
        RULE,
        host_stiffness,
        previous_share,
        motion.step,
    )
    if springs is None:
        return None
    impedances = {cable: Impedance(*spring) for cable, *spring in springs[0]}
    return ModuleSprings(impedances, *springs[1:])
