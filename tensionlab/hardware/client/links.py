"""Links to modules: serial ports, Bluetooth, TCP, and simulated modules, behind one interface.

Each link has its own clock. That of a simulated module advances only while somebody waits for it.
"""

from __future__ import annotations

import re
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from tensionlab.errors import LinkError, needs
from tensionlab.hardware.client.locks import LinkLock

READ_BYTES = 4096
"""Most bytes read at a time."""
BAUD_RATE = 921_600
"""Bits a second over USB; Bluetooth and TCP ignore it."""
CONNECT_TIMEOUT_S = 10.0
OPENERS: dict[str, Callable[[], Link]] = {}
"""Links that are neither ports nor sockets, by URL; `tensionlab.hardware` adds ``sim:``."""
URL_KINDS = """
  bt://AA:BB:CC:DD:EE:FF/1   Bluetooth, by address and channel
  /dev/ttyUSB0, COM5         a serial port
  socket://host:port         TCP, as `tensionlab simulate` serves
  sim:                       a simulated module in this process""".lstrip("\n")
URL_PATTERN = re.compile(r"sim:|bt://.+|/dev/.+|socket://.+:\d+/?|(?i:COM)\d+")


@dataclass(frozen=True)
class SerialPort:
    """Serial port, as the system describes it; `vendor` is the number of the USB chip's maker.

    `hardware` is such as ``USB VID:PID=10C4:EA60 ...``, or ``BTHENUM...`` for Bluetooth on Windows.
    """

    url: str
    about: str
    hardware: str
    vendor: int | None


class Link(Protocol):
    """Link to one module. If it is in `lockstep`, time passes only while somebody waits: no thread may read it."""

    url: str
    lockstep: bool

    def send(self, content: bytes) -> None:
        """Send bytes; raise a `LinkError` if the link is broken."""

    def receive(self, timeout: float) -> bytes:
        """Return received bytes, or none after so many s; raise a `LinkError` if the link is broken."""

    def clock(self) -> float:
        """Return the time by which timeouts count, in s."""

    def close(self) -> None:
        """Close the link; a closed link may be closed again."""


def serial_ports() -> list[SerialPort]:
    """Return the serial ports of this computer, by USB or Bluetooth, free or not."""
    with needs("hardware", "finding serial ports"):
        from serial.tools import list_ports
    return [
        SerialPort(port.device, "" if port.description == "n/a" else port.description, port.hwid, port.vid)
        for port in sorted(list_ports.comports())
    ]


def require_known(url: str) -> None:
    """Raise a `LinkError` for a URL of no known kind."""
    if not URL_PATTERN.fullmatch(url):
        raise LinkError(f"{url!r} is no link to a module; give one of these:\n{URL_KINDS}")


def open_link(url: str) -> Link:
    """Open the link of a URL, of a kind in `URL_KINDS`.

    A `LinkError` if it is of no known kind, nothing answers there, or the module is in use.
    """
    require_known(url)
    if url in OPENERS:
        return OPENERS[url]()
    kind = BluetoothLink if url.startswith("bt://") else SerialLink
    lock = LinkLock(url)
    try:
        return kind(url, lock)
    except BaseException:
        lock.release()
        raise


class SerialLink:
    """Link over a serial port or TCP, through pyserial; closing it releases the lock."""

    lockstep = False

    def __init__(self, url: str, lock: LinkLock) -> None:
        with needs("hardware", "a link"):
            import serial
        self.url, self._lock = url, lock
        # The errors of a port that is closed while another thread reads it are not pyserial's own.
        self._broken = (serial.SerialException, TypeError, AttributeError)
        try:
            # Only system ports can be opened exclusively; a TCP port refuses by itself.
            taken = {} if url.startswith("socket://") else {"exclusive": True}
            self._port: Any = serial.serial_for_url(
                url, BAUD_RATE, timeout=0, write_timeout=0, do_not_open=True, **taken
            )
            self._port.dtr = self._port.rts = False  # they reset most boards
            self._port.open()
        except (serial.SerialException, ValueError) as error:
            raise LinkError(
                f"{url} cannot be opened: {error}; is it there, and is no other program using it?"
            ) from None

    def send(self, content: bytes) -> None:
        """Send bytes without waiting."""
        try:
            taken = self._port.write(content)
        except (*self._broken, OSError) as error:
            raise LinkError(f"{self.url} broke: {error}") from None
        if taken != len(content):
            raise LinkError(f"{self.url} takes no more bytes; does the module still read?")

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes."""
        try:
            self._wait(timeout)
            return bytes(self._port.read(READ_BYTES))
        except (*self._broken, OSError, ValueError) as error:
            raise LinkError(f"{self.url} broke: {error}") from None

    def _wait(self, timeout: float) -> None:
        """Wait until there is something to read: pyserial's own waiting configures the port anew each time."""
        if hasattr(self._port, "fileno"):
            select.select([self._port.fileno()], [], [], timeout)
            return
        end = time.monotonic() + timeout
        while not self._port.in_waiting and time.monotonic() < end:  # Windows cannot wait for a port's file
            time.sleep(1e-3)

    def clock(self) -> float:
        """Return the time, in s."""
        return time.monotonic()

    def close(self) -> None:
        """Close the port."""
        inner = getattr(self._port, "_socket", None)
        self._port.close()
        if inner is not None:
            inner.close()  # which pyserial forgets if the far end has gone
        self._lock.release()


class BluetoothLink:
    """Link over Bluetooth Classic, an RFCOMM socket; closing it releases the lock."""

    lockstep = False

    def __init__(self, url: str, lock: LinkLock) -> None:
        self.url, self._lock = url, lock
        match = re.fullmatch(r"bt://((?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2})(?:/(\d+))?", url)
        if match is None:
            raise LinkError(f"{url}: give an address and a channel, such as bt://AA:BB:CC:DD:EE:FF/1")
        family, protocol = getattr(socket, "AF_BLUETOOTH", None), getattr(socket, "BTPROTO_RFCOMM", None)
        if family is None or protocol is None:
            raise LinkError(
                f"{url}: this Python was built without Bluetooth sockets. On Linux, bind the module to a port "
                f"(sudo rfcomm bind 0 {match[1]} {match[2] or 1}) and use /dev/rfcomm0; on macOS, pair it and use "
                "/dev/cu.tensionlab-…; on Windows, pair it and use its COM port"
            )
        self._socket = socket.socket(family, socket.SOCK_STREAM, protocol)
        self._socket.settimeout(CONNECT_TIMEOUT_S)
        try:
            self._socket.connect((match[1], int(match[2] or 1)))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{url} cannot be reached: {error}; is the module on, paired, and in range?") from None

    def send(self, content: bytes) -> None:
        """Send bytes."""
        try:
            self._socket.sendall(content)
        except OSError as error:
            raise LinkError(f"{self.url} broke: {error}") from None

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes."""
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return b""
            content = self._socket.recv(READ_BYTES)
        except (OSError, ValueError) as error:  # a socket closed while it is waited for is a ValueError
            raise LinkError(f"{self.url} broke: {error}") from None
        if not content:
            raise LinkError(f"{self.url} was closed by the module")
        return content

    def clock(self) -> float:
        """Return the time, in s."""
        return time.monotonic()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
        self._lock.release()
