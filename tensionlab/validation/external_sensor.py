"""Force sensors elsewhere: in a file that another program goes on writing, or behind a TCP port."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError, LinkError
from tensionlab.validation.readings import Readings
from tensionlab.validation.sensor import ForceSensor

SCHEMES = ("socket://", "tcp://")
CHUNK = 1 << 20
"""Bytes taken at a time."""
PATIENCE, PAUSE = 5.0, 0.01
"""How long a connection and the first numbers may take, and how long to wait before looking again, in s."""


class FollowedFile:
    """A file that the sensor's own program writes on while the validation runs, such as ATI's CSV.

    What was in it before counts for the names of the columns alone. The program must write without delay: what
    comes late is taken for a later force.

    Raises
    ------
    HardwareError
        If the file can't be read.
    """

    def __init__(self, path: str | Path) -> None:
        self._readings = Readings(str(path))
        try:
            self._file = Path(path).open(encoding="utf-8-sig", newline="")  # noqa: SIM115 - closed by close()
        except OSError as error:
            raise HardwareError(
                f"{path}: cannot be read ({error.strerror}); have the sensor's program write there first"
            ) from None
        self.take()

    @property
    def simulated(self) -> bool:
        """Whether it says so of itself."""
        return self._readings.simulated

    def take(self) -> Floats:
        """What came since the last call?"""
        return self._readings.feed(self._file.read())

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()


class NetworkSensor:
    """A sensor that sends a line of 3 or 6 numbers for each sample to whoever connects; `SCHEMES`, host and port.

    Raises
    ------
    LinkError
        If nobody is there, or nothing comes, or it is no address.
    """

    def __init__(self, url: str) -> None:
        host, colon, port = url.partition("://")[2].rpartition(":")
        if not (colon and host and port.isdecimal()):
            raise LinkError(f"{url} is no address of a sensor; write it like socket://192.168.1.20:5005")
        self._url, self._readings = url, Readings(url)
        try:
            self._socket = socket.create_connection((host, int(port)), PATIENCE)
        except (OSError, OverflowError) as error:
            raise LinkError(f"{url}: no force sensor there ({error}); is it on?") from None
        self._socket.setblocking(False)
        end = time.monotonic() + PATIENCE
        while not len(self.take()):
            if time.monotonic() > end:
                self.close()
                raise LinkError(f"{url}: the force sensor shows nothing; does it send by itself?")
            time.sleep(PAUSE)

    @property
    def simulated(self) -> bool:
        """Whether it says so of itself."""
        return self._readings.simulated

    def take(self) -> Floats:
        """What came since the last call? A `LinkError` if the sensor has gone."""
        pieces = [np.empty((0, 3))]
        while True:
            try:
                content = self._socket.recv(CHUNK)
            except BlockingIOError:
                return np.concatenate(pieces)
            except OSError as error:
                raise LinkError(f"{self._url}: the force sensor has gone ({error})") from None
            if not content:
                raise LinkError(f"{self._url}: the force sensor has hung up")
            pieces.append(self._readings.feed(content.decode("ascii", "replace")))

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def open_sensor(where: str) -> ForceSensor:
    """Which sensor is at a URL, or writes a file? Errors as those of `FollowedFile` and `NetworkSensor`."""
    return NetworkSensor(where) if where.startswith(SCHEMES) else FollowedFile(where)
