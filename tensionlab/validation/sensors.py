"""Force sensors: their interface, their lines of text, and sensors behind a file or a TCP port.

Lines are ATI's CSV, other tables, or bare numbers. ATI's demo programs write a start time, the sample rate, units
and counts per unit, each in a line of its own, then a line that names the columns (``Fx``, ``Fy``, ``Fz`` among
them) and then counts; cells may be in quotes. See "Demo CSV File Format" in ATI's manuals 9620-05 (Network
Force/Torque Sensor System) and 9610-05 (Ethernet Axia). Other tables only need that line of names, in N. Without
one, each line holds 3 or 6 numbers, forces first, in N. Lines that begin with # are comments, except for
`SIMULATED`.
"""

from __future__ import annotations

import csv
import math
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from tensionlab.errors import HardwareError, LinkError
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import as_path, brief

# From the sensor's axes, Z up, to the devices', Y up: a turn by -90 degrees about X.
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
SAMPLE_RATE_HZ = 1000
FORCE_COLUMNS = ("fx", "fy", "fz")
SIMULATED = "# simulated"  # first line of a simulated sensor, so that it is not taken for a real one
UNITS_N = {"n": 1.0, "newton": 1.0, "kn": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
SCHEMES = ("socket://", "tcp://")
CHUNK_BYTES = 1 << 20
TIMEOUT_S, POLL_S = 5.0, 0.01  # limit of the connection and of the first numbers, and the time between looks


class ForceSensor(Protocol):
    """Force sensor that the cables pull on, and that measures by itself."""

    @property
    def simulated(self) -> bool:
        """Whether it is no real one."""

    def take(self) -> Floats:
        """Return the forces since the last call, (K, 3) in N, in the sensor's own axes, Z up."""

    def close(self) -> None:
        """Release it."""


class ForceParser:
    """Parser of lines with forces, fed in pieces of any size.

    ``source`` names them in messages; ``simulated`` tells whether a line said so. What is no force is a
    `HardwareError`.
    """

    def __init__(self, source: str) -> None:
        self.simulated = False
        self._source = source
        self._rest = ""
        self._line = 0
        self._columns: list[int] | None = None
        self._unit, self._counts = 1.0, 1.0

    def feed(self, text: str) -> Floats:
        """Return the forces of the lines that are complete now, (K, 3) in N."""
        *lines, self._rest = (self._rest + text).split("\n")
        found = [force for line in lines if (force := self._parse(line)) is not None]
        return np.array(found).reshape(-1, 3)

    def _parse(self, line: str) -> list[float] | None:
        self._line += 1
        try:
            cells = next(csv.reader([line.strip("\r\ufeff")]), [])
        except csv.Error as problem:
            raise self._error(str(problem)) from None
        cells = [cell.strip() for cell in cells] if len(cells) > 1 else line.replace(";", " ").split()
        if not any(cells) or cells[0].startswith("#"):
            self.simulated |= line.strip() == SIMULATED
            return None
        names = [cell.lower().split()[0].split("(")[0].split("[")[0] if cell else "" for cell in cells]
        if set(FORCE_COLUMNS) <= set(names):
            self._columns = [names.index(name) for name in FORCE_COLUMNS]
            return None
        if self._columns is None:
            if self._parse_preamble(line):
                return None
            if len(cells) not in (3, 6):
                raise self._error(f"{len(cells)} numbers; 3 or 6 are expected where no line names Fx, Fy and Fz")
            self._columns = [0, 1, 2]
        try:
            values = [float(cells[column]) * self._unit / self._counts for column in self._columns]
        except (ValueError, IndexError, OverflowError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise self._error(f"{brief(line.strip())} has no three forces")
        return values

    def _parse_preamble(self, line: str) -> bool:
        """Keep units and counts that ATI writes before the columns' names; tell whether this is such a line."""
        text = line.strip("\r\ufeff\n").replace('"', " ").replace(",", " ").replace(":", " ").lower()
        key, *words = [" ".join(text.split()), *text.split()]
        if key.startswith("force units"):
            unit = words[-1]
            if unit not in UNITS_N:
                raise self._error(f"forces in {brief(unit)}; known are {', '.join(UNITS_N)}")
            self._unit = UNITS_N[unit]
        elif key.startswith("counts per unit force"):
            try:
                self._counts = float(words[-1])
            except ValueError:
                self._counts = 0.0
            if not 0.0 < self._counts < math.inf:
                raise self._error(f"{brief(line.strip())} has no counts per unit of force")
        return any(character.isalpha() for character in key.replace("e", "").replace("nan", ""))

    def _error(self, problem: str) -> HardwareError:
        return HardwareError(f"{self._source}, line {self._line}: {problem}")


class TextSensor:
    """Sensor that writes or sends lines of forces, read without waiting; ``source`` names it in messages."""

    def __init__(self, source: str, read: Callable[[], str], close: Callable[[], None]) -> None:
        self._parser, self._read, self.close = ForceParser(source), read, close

    @property
    def simulated(self) -> bool:
        """Whether its first line says so."""
        return self._parser.simulated

    def take(self) -> Floats:
        """Return the forces since the last call."""
        return self._parser.feed(self._read())


def follow_file(path: str | Path) -> TextSensor:
    """Open a file that the sensor's own program writes during the validation, such as ATI's CSV.

    What was in it before counts for the names of the columns alone. The program must write without delay: what
    comes late is taken for a later force. Raise `HardwareError` if it can't be read.
    """
    try:
        file = as_path(path).open(encoding="utf-8-sig", errors="replace", newline="")
    except OSError as error:
        raise HardwareError(
            f"{path}: cannot be read ({error.strerror}); have the sensor's program write there first"
        ) from None
    sensor = TextSensor(str(path), file.read, file.close)
    try:
        sensor.take()
    except HardwareError:
        sensor.close()
        raise
    return sensor


def connect_sensor(url: str) -> TextSensor:
    """Connect to a sensor that sends a line of 3 or 6 numbers for each sample; `SCHEMES`, host and port.

    Raise `LinkError` if no sensor answers, nothing comes, or it is no address; later, if the sensor has gone.
    """
    host, colon, port = url.partition("://")[2].rpartition(":")
    if not (colon and host and port.isdecimal()):
        raise LinkError(f"{url} is no address of a sensor; write it like socket://192.168.1.20:5005")
    try:
        connection = socket.create_connection((host, int(port)), TIMEOUT_S)
    except (OSError, OverflowError) as error:
        raise LinkError(f"{url}: no force sensor there ({error}); is it on?") from None
    connection.setblocking(False)

    def receive() -> str:
        pieces: list[bytes] = []
        while True:
            try:
                pieces.append(connection.recv(CHUNK_BYTES))
            except BlockingIOError:
                return b"".join(pieces).decode("ascii", "replace")
            except OSError as error:
                raise LinkError(f"{url}: the force sensor has gone ({error})") from None
            if not pieces[-1]:
                raise LinkError(f"{url}: the force sensor has hung up")

    sensor = TextSensor(url, receive, connection.close)
    end = time.perf_counter() + TIMEOUT_S
    try:
        while not len(sensor.take()):
            if time.perf_counter() > end:
                raise LinkError(f"{url}: the force sensor shows nothing; does it send by itself?")
            time.sleep(POLL_S)
    except HardwareError:
        sensor.close()
        raise
    return sensor


def open_sensor(where: str) -> TextSensor:
    """Open the sensor at a URL, or that writes a file; errors as those of `follow_file` and `connect_sensor`."""
    return connect_sensor(where) if where.startswith(SCHEMES) else follow_file(where)
