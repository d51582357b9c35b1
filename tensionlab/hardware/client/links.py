"""Links to modules (serial ports, Bluetooth, TCP, simulated modules), their reader, and the file that names them.

Each link has its own clock. That of a simulated module advances only while its link is read. One thread reads all
links with a file descriptor: telemetry is decoded natively, without holding the GIL, into the modules' endpoints.
"""

from __future__ import annotations

import atexit
import io
import os
import re
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from tensionlab import _native
from tensionlab.errors import HardwareError, LinkError, optional_import
from tensionlab.hardware.client.locks import LinkLock, tcp_address
from tensionlab.support.files.reading import MAX_NAME, brief, read_toml

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo

READ_BYTES = 4096  # read at a time
BAUD_RATE = 921_600  # bits a second over USB; Bluetooth and TCP ignore it
CONNECT_TIMEOUT_S = 10.0
OPENERS: dict[str, Callable[[], Link]] = {}  # of other links, by URL; `tensionlab.hardware` adds `sim:`
URL_KINDS = """
  bt://AA:BB:CC:DD:EE:FF/1   Bluetooth, by address and channel
  /dev/ttyUSB0, COM5         a serial port
  socket://host:port         TCP, as `tensionlab simulate` serves
  sim:                       a simulated module in this process""".lstrip("\n")
URL_PATTERN = re.compile(r"sim:|bt://.+|/dev/.+|socket://.+:\d+/?|(?i:COM)\d+")


class Link(Protocol):
    """Link to one module, by its URL."""

    url: str
    lockstep: bool  # whether its time passes only in `receive`, so that no thread may read it
    file: int | None  # descriptor whose bytes are read and written natively, if there is one

    def send(self, content: bytes) -> None:
        """Send bytes; raise a `LinkError` if the link is broken."""

    def receive(self, timeout: float) -> bytes:
        """Return received bytes, or b"" after `timeout` s; raise a `LinkError` if the link is broken."""

    def clock(self) -> float:
        """Return the time by which timeouts count, in s."""

    def close(self) -> None:
        """Close the link; a closed link may be closed again."""


def serial_ports() -> list[ListPortInfo]:
    """Return the serial ports of this computer (USB and Bluetooth), free or not, in order."""
    with optional_import("hardware", "finding serial ports"):
        from serial.tools import list_ports
    return sorted(list_ports.comports())


def has_bluetooth(port: ListPortInfo) -> bool:
    """Return whether a port is one of Bluetooth, as far as the system tells."""
    return "/dev/rfcomm" in port.device or port.hwid.startswith("BTHENUM")


def require_known(url: str) -> None:
    """Raise a `LinkError` for a URL of no known kind."""
    if not URL_PATTERN.fullmatch(url):
        raise LinkError(f"{url!r} is no link to a module; give one of these:\n{URL_KINDS}")


def open_link(url: str, module: str = "", *, locked: bool = True) -> Link:
    """Open the link of a URL, of a kind in `URL_KINDS`, for this process alone unless ``locked`` is False.

    ``module`` is a name for other processes to read. A `LinkError` if the URL is of no known kind, nothing answers
    there, or the module is in use.
    """
    require_known(url)
    if url in OPENERS:
        return OPENERS[url]()
    lock = LinkLock(url, module) if locked else None
    try:
        return connect(url, lock)
    except BaseException:
        if lock is not None:
            lock.release()
        raise


def connect(url: str, lock: LinkLock | None = None) -> Link:
    """Connect to a port or a socket that is locked, if at all; errors as those of `open_link`."""
    if url.startswith("/dev/") or url.upper().startswith("COM"):
        return SerialLink(url, lock)
    return SocketLink(url, (_connect_bluetooth if url.startswith("bt://") else _connect_tcp)(url), lock)


