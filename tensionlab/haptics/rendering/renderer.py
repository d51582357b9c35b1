"""Renderer: from effects and the state of a rig to a demand, once a cycle.

Stiff and vibrating parts go to the modules whose cables lie along them (`assignment`). The host renders the
remainder, no stiffer than is stable with the loop's delay (`stability`), through the stages of `filtering`.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocator
from tensionlab.demand import Demand, Impedance, RigState
from tensionlab.haptics.effects import Friction, Shape, Viscous, Wall
from tensionlab.haptics.effects.effect import Effect, Motion
from tensionlab.haptics.rendering.assignment import (
    CableState,
    Cut,
    EffectFailed,
    EffectMemory,
    ModuleLimits,
    RenderPlan,
    assign,
)
from tensionlab.haptics.rendering.filtering import MAX_FORCE_N, StageMemory, Stages, limit_force
from tensionlab.haptics.rendering.stability import PassivityController, max_damping, stiffness_cap
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

# Largest desired force over the sum of all upper tensions. At 1 it would cost feasible force: if cables pull
# aslant, a desired force that is somewhat too large is rendered better.
MAX_FORCE_RATIO = 2.0
HAND_DAMPING = 2.0  # b of a hand that holds something, in N s/m: a default of this project
MIN_HAND_MASS_KG = 0.3  # smallest effective mass of a hand (our default)
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
    ``ceiling`` the host stiffness limit in N/m, with that delay and the longest of those cycles; ``cut`` has, by
    the names of effects, the stiffnesses that were not rendered as desired in the latest cycle.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._names = [module.name for module in rig.modules]
        self.limits = ModuleLimits(float(rig.limits.lower.max()), float(rig.limits.upper.min()))
        self._max_force = min(MAX_FORCE_RATIO * float(rig.limits.upper.sum()), MAX_FORCE_N)
        self._delays: deque[float] = deque(maxlen=DELAY_CYCLES)
        self._steps: deque[float] = deque(maxlen=DELAY_CYCLES)
        self._controller: PassivityController | None = None
        self._memories = {True: GroupMemory({}, None), False: GroupMemory({}, None)}  # by whether passive
        self._allocators: dict[bytes, Allocator] = {}  # by the modules that take part
        self.delay = INITIAL_DELAY_S
        self.ceiling = 0.0
        self.cut: dict[str, dict[str, Cut]] = {}

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
        self.cut = {}
        for passive in (True, False):
            group = {name: each for name, each in effects.items() if isinstance(each, PASSIVE_EFFECTS) is passive}
            host, plan = self._render(group, passive, motion, state, available)
            force, desired = force + host + plan.expected, desired + plan.desired
            impedances |= plan.impedances
            self.cut |= {name: each for name, each in zip(group, plan.cut, strict=True) if each}
            available = available & [index not in plan.impedances for index in range(self._rig.m)]
        force = limit_force(force, self._max_force)
        balance = self._balance(force, impedances, state) if impedances else np.zeros(self._rig.m)
        if share <= 0.0:
            return Demand()
        wrench, wanted = np.zeros(self._rig.n), np.zeros(self._rig.n)
        wrench[: self._rig.dimension] = share * force
        wanted[: self._rig.dimension] = share * desired
        springs = {
            self._names[index]: self._scaled(each, share, balance[index]) for index, each in impedances.items()
        }
        return Demand(wrench, springs, desired=wanted)

    def _render(
        self,
        effects: Mapping[str, Effect],
        passive: bool,
        motion: Motion,
        state: RigState,
        available: NDArray[np.bool_],
    ) -> tuple[Floats, RenderPlan]:
        """Return the host-side force of effects after the stages, and their plan."""
        stages = Stages(self._controller if passive else None, max_force=self._max_force)
        before = self._memories[passive]
        smooth = stages.smooth(motion, before.stages)
        cables = CableState(state.lengths, state.structure[: self._rig.dimension].T, available)
        memories: list[EffectMemory] = []
        for name, effect in effects.items():
            kind, memory = before.effects.get(name, (None, EffectMemory()))
            memories.append(memory if kind is type(effect) else EffectMemory())
        try:
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # `assign` refuses infinite forces
                plan = assign(tuple(effects.values()), smooth, cables, self.limits, self.ceiling, memories)
                force, stage_memory = stages.filter(plan.force, smooth, plan.bypass_slew, before.stages)
        except EffectFailed as failed:
            raise EffectFailed(list(effects)[int(failed.effect)], failed.reason) from failed.__cause__
        kinds = map(type, effects.values())
        kept = dict(zip(effects, zip(kinds, plan.memories, strict=True), strict=True))
        self._memories[passive] = GroupMemory(kept, stage_memory)
        return force, plan

    def _measure_delay(self, state: RigState, step: float) -> None:
        """Update the loop latency, and with it the host stiffness limit and the passivity controller."""
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
            effects, stages = self._memories[True]
            if stages is not None:  # the observer paired forces and motions by another delay
                self._memories[True] = GroupMemory(effects, stages._replace(observed=None))

    def _balance(self, force: Floats, impedances: Mapping[int, Impedance], state: RigState) -> Floats:
        """Return the tension in N that each cable needs besides its impedance.

        Together they are the tensions with which all cables would render the force without impedances.
        """
        key = state.active.tobytes()
        if key not in self._allocators:
            self._allocators[key] = Allocator(self._rig.limits.only(state.active))
        extra = self._allocators[key](state.structure, force).tensions.copy()
        for index, each in impedances.items():
            extra[index] -= each.tension(float(state.lengths[index]), float(state.speeds[index]))
        return np.maximum(extra, 0.0)

    def _scaled(self, cable: Impedance, share: float, balance: float) -> Impedance:
        """Return a share of an impedance plus a balance in N; a vibrating cable stays taut."""
        amplitude = share * cable.amplitude
        lowest = self.limits.lower + amplitude if amplitude else 0.0
        feed_forward = min(max(share * cable.feed_forward + balance, lowest), self.limits.upper)
        stiffness, damping = share * cable.stiffness, share * cable.damping
        return Impedance(cable.rest, stiffness, damping, feed_forward, amplitude, cable.frequency)
