"""Lines of text with forces in them, as sensors write them: ATI's CSV files, other tables, or bare numbers.

ATI's demo programs write a start time, the sample rate, units and counts per unit, each in a line of its own, then
a line that names the columns (``Fx``, ``Fy``, ``Fz`` among them) and then counts; cells may be in quotes. See
"Demo CSV File Format" in ATI's manuals 9620-05 (Network Force/Torque Sensor System) and 9610-05 (Ethernet Axia).
Other tables only need that line of names, in N. Without one, each line holds 3 or 6 numbers, forces first, in N.
Lines that begin with # say nothing, except for `SIMULATED`.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError
from tensionlab.files.reading import brief, read_text
from tensionlab.files.tables import MAX_FILE_BYTES

NAMES = ("fx", "fy", "fz")
SIMULATED = "# simulated"
"""A simulated sensor says so before anything else, so that nobody takes it for a real one."""
UNITS = {"n": 1.0, "newton": 1.0, "kn": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
"""In N."""


class Readings:
    """Which forces do lines tell? Fed as they come, in pieces of any size.

    Parameters
    ----------
    source : str
        Where they come from, for messages.

    Attributes
    ----------
    simulated : bool
        Whether it says so of itself.
    """

    def __init__(self, source: str) -> None:
        self.simulated = False
        self._source = source
        self._rest = ""
        self._line = 0
        self._columns: list[int] | None = None
        self._unit, self._counts = 1.0, 1.0

    def feed(self, text: str) -> Floats:
        """Which forces came? (K, 3) in N.

        Raises
        ------
        HardwareError
            Naming source and line, if they are none.
        """
        *lines, self._rest = (self._rest + text).split("\n")
        found = [force for line in lines if (force := self._read(line)) is not None]
        return np.array(found).reshape(-1, 3)

    def _read(self, line: str) -> list[float] | None:
        self._line += 1
        try:
            cells = next(csv.reader([line.strip("\r\ufeff")]), [])
        except csv.Error as problem:
            raise self._complaint(str(problem)) from None
        cells = [cell.strip() for cell in cells] if len(cells) > 1 else line.replace(";", " ").split()
        if not any(cells) or cells[0].startswith("#"):
            self.simulated |= line.strip() == SIMULATED
            return None
        names = [cell.lower().split()[0].split("(")[0].split("[")[0] if cell else "" for cell in cells]
        if set(NAMES) <= set(names):
            self._columns = [names.index(name) for name in NAMES]
            return None
        if self._columns is None:
            if self._preamble(line):
                return None
            if len(cells) not in (3, 6):
                raise self._complaint(
                    f"{len(cells)} numbers; 3 or 6 are expected where no line names Fx, Fy and Fz"
                )
            self._columns = [0, 1, 2]
        try:
            values = [float(cells[column]) * self._unit / self._counts for column in self._columns]
        except (ValueError, IndexError, OverflowError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise self._complaint(f"{brief(line.strip())} has no three forces")
        return values

    def _preamble(self, line: str) -> bool:
        """Whether this is a line of what ATI writes before the names of the columns; keep what it says."""
        text = line.strip("\r\ufeff\n").replace('"', " ").replace(",", " ").replace(":", " ").lower()
        key, *words = [" ".join(text.split()), *text.split()]
        if key.startswith("force units"):
            unit = words[-1]
            if unit not in UNITS:
                raise self._complaint(f"forces in {brief(unit)}; known are {', '.join(UNITS)}")
            self._unit = UNITS[unit]
        elif key.startswith("counts per unit force"):
            try:
                self._counts = float(words[-1])
            except ValueError:
                self._counts = 0.0
            if not 0.0 < self._counts < math.inf:
                raise self._complaint(f"{brief(line.strip())} tells no counts per unit of force")
        return any(character.isalpha() for character in key.replace("e", "").replace("nan", ""))

    def _complaint(self, what: str) -> HardwareError:
        return HardwareError(f"{self._source}, line {self._line}: {what}")


def read_forces(path: str | Path) -> Floats:
    """Which forces are in a file that a sensor wrote? (K, 3) in N, in the sensor's own axes.

    Raises
    ------
    HardwareError
        Naming the file and the line, if it can't be read or there are none.
    """
    text = read_text(path, "a table of forces (*.csv)", HardwareError, MAX_FILE_BYTES)
    found = Readings(str(path)).feed(text + "\n")
    if not len(found):
        raise HardwareError(f"{path}: no forces in it; a line must name the columns Fx, Fy and Fz")
    return found
