"""Tables of numbers, written as CSV files."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from tensionlab.hardware.calibration.regression import Floats


def write_table(path: str | Path, columns: Mapping[str, Floats | Sequence[float]]) -> None:
    """Write columns of numbers, with as many digits as `tensionlab.tables.read_table` needs to find the same."""
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([f"{value:.10g}" for value in row] for row in zip(*columns.values(), strict=True))