class SerialLink:
    """Link over a serial port, through pyserial; closing it releases the lock."""

    lockstep = False
    clock = staticmethod(time.perf_counter)

    def __init__(self, url: str, lock: LinkLock | None = None) -> None:
        with optional_import("hardware", "a serial port"):
            import serial
        self.url, self._lock = url, lock
        # The errors of a port that is closed while another thread reads it are not pyserial's own.
        self._broken = (serial.SerialException, TypeError, AttributeError, OSError, ValueError)
        try:
            self._port: Any = serial.serial_for_url(
                url, BAUD_RATE, timeout=0, write_timeout=0, do_not_open=True, exclusive=True
            )
            self._port.dtr = self._port.rts = False  # they reset most boards
            self._port.open()
        except (serial.SerialException, ValueError) as error:
            number = getattr(error, "errno", None)
            why = os.strerror(number) if number else error
            raise LinkError(f"{url} cannot be opened: {why}; is it there, and not in use?") from None
        try:
            self.file: int | None = self._port.fileno()
        except io.UnsupportedOperation:  # which every port has on Windows
            self.file = None

    def send(self, content: bytes) -> None:
        """Send bytes without waiting."""
        try:
            taken = self._port.write(content)
        except self._broken as error:
            raise LinkError(f"{self.url} broke: {error}") from None
        if taken != len(content):  # later bytes would be out of step
            raise not_taken(self.url, 0)

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes."""
        try:
            if self.file is None:
                return self._read(timeout)
            if timeout > 0.0:  # pyserial's own waiting configures the port each time
                select.select([self.file], [], [], timeout)
            return bytes(self._port.read(READ_BYTES))
        except self._broken as error:
            raise LinkError(f"{self.url} broke: {error}") from None

    def _read(self, timeout: float) -> bytes:
        """Wait for bytes in pyserial, without a file descriptor."""
        if self._port.timeout != timeout:  # setting it configures the port anew
            self._port.timeout = timeout
        first = self._port.read(1)
        return bytes(first + self._port.read(min(self._port.in_waiting, READ_BYTES - 1)) if first else b"")

    def close(self) -> None:
        """Close the port."""
        self._port.close()
        if self._lock is not None:
            self._lock.release()


class SocketLink:
    """Link over a connected socket, TCP or Bluetooth; closing it releases the lock."""

    lockstep = False
    clock = staticmethod(time.perf_counter)

    def __init__(self, url: str, connected: socket.socket, lock: LinkLock | None = None) -> None:
        self.url, self._lock, self._socket = url, lock, connected
        self.file: int | None = connected.fileno()
        connected.setblocking(False)

    def send(self, content: bytes) -> None:
        """Send bytes without waiting."""
        try:
            taken = self._socket.send(content)
        except BlockingIOError:
            taken = 0
        except OSError as error:
            raise LinkError(f"{self.url} broke: {error.strerror or error}") from None
        if taken != len(content):  # later bytes would be out of step
            raise not_taken(self.url, 0)

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes."""
        try:
            if timeout > 0.0 and not select.select([self._socket], [], [], timeout)[0]:
                return b""
            content = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:  # a socket closed while it is waited for is a ValueError
            raise LinkError(f"{self.url} broke: {getattr(error, 'strerror', None) or error}") from None
        if not content:
            raise LinkError(f"{self.url} was closed by the module: has it another client, or ended?")
        return content

    def close(self) -> None:
        """Close the socket; the module notices at once, even while another thread waits for bytes."""
        with suppress(OSError):  # of a closed socket
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        if self._lock is not None:
            self._lock.release()


def not_taken(url: str, error: int) -> LinkError:
    """Return the error of a link that did not take bytes; `error` is the system's, or 0 if it took a part."""
    why = f"broke: {os.strerror(error)}" if error else "takes no more bytes; does the module still read?"
    return LinkError(f"{url} {why}")


def _connect_tcp(url: str) -> socket.socket:
    try:
        connected = socket.create_connection(tcp_address(url), CONNECT_TIMEOUT_S)
    except (OSError, UnicodeError) as error:  # UnicodeError: an impossible host name
        why = getattr(error, "strerror", None) or error
        raise LinkError(f"{url} cannot be opened: {why}; is it served there, and in reach?") from None
    with suppress(OSError):  # of a connection that has ended again, as reading will find
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connected


def _connect_bluetooth(url: str) -> socket.socket:
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
    connected = socket.socket(family, socket.SOCK_STREAM, protocol)
    connected.settimeout(CONNECT_TIMEOUT_S)
    try:
        connected.connect((match[1], int(match[2] or 1)))
    except OSError as error:
        connected.close()
        raise LinkError(f"{url} cannot be reached: {error}; is the module on, paired, and in range?") from None
    return connected


REMOVAL_TIMEOUT_S = 1.0  # longest wait for the thread as a link is closed

_starting = threading.Lock()
_readers: dict[int, LinkReader] = {}  # by process number: a fork inherits the object without its thread


def link_reader() -> LinkReader:
    """Return the reader of this process, started at the first call."""
    with _starting:
        if os.getpid() not in _readers:
            _readers[os.getpid()] = LinkReader()
        return _readers[os.getpid()]


@atexit.register
def _end() -> None:
    """End the thread of this process: the interpreter must not end during a native call."""
    if (reader := _readers.pop(os.getpid(), None)) is not None:
        reader.end()


