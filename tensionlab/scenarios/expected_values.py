"""Tools for checking a scenario: the rendered force over time, and numbers between an expected low and high."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.effect import Effect
from tensionlab.scenarios.direction import measured_force
from tensionlab.scenarios.play import ScenarioResult

Kind = TypeVar("Kind", bound=Effect)
NOTICEABLE = 0.07
"""Share by which forces differ noticeably."""


class Check(NamedTuple):
    """Measured number, and the bounds between which it is expected."""

    name: str
    unit: str
    low: float
    high: float
    measured: float

    @property
    def met(self) -> bool:
        """Whether the number is within the bounds."""
        return bool(self.low <= self.measured <= self.high)


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """Force on the hand or head over time.

    Attributes
    ----------
    time : (K,) array
    position : (K, d) array
        In the frame of the effects, in m.
    force : (K, d) array
        In N.
    """

    time: Floats
    position: Floats
    force: Floats

    def during(self, begin: float, end: float) -> ForceRecord:
        """Return the part from one time to another."""
        part = between(self.time, begin, end)
        return ForceRecord(self.time[part], self.position[part], self.force[part])


def rendered_force(result: ScenarioResult) -> ForceRecord:
    """Return the true force on the simulated person, each ms, or else the measured one, each cycle."""
    run, person, frame = result.run, result.person, result.scenario.seen_from
    if person is not None:
        position = person.position
        if frame is not None:
            script = result.scenario.person.bodies[frame]
            position = position - np.array([script.position(each) for each in person.time])
        return ForceRecord(person.time, position, person.force)
    position = run.position
    if frame is not None:  # as the cable of a module that rides there shows
        index = [module.frame for module in run.rig.modules].index(frame)
        position = run.rig.anchors[index] - run.structure[:, :, index] * run.lengths[:, index, None]
    return ForceRecord(run.time, position, measured_force(run))


def find_effect(result: ScenarioResult, kind: type[Kind]) -> tuple[Kind, float, float]:
    """Return the first effect of a kind, and the begin and end of its phase."""
    for phase in result.scenario.phases:
        for each in phase.effects.values():
            if isinstance(each, kind):
                return each, phase.begin, phase.end
    raise LookupError(f"{result.scenario.name} has no {kind.__name__}")


def check_near(name: str, unit: str, expected: float, measured: float, share: float = NOTICEABLE) -> Check:
    """Return a check of a number that may differ from the expected one by a share of it."""
    slack = share * abs(expected)
    return Check(name, unit, expected - slack, expected + slack, measured)


def between(time: Floats, begin: float, end: float) -> NDArray[np.bool_]:
    """Return which times are from one to another."""
    return np.asarray((time >= begin) & (time < end))


def loop_delay(result: ScenarioResult) -> float:
    """Return the largest delay of the loop, in s."""
    return float(np.nanmax(result.run.delays, initial=0.0))


def rms(values: Floats) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def maximum(values: Floats) -> float:
    """Return the largest value; NaN of nothing."""
    return float(values.max()) if values.size else float("nan")


def onset(time: Floats, there: NDArray[np.bool_]) -> float:
    """Return how long after the first time a condition holds first, in s; NaN if it never does."""
    return float(time[there][0] - time[0]) if there.any() else float("nan")


def dominant_frequency(time: Floats, values: Floats) -> float:
    """Return the strongest frequency in Hz; NaN of fewer than eight values."""
    if len(time) < 8:
        return float("nan")
    step = float(np.median(np.diff(time)))
    level = values - np.polyval(np.polyfit(time, values, 2), time)
    padded = 8 * len(time)
    spectrum = np.abs(np.fft.rfft(level * np.hanning(len(level)), padded))
    frequencies = np.fft.rfftfreq(padded, step)
    return float(frequencies[int(np.argmax(spectrum))])
