"""Force sensors: their interface, their lines of text, sensors behind a file or a TCP port, and simulated ones.

Lines are ATI's CSV, other tables, or bare numbers. ATI's demo programs write a start time, the sample rate, units
and counts per unit, each in a line of its own, then a line that names the columns (``Fx``, ``Fy``, ``Fz`` among
them) and then counts; cells may be in quotes. See "Demo CSV File Format" in ATI's manuals 9620-05 (Network
Force/Torque Sensor System) and 9610-05 (Ethernet Axia). Other tables only need that line of names, in N. Without
one, each line holds 3 or 6 numbers, forces first, in N. Lines that begin with # are comments.
"""

from __future__ import annotations

import csv
import math
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from tensionlab.demand import Pose
from tensionlab.errors import HardwareError, LinkError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.settings import WorldClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import DRIVER_ON, STEP_S, TENSION
from tensionlab.hardware.simulation.world import Motion, World
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import as_path, brief
from tensionlab.validation.error_model import RigErrors, require_point, true_plants, true_rig

# From the sensor's axes, Z up, to the devices', Y up: a turn by -90 degrees about X.
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
SAMPLE_RATE_HZ = 1000
STEPS_PER_SAMPLE = round(1.0 / SAMPLE_RATE_HZ / STEP_S)  # steps of the firmware
CORRELATION_TIME_S = 1.0  # of the simulated drift
FORCE_COLUMNS = ("fx", "fy", "fz")
UNITS_N = {"n": 1.0, "newton": 1.0, "kn": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
SCHEMES = ("socket://", "tcp://")
SIMULATED_LINE = "# sensor of `tensionlab simulate`, held on request\n"  # what that sends first
CHUNK_BYTES = 1 << 20
TIMEOUT_S, POLL_S = 5.0, 0.01  # limit of the connection and of the first numbers, and the time between polls


class ForceSensor(Protocol):
    """Force sensor that the cables pull on, and that measures by itself."""

    @property
    def simulated(self) -> bool:
        """Whether the sensor is simulated."""

    def take(self) -> Floats:
        """Return the forces since the last call, (K, 3) in N, in the sensor's own axes, Z up."""

    def close(self) -> None:
        """Close the sensor."""


class ForceParser:
    """Parser of lines with forces, fed in pieces of any size.

    ``source`` names them in messages. A line that is not a force raises `HardwareError`.
    """

    def __init__(self, source: str) -> None:
        self._source, self._rest = source, ""
        self.simulated = False  # whether the lines say so
        self._line = 0
        self._columns: list[int] | None = None
        self._unit, self._counts = 1.0, 1.0

    def feed(self, text: str) -> Floats:
        """Return the forces of the lines that are complete now, (K, 3) in N."""
        *lines, self._rest = (self._rest + text).split("\n")
        forces = [force for line in lines if (force := self._parse(line)) is not None]
        return np.array(forces).reshape(-1, 3)

    def _parse(self, line: str) -> list[float] | None:
        self._line += 1
        try:
            cells = next(csv.reader([line.strip("\r\ufeff")]), [])
        except csv.Error as problem:
            raise self._error(str(problem)) from None
        cells = [cell.strip() for cell in cells] if len(cells) > 1 else line.replace(";", " ").split()
        if not any(cells) or cells[0].startswith("#"):
            self.simulated |= line.strip() == SIMULATED_LINE.strip()
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
        """Keep units and counts that ATI writes before the columns' names; return whether this is such a line."""
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
    """Sensor that writes or sends lines of forces, read without waiting; ``source`` is its name in messages."""

    def __init__(self, source: str, read: Callable[[], str], close: Callable[[], None]) -> None:
        self._parser, self._read, self.close = ForceParser(source), read, close
        self.send: Callable[[bytes], object] = len  # takes requests to a simulated sensor

    @property
    def simulated(self) -> bool:
        """Whether the sensor says that it is simulated."""
        return self._parser.simulated

    def take(self) -> Floats:
        """Return the forces since the last call."""
        return self._parser.feed(self._read())


def open_sensor(where: str | Path) -> TextSensor:
    """Open the sensor that sends to a URL (`connect_sensor`), or writes to a file (`follow_file`)."""
    url = str(where)
    sensor = connect_sensor(url) if url.startswith(SCHEMES) else follow_file(where)
    end = time.perf_counter() + TIMEOUT_S
    try:
        while not len(sensor.take()) and url.startswith(SCHEMES):
            if time.perf_counter() > end:
                raise LinkError(f"{url}: the force sensor shows nothing; does it send by itself?")
            time.sleep(POLL_S)
    except HardwareError:
        sensor.close()
        raise
    return sensor


def follow_file(path: str | Path) -> TextSensor:
    """Return a sensor whose own program writes a file during the validation, such as ATI's CSV.

    Of its earlier content, only the names of columns and units count. The program must write without delay: late
    lines are taken for a later force. Raise `HardwareError` if it can't be read.
    """
    try:
        file = as_path(path).open(encoding="utf-8-sig", errors="replace", newline="")
    except OSError as error:
        advice = "start the sensor's program first"
        raise HardwareError(f"{path}: cannot be read ({error.strerror}); {advice}") from None
    return TextSensor(str(path), file.read, file.close)


def connect_sensor(url: str) -> TextSensor:
    """Connect to a sensor that sends a line of 3 or 6 numbers for each sample; `SCHEMES`, host and port.

    Raise `LinkError` if that is not an address, or nothing answers there; later, if the connection ends.
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
    sensor.send = connection.sendall
    return sensor


class DriftNoise:
    """Slow noise of three axes: an Ornstein-Uhlenbeck process for each, sample by sample.

    ``deviation`` is its standard deviation in N; the same ``seed`` gives the same samples, in pieces of any size.
    """

    def __init__(self, deviation: float, seed: int) -> None:
        self._random = np.random.default_rng([seed, 1])
        self._decay = float(np.exp(-1.0 / (SAMPLE_RATE_HZ * CORRELATION_TIME_S)))
        self._kick = deviation * np.sqrt(1.0 - self._decay**2)
        self._state: Floats = self._decay * deviation * self._random.standard_normal((1, 3))

    def take(self, count: int) -> Floats:
        """Return the next samples, (count, 3) in N."""
        from scipy.signal import lfilter

        kicks: Floats = self._kick * self._random.standard_normal((count, 3))
        if not count:
            return kicks
        values, self._state = lfilter([1.0], [1.0, -self._decay], kicks, axis=0, zi=self._state)
        return np.asarray(values)


class SimulatedSensor:
    """Sensor on the point of a simulated rig, at the pose that ``pose`` returns.

    The rig is the true one; the seed is that of the noise.
    """

    simulated = True

    def __init__(self, rig: Rig, errors: RigErrors, pose: Callable[[], Pose], seed: int = 0) -> None:
        self._rig, self._pose, self._rotation = rig, pose, UPRIGHT.T @ errors.tilt
        self._biases, self._noise = errors.biases, DriftNoise(errors.noise, seed)
        self._steps = 0
        self._kept: list[tuple[Floats, list[Floats]]] = []  # position, and samples (K, 13) of each module there

    def watch(self, samples: Sequence[Floats]) -> None:
        """Sample the steps of the modules, once each ms; what `World.watch` calls."""
        first = -self._steps % STEPS_PER_SAMPLE
        self._steps += len(samples[0])
        self._kept.append((self._pose().position, [series[first::STEPS_PER_SAMPLE] for series in samples]))

    def take(self) -> Floats:
        """Return the forces since the last call."""
        kept, self._kept = self._kept, []
        if not kept:
            return np.empty((0, 3))
        pulls = self._rig.structure_matrix(np.array([place for place, _ in kept]), frames=self._rig.at_rest)
        counts = [len(samples[0]) for _, samples in kept]
        steps = np.stack(
            [np.concatenate(parts) for parts in zip(*(samples for _, samples in kept), strict=True)], -1
        )
        tensions = np.maximum(steps[:, TENSION] + steps[:, DRIVER_ON] * self._biases, 0.0)
        forces = np.einsum("kdm,km->kd", np.repeat(self._rotation @ pulls, counts, axis=0), tensions)
        return np.asarray(forces + self._noise.take(len(forces)))

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


def simulated_setup(
    rig: Rig,
    errors: RigErrors,
    seed: int = 0,
    motion: Motion | None = None,
    plants: Mapping[str, Mapping[str, float]] | None = None,
    conditions: Conditions | None = None,
) -> tuple[ModuleGroup, WorldClock, SimulatedSensor]:
    """Return simulated modules, their clock and a sensor, in lockstep, where the errors put them.

    The sensor stays at the rig's home, or follows a motion; ``plants`` are the hardware parameters by module, of
    which those of `true_plants` if left out, and ``conditions`` are those of the links.
    """
    require_point(rig)
    real = true_rig(rig, errors)
    world = World(real, motion, seed, plants=true_plants(rig, errors) if plants is None else plants)
    sensor = SimulatedSensor(real, errors, lambda: world.pose, seed)
    world.watch = sensor.watch
    return world.group(conditions, seed), WorldClock(world), sensor
