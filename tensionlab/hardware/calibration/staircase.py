"""A module pulls at a force sensor in steps, up and down again, and the host keeps what the module measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import CalibrationError
from tensionlab.files.tables import read_table
from tensionlab.hardware.calibration.gain import Balance
from tensionlab.hardware.calibration.pulling import PERIOD, pulling
from tensionlab.hardware.calibration.tables import write_table
from tensionlab.hardware.client.module import ModuleClient

LEVELS = 8
DWELL = 1.5
"""How long each step is held, in s; what it shows is taken from its second half."""
RATE = 1.0
"""From step to step, in N/s: slow, so that the cable does not ring over its friction."""
SHARE = 0.9
"""Of what the winding stands for ever: the highest step."""
GRID = 0.02
"""Of the lags that are tried, in s."""
AGREEMENT = 0.95
"""Least correlation of force and current for the two to be the same staircase."""


@dataclass(frozen=True, eq=False)
class Staircase:
    """What the module measured meanwhile, in columns.

    Attributes
    ----------
    time : (K,) array
        Of the host, in s since the start.
    current : (K,) array
        In A.
    tension : (K,) array
        That the module made its motor pull with, in N.
    step : (K,) array
        Number of the step, from 0; -1 on the way between two.
    direction : (K,) array
        1 where it was reached from below, -1 from above.
    """

    time: Floats
    current: Floats
    tension: Floats
    step: Floats
    direction: Floats

    def save(self, path: str | Path) -> None:
        """Write it as CSV."""
        write_table(path, vars(self))


COLUMNS = tuple(Staircase.__dataclass_fields__)


def load_staircase(path: str | Path) -> Staircase:
    """Which staircase was saved there? A `CalibrationError` says what is wrong with the file."""
    return Staircase(**read_table(path, COLUMNS, error=CalibrationError))


def load_sensor(path: str | Path) -> tuple[Floats, Floats]:
    """Which times, in s, and forces, in N, did a sensor record? Columns ``time``, ``force``; pulling is positive.

    Raises
    ------
    CalibrationError
        What is wrong with the file; times that do not grow.
    """
    table = read_table(path, ("time", "force"), error=CalibrationError)
    if len(table["time"]) < 10 or (np.diff(table["time"]) <= 0.0).any():
        raise CalibrationError(f"{path}: times must grow from line to line, over at least 10 lines")
    return table["time"], table["force"]


def climb(client: ModuleClient, progress: Callable[[float], None] | None = None) -> Staircase:
    """Which currents go with a staircase of tensions, up and down?

    The cable is tied to a force sensor that does not move. The module is stopped at the end, also after an error.
    """
    rows: list[tuple[float, ...]] = []
    most = client.parameter("current_continuous") * client.hello().newton_per_ampere
    with pulling(client) as puller:
        info = puller.info
        levels = np.linspace(info.tension_lower, SHARE * min(info.tension_upper, most), LEVELS)
        way = [*levels, *levels[-2::-1]]
        start, tension = client.link.clock(), float(levels[0])

        def hold(step: int, direction: int) -> None:
            told = puller.hold(tension)
            rows.append((client.link.clock() - start, told.current, told.tension, step, direction))

        for step, level in enumerate(way):
            direction = 1 if step < LEVELS else -1
            while abs(level - tension) > 1e-9:
                tension += float(np.clip(level - tension, -RATE * PERIOD, RATE * PERIOD))
                hold(-1, direction)
            for _ in range(round(DWELL / PERIOD)):
                hold(step, direction)
            if progress:
                progress((step + 1) / len(way))
    return Staircase(*np.array(rows, dtype=np.float64).T)


def lag(record: Staircase, time: Floats, force: Floats) -> float:
    """By how much is the sensor's clock ahead of the host's, in s? That at which force and current agree best.

    Raises
    ------
    CalibrationError
        They agree nowhere.
    """
    spare = 0.2 * (record.time[-1] - record.time[0])
    lags = np.arange(time[0] - record.time[0] - spare, time[-1] - record.time[-1] + spare, GRID)
    agreement = [_correlation(record.current, np.interp(record.time + each, time, force)) for each in lags]
    if not agreement or max(agreement) < AGREEMENT:
        best = f"agree by {max(agreement):.2f} at best" if agreement else "do not overlap"
        raise CalibrationError(
            f"the sensor's force and the module's current {best}; were they recorded together, in s and N, "
            "with the cable tight? Give the lag yourself if the clocks are known"
        )
    return float(lags[int(np.argmax(agreement))])


def balances(record: Staircase, time: Floats, force: Floats, ahead: float) -> list[Balance]:
    """Which force goes with which current on each step? The first is left out: nothing led to it.

    Raises
    ------
    CalibrationError
        A step that the sensor did not record.
    """
    found = []
    for step in np.unique(record.step[record.step > 0]):
        on = np.flatnonzero(record.step == step)
        late = on[len(on) // 2 :]
        start, end = record.time[late[0]] + ahead, record.time[late[-1]] + ahead
        within = (time >= start) & (time <= end)
        if not within.any():
            raise CalibrationError(
                f"the sensor recorded nothing from {start:.2f} to {end:.2f} s, which is step {step:.0f}; start it "
                "before the staircase, and stop it after"
            )
        found.append(
            Balance(
                float(force[within].mean()), float(record.current[late].mean()), int(record.direction[late[0]])
            )
        )
    return found


def _correlation(one: Floats, other: Floats) -> float:
    if np.ptp(other) == 0.0:
        return -1.0
    return float(np.corrcoef(one, other)[0, 1])
