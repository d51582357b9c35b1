"""Tables of numbers as CSV files, read with care."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from tensionlab import writing
from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.regression import Floats


def read_table(path: str | Path, needed: Sequence[str], optional: Collection[str] = ()) -> dict[str, Floats]:
    """Which numbers does each column hold?

    Parameters
    ----------
    path : str or Path
        A CSV file whose first line names the columns. Empty lines, and those that begin with #, are passed over.
    needed, optional : sequence of str
        Columns that must and that may be there; a file with others is refused.

    Returns
    -------
    dict of (K,) arrays
        By column.

    Raises
    ------
    CalibrationError
        Naming the file, the line and the column: what is wrong and what to do.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path}: cannot be read ({error}); give a table of numbers (*.csv)") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line.strip() and not line.startswith("#")]
    rows = list(csv.reader(line for _, line in lines))
    if len(rows) < 2:
        raise CalibrationError(f"{path}: no numbers; the first line names the columns {', '.join(needed)}")
    heading = [name.strip() for name in rows[0]]
    for name in needed:
        if heading.count(name) != 1:
            there = "is there twice" if name in heading else "is missing"
            raise CalibrationError(f'{path}: column "{name}" {there}; there must be {", ".join(needed)}')
    for name in heading:
        if name not in needed and name not in optional:
            known = ", ".join([*needed, *optional])
            raise CalibrationError(f'{path}: nobody knows what the column "{name}" is; there may be {known}')
    values = np.empty((len(rows) - 1, len(heading)))
    for index, ((number, _), row) in enumerate(zip(lines[1:], rows[1:], strict=True)):
        if len(row) != len(heading):
            raise CalibrationError(f"{path}: line {number} has {len(row)} values for {len(heading)} columns")
        for column, word in enumerate(row):
            values[index, column] = _number(path, number, heading[column], word)
    return {name: values[:, column] for column, name in enumerate(heading)}


def _number(path: str | Path, line: int, column: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CalibrationError(f'{path}: line {line}, column "{column}": {word!r} is no finite number')
    return value


def write_table(path: str | Path, columns: Mapping[str, Floats | Sequence[float]]) -> None:
    """Write columns of numbers to a file, as `table_text` has them."""
    writing.write_text(path, table_text(columns))


def table_text(columns: Mapping[str, Floats | Sequence[float]]) -> str:
    """Return columns of numbers as CSV, with as many digits as `read_table` needs to find the same."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([f"{value:.10g}" for value in row] for row in zip(*columns.values(), strict=True))
    return text.getvalue()