class LinkReader:
    """Thread that waits for bytes of all links, and reads each link as they come."""

    def __init__(self) -> None:
        self._native = _native.LinkReader()
        # By file descriptor; endpoints live as long as they are read.
        self._links: dict[int, tuple[Callable[[], bool], _native.Endpoint | None]] = {}
        self._changes: deque[Callable[[], None]] = deque()
        self._ended = False
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        woken.setblocking(False)

        def wake() -> bool:
            with suppress(BlockingIOError):
                woken.recv(4096)
            while self._changes:
                self._changes.popleft()()
            return True

        self._add(woken.fileno(), wake, None)
        self._thread = threading.Thread(target=self._run, name="reader of all links", daemon=True)
        self._thread.start()

    def add(self, file: int, read: Callable[[], bool], endpoint: _native.Endpoint | None = None) -> None:
        """Feed bytes from a file descriptor to an endpoint, until `read` returns False.

        `read` is called when the endpoint has messages for Python, and when the link is broken or at its end;
        without an endpoint, whenever there are bytes.
        """
        self._change(lambda: self._add(file, read, endpoint))

    def remove(self, file: int, read: Callable[[], bool]) -> None:
        """Stop reading a file before this returns."""

        def change() -> None:
            self._drop(file, read)
            done.set()

        done = threading.Event()
        if threading.current_thread() is self._thread or self._ended:
            change()
        else:
            self._change(change)
            done.wait(REMOVAL_TIMEOUT_S)

    def end(self) -> None:
        """Stop reading all links, and end the thread."""
        self._change(lambda: setattr(self, "_ended", True))
        self._thread.join(REMOVAL_TIMEOUT_S)

    def _change(self, change: Callable[[], None]) -> None:
        self._changes.append(change)
        with suppress(BlockingIOError):  # woken already
            self._waker.send(b"\1")

    def _add(self, file: int, read: Callable[[], bool], endpoint: _native.Endpoint | None) -> None:
        self._links[file] = read, endpoint
        self._native.add(file, endpoint)  # in place of one that was closed elsewhere

    def _drop(self, file: int, read: Callable[[], bool]) -> None:
        """Stop reading a file, unless another link has its number now."""
        if self._links.get(file, (None, None))[0] == read:
            self._native.drop(file)
            del self._links[file]

    def _run(self) -> None:
        while not self._ended:
            for file in self._native.wait():
                read, _ = self._links.get(file, (None, None))
                if read is None:  # a change has just dropped it
                    continue
                again = False
                try:
                    again = read()
                except BaseException as error:  # which ends the reading of this link only
                    threading.excepthook(
                        threading.ExceptHookArgs((type(error), error, error.__traceback__, self._thread))
                    )
                if not again:
                    self._drop(file, read)


def modules_to_toml(links: Mapping[str, str]) -> str:
    """Return the text of a modules file."""
    import tomli_w

    return tomli_w.dumps({"modules": dict(links)})


def load_modules(path: str | Path) -> dict[str, str]:
    """Return the link of each module by its name, from a modules file.

    ``tensionlab simulate`` prints such a file (TOML)::

        [modules]
        floor-1 = "socket://127.0.0.1:40001"         # a simulated module, over TCP
        floor-2 = "/dev/rfcomm0"                      # Bluetooth, bound on Linux
        top     = "/dev/cu.tensionlab-1a2b3c4d"       # Bluetooth on macOS; "COM5" on Windows

    Names are those of the rig's modules. A `HardwareError` names what is wrong in the file at ``path``.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensionlab.hardware import load_modules
    >>> _ = Path("modules.toml").write_text('modules = {left = "socket://127.0.0.1:7000"}')
    >>> load_modules("modules.toml")
    {'left': 'socket://127.0.0.1:7000'}
    """
    document = read_toml(path, "a modules file (*.toml)", HardwareError)
    links = document.get("modules")
    if not isinstance(links, dict) or not links or len(document) > 1:
        raise HardwareError(f'{path}: give one table, [modules], with lines such as name = "/dev/rfcomm0"')
    for name, link in links.items():
        problem = ""
        if not name.isprintable() or not 0 < len(name) <= MAX_NAME:
            problem = f"a name is {brief(name)}; give 1 to {MAX_NAME} printable characters"
        elif not isinstance(link, str) or not link:
            problem = f'"{name}" is {brief(link)}; give a link as text, as "COM5"'
        elif list(links.values()).count(link) > 1:
            problem = f"{link:.60} is there twice; give each its own"
        if problem:
            raise HardwareError(f"{path}: modules: {problem}")
    return dict(links)
