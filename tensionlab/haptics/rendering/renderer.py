"""Renderer: from effects and the state of a rig to a demand, once a cycle.

Stiff and vibrating parts go to the modules whose cables lie along them (`assignment`). The host renders the
remainder, no stiffer than is stable with the loop's delay (`stability`), through `Stages`.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tensionlab.allocation import allocate
from tensionlab.demand import Demand, EffectDemand, Impedance, RigState
from tensionlab.errors import EffectError
from tensionlab.haptics.effects import Friction, Shape, Viscous, Wall
from tensionlab.haptics.effects.effect import Effect, Motion, norm
from tensionlab.haptics.effects.parameters import Number, PositiveForce, checked_dataclass
from tensionlab.haptics.rendering.assignment import (
    CableState,
    EffectFailed,
    EffectMemory,
    ModuleLimits,
    RenderPlan,
    assign,
)
from tensionlab.haptics.rendering.stability import Observed, PassivityController, max_damping, stiffness_cap
from tensionlab.model.rig import Rig
from tensionlab.model.wall_stiffness import HAND_DAMPING, MIN_HAND_MASS_KG
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
        previous_velocity = None if memory is None else memory.velocity
        velocity = low_pass(motion.velocity, previous_velocity, self.cutoff, motion.step)
        return Motion(motion.position, velocity, motion.time, motion.step)

    def filter(
        self, force: Floats, motion: Motion, bypass: bool | NDArray[np.bool_], memory: StageMemory | None
    ) -> tuple[Floats, StageMemory]:
        """Return the force to demand instead of the effects' force (..., d), and the memory for the next step.

        The motion is that of `smooth`; ``bypass`` is true where the force is meant to jump.
        """
        previous = np.zeros_like(force) if memory is None else memory.force
        slewed = limit_force_slew(limit_force(force, self.max_force), previous, self.slew * motion.step, bypass)
        if self.controller is None:
            return slewed, StageMemory(motion.velocity, slewed)
        # After the slew: the observer must know the commanded force, and its damper must not be slowed.
        safe, _, observed = self.controller.correct(slewed, motion, None if memory is None else memory.observed)
        return safe, StageMemory(motion.velocity, slewed, observed)


# Largest desired force over the sum of all upper tensions. At 1 it would cost feasible force: if cables pull
# aslant, a desired force that is somewhat too large is rendered better.
MAX_FORCE_RATIO = 2.0
INITIAL_DELAY_S = 0.25  # assumed delay before the first measurement: the lifetime of set-points
DELAY_CYCLES = 100  # recent cycles whose delays and durations count
# Effects for the passivity controller: they only return energy. A magnet, a spring or a lift may store some at
# first, and a weight, a shot or a vibration is meant to give it.
PASSIVE_EFFECTS = (Wall, Shape, Viscous, Friction)


class GroupMemory(NamedTuple):
    """Memory of effects, by name and with their kinds, and of the stages that they pass."""

    effects: dict[str, tuple[type, EffectMemory]]
    stages: StageMemory | None


class Renderer:
    """Renderer of effects: makes a demand of them each cycle, and keeps their memories.

    The demand is the part of the desired force that is stable with the loop's delay, and at most twice the force
    of all cables together. A failed cycle leaves no memory: without the failed effect, the next cycle continues
    from the previous force, by the slew limit.

    Effects act on the rig's point or reference point. ``limits`` are those of all modules, by default the
    firmware's and the rig's tensions. ``delay`` is the loop latency, the largest of the last 100 cycles, in s;
    ``ceiling`` the host stiffness limit in N/m, with that delay and the longest of those cycles.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._names = [module.name for module in rig.modules]
        self.limits = ModuleLimits(float(rig.limits.lower.max()), float(rig.limits.upper.min()))
        self._max_force = min(MAX_FORCE_RATIO * float(rig.limits.upper.sum()), MAX_FORCE_N)
        self._delays: deque[float] = deque(maxlen=DELAY_CYCLES)
        self._steps: deque[float] = deque(maxlen=DELAY_CYCLES)
        self._sequences = np.full(rig.m, -1)
        self._followed: deque[NDArray[np.bool_]] = deque(
            maxlen=DELAY_CYCLES
        )  # whether each module has a new set-point
        self._follows = np.zeros(rig.m, dtype=int)  # their number
        self._set_point_step = 0.0
        self._controller: PassivityController | None = None
        self._stages = dict.fromkeys((True, False), Stages(max_force=self._max_force))  # by whether passive
        self._memories = {True: GroupMemory({}, None), False: GroupMemory({}, None)}  # by whether passive
        self.delay = INITIAL_DELAY_S
        self.ceiling = 0.0

    def __call__(
        self, effects: Mapping[str, Effect], motion: Motion, state: RigState, share: float = 1.0
    ) -> Demand:
        """Return the demand of this cycle.

        An effect keeps its memory by name, also with other parameters, but not as another kind. ``share`` scales
        the whole demand, from 0 to 1; at 0 the cables are held taut. Raises `EffectFailed`, which names the
        effect.
        """
        self._measure_delay(state, motion.step)
        available = state.active & (self._rig.n == self._rig.dimension)
        force, desired = np.zeros(self._rig.dimension), np.zeros(self._rig.dimension)
        impedances: dict[int, Impedance] = {}
        demands: dict[str, EffectDemand] = {}
        for passive in (True, False):
            group = {
                name: effect for name, effect in effects.items() if isinstance(effect, PASSIVE_EFFECTS) is passive
            }
            host, plan = self._render(group, passive, motion, state, available)
            force, desired = force + host + plan.expected, desired + plan.desired
            impedances |= plan.impedances
            demands |= zip(group, plan.demands, strict=True)
            available = available & [index not in plan.impedances for index in range(self._rig.m)]
        force = limit_force(force, self._max_force)
        if share <= 0.0:
            return Demand()
        wrench, wanted = np.zeros(self._rig.n), np.zeros(self._rig.n)
        wrench[: self._rig.dimension] = share * force
        wanted[: self._rig.dimension] = share * desired
        springs = self._balanced(share * force, impedances, share, state) if impedances else {}
        if share < 1.0:
            demands = {name: replace(demand, force=share * demand.force) for name, demand in demands.items()}
        return Demand(wrench, springs, desired=wanted, effects=demands)

    def _render(
        self,
        effects: Mapping[str, Effect],
        passive: bool,
        motion: Motion,
        state: RigState,
        available: NDArray[np.bool_],
    ) -> tuple[Floats, RenderPlan]:
        """Return the host-side force of effects after the stages, and their plan."""
        stages = self._stages[passive]
        previous_memory = self._memories[passive]
        smooth = stages.smooth(motion, previous_memory.stages)
        directions = state.structure[: self._rig.dimension].T
        cables = CableState(state.lengths, directions, available, self._rig.modules)
        memories: list[EffectMemory] = []
        for name, effect in effects.items():
            kind, memory = previous_memory.effects.get(name, (None, EffectMemory()))
            memories.append(memory if kind is type(effect) else EffectMemory())
        try:
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # `assign` refuses infinite forces
                every = tuple(effects.values())
                plan = assign(every, smooth, cables, self.limits, self.ceiling, memories, self._set_point_step)
                force, stage_memory = stages.filter(plan.force, smooth, plan.bypass_slew, previous_memory.stages)
        except EffectFailed as failed:
            raise EffectFailed(list(effects)[int(failed.effect)], failed.reason) from failed.__cause__
        kinds = map(type, effects.values())
        kept = dict(zip(effects, zip(kinds, plan.memories, strict=True), strict=True))
        self._memories[passive] = GroupMemory(kept, stage_memory)
        return force, plan

    def _measure_delay(self, state: RigState, step: float) -> None:
        """Update the loop latency, and with it the host stiffness limit and the passivity controller.

        So is the time between the set-points that modules are seen to follow, once enough cycles are known.
        """
        if len(self._followed) == DELAY_CYCLES:
            self._follows -= self._followed[0]
        self._followed.append(state.last_sequence != self._sequences)
        self._follows += self._followed[-1]
        self._sequences = state.last_sequence
        if len(self._followed) == DELAY_CYCLES and state.active.any():
            self._set_point_step = sum(self._steps) / max(int(self._follows[state.active].min()), 1)
        known = state.delays[state.active & np.isfinite(state.delays)]
        if known.size:
            self._delays.append(float(known.max()))
        self._steps.append(step)
        delay = max(self._delays, default=INITIAL_DELAY_S)
        self.ceiling = stiffness_cap(delay, max(self._steps), HAND_DAMPING)
        if delay == self.delay and self._controller is not None:
            return
        self.delay = delay
        step = statistics.median(self._steps)  # a single late cycle does not count
        steps = delay / step
        # A step more or less is no change, since steps vary.
        if self._controller is None or not -1.5 < steps - self._controller.delay < 0.5:
            self._controller = PassivityController(max_damping(MIN_HAND_MASS_KG, delay, step), math.ceil(steps))
            self._stages[True] = Stages(self._controller, max_force=self._max_force)
            effects, stages = self._memories[True]
            if stages is not None:  # the observer paired forces and motions by another delay
                self._memories[True] = GroupMemory(effects, stages._replace(observed=None))

    def _balanced(
        self, force: Floats, impedances: Mapping[int, Impedance], share: float, state: RigState
    ) -> dict[str, Impedance]:
        """Return a share of impedances, by module, and in each the tension that its cable needs besides.

        Together they are tensions that render the force; if possible, each cable stays taut if its spring goes
        slack. A vibrating cable stays taut.
        """
        springs, scaled = np.zeros(self._rig.m), {}
        for index, whole in impedances.items():
            minimum = self.limits.lower if whole.amplitude else 0.0
            parts = {name: share * getattr(whole, name) for name in ("stiffness", "damping", "amplitude")}
            impedance = whole._replace(feed_forward=minimum + share * (whole.feed_forward - minimum), **parts)
            scaled[index] = impedance
            springs[index] = impedance.tension(float(state.lengths[index]), float(state.speeds[index]))
        limits = self._rig.limits.only(state.active)
        taut = allocate(state.structure, force, (np.minimum(limits.lower + springs, limits.upper), limits.upper))
        if not taut.exact:
            lower = np.clip(springs, limits.lower, limits.upper)
            taut = allocate(state.structure, force, (lower, limits.upper))
        pulls = np.maximum(taut.tensions - springs, 0.0)
        return {
            self._names[index]: impedance._replace(
                feed_forward=min(impedance.feed_forward + float(pulls[index]), self.limits.upper)
            )
            for index, impedance in scaled.items()
        }
