"""What should a scenario feel like, in numbers, and what did it feel like?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from tensionlab.experiments.scenarios.play import Played
from tensionlab.haptics.effects.effect import Effect
from tensionlab.solvers.contract import Floats

Kind = TypeVar("Kind", bound=Effect)


class Row(NamedTuple):
    """A number that was to be between two others, and was, or was not."""

    name: str
    unit: str
    low: float
    high: float
    measured: float

    @property
    def met(self) -> bool:
        """Whether it is."""
        return bool(self.low <= self.measured <= self.high)


@dataclass(frozen=True, eq=False)
class Touch:
    """What was felt, when and where?

    By the simulated person, each ms, if there is one; else by what the modules say, each cycle.

    Attributes
    ----------
    time : (K,) array
    position : (K, d) array
        Seen from where the effects are, in m.
    force : (K, d) array
        In N.
    """

    time: Floats
    position: Floats
    force: Floats

    def during(self, begin: float, end: float) -> Touch:
        """A part of it, from one time to another."""
        part = (self.time >= begin) & (self.time < end)
        return Touch(self.time[part], self.position[part], self.force[part])


def touch(played: Played) -> Touch:
    """What was felt in a scenario?"""
    run, felt, frame = played.run, played.felt, played.scenario.seen_from
    if felt is not None:
        position = felt.position
        if frame is not None:
            script = played.scenario.person.bodies[frame]
            position = position - np.array([script.position(each) for each in felt.time])
        return Touch(felt.time, position, felt.force)
    position = run.position
    if frame is not None:  # as the cable of a module that rides there tells
        index = [module.frame for module in run.rig.modules].index(frame)
        position = run.rig.anchors[index] - run.structure[:, :, index] * run.lengths[:, index, None]
    return Touch(run.time, position, np.einsum("knm,km->kn", run.structure, np.nan_to_num(run.tensions)))


def effect(played: Played, kind: type[Kind]) -> tuple[Kind, float, float]:
    """Which effect of a kind has a scenario, and from when to when?"""
    for phase in played.scenario.phases:
        for each in phase.effects.values():
            if isinstance(each, kind):
                return each, phase.begin, phase.end
    raise LookupError(f"{played.scenario.name} has no {kind.__name__}")
