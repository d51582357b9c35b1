"""What is a rig to be asked for, so that a hand feels some effects? All that stands between the two.

What is stiff or vibrates goes to the modules whose cables lie along it; the rest is the host's, no stiffer than a
loop can be without shaking that is as late as it is found to be. Then come the common stages: see
`tensionlab.haptics.rendering.filtering`.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocator
from tensionlab.arrays import Floats
from tensionlab.demand import Demand, Impedance, RigState
from tensionlab.haptics.effects import Friction, ModuleLimits, Shape, Viscous, Wall
from tensionlab.haptics.effects.effect import Effect, Memory, Motion, Rendered
from tensionlab.haptics.effects.on_module import Divided, EffectFailed, divide
from tensionlab.haptics.rendering.filtering import MAX_FORCE_N, Stages, at_most
from tensionlab.haptics.rendering.passivity import PassivityController, most_damping
from tensionlab.haptics.rendering.stability import stiffness_cap
from tensionlab.model.rig import Rig

FORCE_CAP = 2.0
"""Of the desired force, as a multiple of all upper tensions together. A cap at 1 would take away what can be
rendered: where cables pull aslant, more is rendered of a desired force that is too large by some."""
HAND_DAMPING = 2.0
"""b of a hand that holds something, in N s/m: a default of this project."""
HAND_MASS = 0.3
"""The least that a hand may weigh that moves along, in kg: a default of this project."""
UNKNOWN = 0.25
"""How late a loop is taken to be before it is known, in s: as long as set-points live."""
REMEMBERED = 100
"""Cycles whose delays and lengths count for how late the loop is."""
WATCHED = (Wall, Shape, Viscous, Friction)
"""Effects that give no energy which they have not been given before: the controller looks after these. A magnet, a
spring or a lift may have some to give at first, and a weight, a shot or a vibration is meant to."""


@dataclass(frozen=True, eq=False)
class OnCables:
    """Some effects, at the cables of a rig as they are now. An effect itself, whose memory is a `Divided`."""

    effects: tuple[Effect, ...]
    lengths: Floats
    directions: Floats
    able: NDArray[np.bool_]
    limits: ModuleLimits
    cap: float

    def render(self, motion: Motion, memory: Memory = None) -> Rendered:
        """What is the host to render?"""
        found = divide(
            self.effects, motion, memory, self.lengths, self.directions, self.able, self.limits, self.cap
        )
        return Rendered(found.force, found, found.sudden)


class Group(NamedTuple):
    """What is remembered of some effects: their names and kinds, and what their stages do."""

    names: tuple[tuple[str, type], ...]
    memory: Memory


class Renderer:
    """Makes demands of effects, one a cycle, and keeps what they remember.

    No more is asked for than twice what all cables together pull. What a cycle that fails would have remembered
    is not kept: without the effect that failed, the next one goes on from the force of the one before, by the
    slew.

    Parameters
    ----------
    rig : Rig
        Effects act on its point or reference point.

    Attributes
    ----------
    limits : ModuleLimits
        What all modules render; those of the firmware as it comes, and the rig's tensions, unless they are set.
    delay : float
        How late the loop is, in s: the worst of the last 100 cycles.
    ceiling : float
        How stiff the host may be now, in N/m, with that delay and the longest of those cycles.
    cut : dict of str to dict
        By the names of effects, stiffnesses that were asked for in the latest cycle and are beyond that.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._names = [module.name for module in rig.modules]
        self.limits = ModuleLimits(float(rig.limits.lower.max()), float(rig.limits.upper.min()))
        self._most = min(FORCE_CAP * float(rig.limits.upper.sum()), MAX_FORCE_N)
        self._delays: deque[float] = deque(maxlen=REMEMBERED)
        self._steps: deque[float] = deque(maxlen=REMEMBERED)
        self._controller: PassivityController | None = None
        self._kept: dict[bool, Group] = {}
        self._allocators: dict[bytes, Allocator] = {}  # by the modules that take part
        self.delay = UNKNOWN
        self.ceiling = 0.0
        self.cut: dict[str, dict[str, float]] = {}

    def __call__(
        self, effects: Mapping[str, Effect], motion: Motion, state: RigState, share: float = 1.0
    ) -> Demand:
        """What is to be asked for now?

        Parameters
        ----------
        effects : mapping of str to Effect
            By any names. One that is changed keeps what it remembers, unless it becomes another kind.
        motion : Motion
            Of the hand.
        state : RigState
        share : float
            Of everything, from 0 to 1. At 0 the cables are held taut.

        Raises
        ------
        EffectFailed
            Naming the effect that could not be rendered.
        """
        self._watch(state, motion.step)
        able = state.active & (self._rig.n == self._rig.dimension)
        force = np.zeros(self._rig.dimension)
        impedances: dict[int, Impedance] = {}
        self.cut = {}
        for watched in (True, False):
            chosen = {name: each for name, each in effects.items() if isinstance(each, WATCHED) is watched}
            done, divided = self._staged(chosen, watched, motion, state, able)
            force = force + done + divided.pushed
            impedances |= divided.impedances
            self.cut |= {name: each for name, each in zip(chosen, divided.cut, strict=True) if each}
            able = able & [index not in divided.impedances for index in range(self._rig.m)]
        force = at_most(force, self._most)
        balance = self._balance(force, impedances, state) if impedances else np.zeros(self._rig.m)
        if share <= 0.0:
            return Demand()
        wrench = np.zeros(self._rig.n)
        wrench[: self._rig.dimension] = share * force
        springs = {
            self._names[index]: self._scaled(each, share, balance[index]) for index, each in impedances.items()
        }
        return Demand(wrench, springs)

    def _staged(
        self,
        effects: Mapping[str, Effect],
        watched: bool,
        motion: Motion,
        state: RigState,
        able: NDArray[np.bool_],
    ) -> tuple[Floats, Divided]:
        """What is left for the host of some effects, after the stages, and who else does what?"""
        d = self._rig.dimension
        names = tuple((name, type(each)) for name, each in effects.items())
        directions = state.structure[:d].T
        cables = OnCables(tuple(effects.values()), state.lengths, directions, able, self.limits, self.ceiling)
        stages = Stages(cables, self._controller if watched else None, most=self._most)
        before = self._kept.get(watched)
        memory = None if before is None else _matched(before, names)
        try:
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # what is not finite is refused
                done = stages.render(motion, memory)
        except EffectFailed as failed:
            raise EffectFailed(names[int(failed.effect)][0], failed.why) from failed.__cause__
        divided: Divided = done.memory.effect
        # Only what the effects remember goes on; who does what is decided anew in each cycle.
        self._kept[watched] = Group(names, done.memory._replace(effect=divided.memory))
        return done.force, divided

    def _watch(self, state: RigState, step: float) -> None:
        """Find out how late the loop is, and what may be asked of it therefore."""
        known = state.delays[state.active & np.isfinite(state.delays)]
        if known.size:
            self._delays.append(float(known.max()))
        self._steps.append(step)
        delay = max(self._delays, default=UNKNOWN)
        self.ceiling = stiffness_cap(delay, max(self._steps), HAND_DAMPING)
        if delay == self.delay and self._controller is not None:
            return
        self.delay = delay
        step = statistics.median(self._steps)  # one cycle that came late says nothing of the others
        steps = delay / step
        # A step more or less is no news: steps are not all of one length.
        if self._controller is None or not -1.5 < steps - self._controller.delay < 0.5:
            self._controller = PassivityController(most_damping(HAND_MASS, delay, step), math.ceil(steps))
            if (group := self._kept.get(True)) is not None:  # it paired forces with what came after another time
                self._kept[True] = group._replace(memory=group.memory._replace(observed=None))

    def _balance(self, force: Floats, impedances: Mapping[int, Impedance], state: RigState) -> Floats:
        """How much harder than its impedance must each cable pull, so that the others can do the rest, in N?

        As hard as it would if there were no impedances, and all cables rendered the force together.
        """
        key = state.active.tobytes()
        if key not in self._allocators:
            self._allocators[key] = Allocator(self._rig.limits.only(state.active))
        extra = self._allocators[key](state.structure, force).tensions.copy()
        for index, each in impedances.items():
            extra[index] -= each.tension(float(state.lengths[index]), float(state.speeds[index]))
        return np.maximum(extra, 0.0)

    def _scaled(self, cable: Impedance, share: float, balance: float) -> Impedance:
        """A share of what a module is to render, and what others need; a vibrating cable stays taut."""
        amplitude = share * cable.amplitude
        least = self.limits.lower + amplitude if amplitude else 0.0
        return Impedance(
            cable.rest,
            share * cable.stiffness,
            share * cable.damping,
            min(max(share * cable.feed_forward + balance, least), self.limits.upper),
            amplitude,
            cable.frequency,
        )


def _matched(before: Group, names: tuple[tuple[str, type], ...]) -> Memory:
    """What is remembered, for effects that may be others than before: those that are new remember nothing."""
    if names == before.names:
        return before.memory
    known = dict(zip(before.names, before.memory.effect, strict=True))
    return before.memory._replace(effect=tuple(known.get(name) for name in names))
