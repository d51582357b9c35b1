"""What should a scenario feel like, in numbers, and what did it feel like?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.effect import Effect
from tensionlab.scenarios.direction import told_by
from tensionlab.scenarios.play import Played

Kind = TypeVar("Kind", bound=Effect)
NOTICEABLE = 0.07
"""Share by which forces differ noticeably."""


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
        part = between(self.time, begin, end)
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
    return Touch(run.time, position, told_by(run))


def effect(played: Played, kind: type[Kind]) -> tuple[Kind, float, float]:
    """Which effect of a kind has a scenario, and from when to when?"""
    for phase in played.scenario.phases:
        for each in phase.effects.values():
            if isinstance(each, kind):
                return each, phase.begin, phase.end
    raise LookupError(f"{played.scenario.name} has no {kind.__name__}")


def about(name: str, unit: str, wanted: float, measured: float, share: float = NOTICEABLE) -> Row:
    """A number that was to be another one, give or take a share."""
    slack = share * abs(wanted)
    return Row(name, unit, wanted - slack, wanted + slack, measured)


def between(time: Floats, begin: float, end: float) -> NDArray[np.bool_]:
    """Which times are from one to another?"""
    return np.asarray((time >= begin) & (time < end))


def late(played: Played) -> float:
    """How late was the loop, in s?"""
    return float(np.nanmax(played.run.delays, initial=0.0))


def rms(values: Floats) -> float:
    """What is their root mean square?"""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def first(time: Floats, there: NDArray[np.bool_]) -> float:
    """How long after its begin is something there?"""
    return float(time[there][0] - time[0]) if there.any() else float("nan")


def pitch(time: Floats, values: Floats) -> float:
    """Which frequency is strongest, in Hz?"""
    if len(time) < 8:
        return float("nan")
    step = float(np.median(np.diff(time)))
    level = values - np.polyval(np.polyfit(time, values, 2), time)
    padded = 8 * len(time)
    spectrum = np.abs(np.fft.rfft(level * np.hanning(len(level)), padded))
    frequencies = np.fft.rfftfreq(padded, step)
    return float(frequencies[int(np.argmax(spectrum))])
