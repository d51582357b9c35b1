"""Where a simulated module can be reached: a TCP port or a pseudo-terminal, by one client at a time."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
from typing import Protocol

from tensionlab.errors import HardwareError

CHUNK = 65536
"""Bytes taken at a time."""


class Port(Protocol):
    """One client, or none. `url` is what pyserial's ``serial_for_url`` opens."""

    url: str

    def files(self) -> list[int]:
        """Which file descriptors to wait for?"""

    def connected(self) -> bool:
        """Whether a client is there."""

    def receive(self) -> bytes | None:
        """What came since the last call? None if the client has gone since then."""

    def send(self, content: bytes) -> None:
        """Send what the client has room for; as over Bluetooth, the rest is lost."""

    def close(self) -> None:
        """Let go of the client and the port."""


class TcpPort:
    """A port of this machine. A second client is refused: its connection is closed at once.

    Parameters
    ----------
    host : str
        Address to listen at: 127.0.0.1 for this machine only, 0.0.0.0 for all that can reach it.
    port : int
        0 takes one that is free; `url` tells which.

    Raises
    ------
    HardwareError
        If the port is taken, or the host is not one of this machine.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        if not 0 <= port <= 65535:
            raise HardwareError(f"a port is from 0 to 65535; got {port}")
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise HardwareError(f"cannot listen at {host}, port {port}: {error.strerror}") from None
        self._listener.setblocking(False)
        self._client: socket.socket | None = None
        self.url = f"socket://{host}:{self._listener.getsockname()[1]}"

    def files(self) -> list[int]:
        """Which file descriptors to wait for?"""
        return [each.fileno() for each in (self._listener, self._client) if each is not None]

    def connected(self) -> bool:
        """Whether a client is there."""
        return self._client is not None

    def receive(self) -> bytes | None:
        """What came since the last call? None if the client has gone since then."""
        content = self._read()
        if content is None:
            self._hang_up()
        self._accept()
        return content

    def send(self, content: bytes) -> None:
        """Send what the client has room for; as over Bluetooth, the rest is lost."""
        if self._client is not None:
            with contextlib.suppress(OSError):  # full, or about to be found gone
                self._client.send(content)

    def close(self) -> None:
        """Let go of the client and the port."""
        self._hang_up()
        self._listener.close()

    def _read(self) -> bytes | None:
        if self._client is None:
            return b""
        try:
            return self._client.recv(CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            client, _ = self._listener.accept()
            if self._client is not None:
                client.close()
                return
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


class PtyPort:
    """A pseudo-terminal, as a serial port would be; `url` is its path. Whoever opens it is the client.

    Raises
    ------
    HardwareError
        Where there are none.
    """

    def __init__(self) -> None:
        if sys.platform == "win32":
            raise HardwareError("Windows has no pseudo-terminals; serve over TCP instead")
        import tty

        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.url = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._open = False

    def files(self) -> list[int]:
        """Which file descriptors to wait for? None while nobody has it open: it would always be ready."""
        return [self._master] if self._open else []

    def connected(self) -> bool:
        """Whether somebody has it open."""
        return self._open

    def receive(self) -> bytes | None:
        """What came since the last call? None if the client has gone since then."""
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        events = dict(poll.poll(0)).get(self._master, 0)
        was_open, self._open = self._open, not events & select.POLLHUP
        if events & select.POLLIN:
            self._open = True  # until all of it is read
            return os.read(self._master, CHUNK)
        return None if was_open and not self._open else b""

    def send(self, content: bytes) -> None:
        """Send what the client has room for; as over Bluetooth, the rest is lost."""
        if self._open:
            with contextlib.suppress(OSError):  # full, or about to be found gone
                os.write(self._master, content)

    def close(self) -> None:
        """Let go of the terminal."""
        os.close(self._master)
