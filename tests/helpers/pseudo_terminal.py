"""Pseudo-terminal at which a simulated module is served, as a serial port would be."""

import os
import select
import tty
from contextlib import suppress

READ_BYTES = 65536


class PseudoTerminalPort:
    """Port of a simulated module. `url` is its path; the process that opens it is the client."""

    def __init__(self) -> None:
        self._terminal, other = os.openpty()
        tty.setraw(other)
        self.url = os.ttyname(other)
        os.close(other)
        os.set_blocking(self._terminal, False)
        self._open = False

    def files(self) -> list[int]:
        """Return the file descriptors to wait for; none while it is not open: it would always be ready."""
        return [self._terminal] if self._open else []

    def connected(self) -> bool:
        return self._open

    def receive(self) -> bytes | None:
        was_open = self._open
        poll = select.poll()
        poll.register(self._terminal, select.POLLIN)
        events = dict(poll.poll(0)).get(self._terminal, 0)
        self._open = not events & select.POLLHUP
        if events & select.POLLIN:
            self._open = True  # until all of it is read
            return os.read(self._terminal, READ_BYTES)
        return None if was_open and not self._open else b""

    def send(self, content: bytes) -> None:
        if self._open:
            with suppress(OSError):  # full, or about to be found gone
                os.write(self._terminal, content)

    def close(self) -> None:
        os.close(self._terminal)
