"""Tables of numbers, written as CSV files."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from tensionlab.arrays import Floats
from tensionlab.files import writing


def write_table(path: str | Path, columns: Mapping[str, Floats | Sequence[float]]) -> None:
    """Write columns of numbers to a file, as `table_text` has them."""
    writing.write_text(path, table_text(columns))


def table_text(columns: Mapping[str, Floats | Sequence[float]]) -> str:
    """Return columns of numbers as CSV, with as many digits as reading needs to find the same."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([f"{value:.10g}" for value in row] for row in zip(*columns.values(), strict=True))
    return text.getvalue()
