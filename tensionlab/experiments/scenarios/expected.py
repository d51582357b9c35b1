"""The expected feel of each scenario: bounds are what people hardly tell apart, or what a module can do.

Forces differ noticeably by some 7 per cent at 2.5 to 10 N. All bounds are this project's own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tensionlab.experiments.scenarios.expected_collision import collision
from tensionlab.experiments.scenarios.feel import Row, effect, touch
from tensionlab.experiments.scenarios.play import Played
from tensionlab.haptics.effects import Bow
from tensionlab.solvers.contract import Floats

NOTICEABLE = 0.07
"""Share by which forces differ noticeably."""


def expected(played: Played) -> tuple[Row, ...]:
    """What should a scenario have felt like, and what did it? None for a scenario that is not of this package."""
    judge = EXPECTED.get(played.scenario.name)
    return () if judge is None else judge(played)


def bow(played: Played) -> tuple[Row, ...]:
    """Force and energy against the draw; a stop at its end; a string that is loosed, and hums."""
    string, _, _ = effect(played, Bow)
    felt = touch(played)
    far = np.linalg.norm(felt.position, axis=1)
    pull = -np.einsum("kd,kd->k", felt.force, felt.position) / far
    locked = played.run.brakes.any(axis=1)
    begin = float(played.run.time[locked][0]) if locked.any() else string.loosed
    end = float(played.run.time[locked][-1]) if locked.any() else string.loosed
    drawing = (felt.time > SETTLED) & (felt.time < begin)
    draw = np.maximum(far - string.brace, 0.0)
    wanted = string.pull(draw)
    work = float(np.trapezoid(pull[drawing], draw[drawing]))
    energy = float(np.trapezoid(wanted[drawing], draw[drawing]))
    held = (felt.time > begin + LOCKING) & (felt.time < end)
    gone = (felt.time >= string.loosed) & (felt.time < string.loosed + 5.0 * string.fade)
    slack = string.slack + 2.0 * string.hum
    fallen = _first(felt.time[gone], pull[gone] < slack)
    humming = gone & (felt.time > string.loosed + fallen)
    rows = [
        Row(
            "force against the draw, root mean square error", "N", 0.0, 0.3, _rms(pull[drawing] - wanted[drawing])
        ),
        Row("work of the draw", "J", energy * (1 - NOTICEABLE), energy * (1 + NOTICEABLE), work),
        Row("time from the loose to a slack string", "s", 0.0, 0.04 + late(played), fallen),
        Row(
            "hum", "Hz", 0.9 * string.frequency, 1.1 * string.frequency, _pitch(felt.time[humming], pull[humming])
        ),
    ]
    if played.felt is not None and held.any():
        rows[2:2] = [
            Row("largest force at the stop", "N", 40.0, 60.0, float(pull[held].max())),
            Row("give of the stop under it", "m", 0.0, 0.025, float(np.ptp(far[held & (pull > string.most)]))),
        ]
    return tuple(rows)


SETTLED = 0.3
"""What is felt before, in s, is the modules coming up."""
LOCKING = 0.1
"""How long a brake takes to lock, in s."""

EXPECTED: dict[str, Callable[[Played], tuple[Row, ...]]] = {"collision": collision, "bow": bow}
"""By the scenario's name."""


def late(played: Played) -> float:
    """How late was the loop, in s?"""
    return float(np.nanmax(played.run.delays, initial=0.0))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def _first(time: Floats, there: Floats) -> float:
    """How long after its begin is something there?"""
    return float(time[there][0] - time[0]) if there.any() else float("nan")


def _pitch(time: Floats, values: Floats) -> float:
    """Which frequency is strongest, in Hz?"""
    if len(time) < 8:
        return float("nan")
    step = float(np.median(np.diff(time)))
    level = values - np.polyval(np.polyfit(time, values, 2), time)
    padded = 8 * len(time)
    spectrum = np.abs(np.fft.rfft(level * np.hanning(len(level)), padded))
    frequencies = np.fft.rfftfreq(padded, step)
    return float(frequencies[int(np.argmax(spectrum))])
