"""Validations of many simulated rigs, a row each: what would have been measured if one thing were different?

One Parquet table. `datasets/what-if/README.md` has its columns.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensionlab import records
from tensionlab.errors import ShapeError
from tensionlab.files.tables import read_parquet


@dataclass(frozen=True)
class Trial:
    """What was measured on one rig?

    Attributes
    ----------
    question : str
        What differs: "preset", "error", "solver", "solver alone" (on a rig without errors), "side" or
        "calibration".
    choice : str
        How: the preset's name, the only error that is there, the solver, the side of the triangle in m, what was
        calibrated.
    seed : int
        Of the rig's errors: the same seed is the same rig.
    vectors, exact : int
        How many forces were measured; how many of these the nominal rig can render.
    angle, angle_largest : float
        Between measured and desired force: mean and largest, in degrees.
    magnitude, magnitude_error, vector : float
        Means of the size of the measured force, of how far that is from the desired one either way, and of the
        length of the error vector, in N.
    within : float
        Share of the angles up to 45 degrees.
    """

    question: str
    choice: str
    seed: int
    vectors: int
    exact: int
    angle: float
    angle_largest: float
    magnitude: float
    magnitude_error: float
    vector: float
    within: float


@dataclass(frozen=True)
class Trials:
    """Many trials, in the order in which they are to be shown, and the manifest of the run that made them."""

    rows: tuple[Trial, ...]
    manifest: dict[str, Any]

    def of(self, question: str) -> dict[str, list[Trial]]:
        """Which trials answer a question? By choice."""
        found: dict[str, list[Trial]] = {}
        for row in self.rows:
            if row.question == question:
                found.setdefault(row.choice, []).append(row)
        return found


def write(path: str | Path, rows: Sequence[Trial], manifest: dict[str, Any]) -> None:
    """Write trials.

    Raises
    ------
    ShapeError
        If the file's name does not say that they are simulated.
    """
    if "simulated" not in Path(path).stem:
        raise ShapeError(f'{path}: the trials are simulated, so its name must say "simulated"')
    records.write_parquet(path, [dataclasses.asdict(row) for row in rows], {**manifest, "simulated": True})


def read(path: str | Path) -> Trials:
    """Which trials are in a file?

    Raises
    ------
    ShapeError
        If there are none.
    """
    table = read_parquet(path, "a table of trials (*.parquet)", ShapeError)
    return Trials(tuple(table.rows(Trial, ShapeError)), table.manifest)
