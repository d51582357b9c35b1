"""Link over a socket pair whose time passes only where nothing comes, for the tests."""

from __future__ import annotations

import socket
from contextlib import suppress

from tensionlab.errors import LinkError


class PairedLink:
    """One end of a socket pair; `far` is the other, and `heard` what came out there."""

    lockstep, file = False, None
    url = "pair:"

    def __init__(self) -> None:
        self._near, self.far = socket.socketpair()
        self._near.setblocking(False)
        self.far.setblocking(False)
        self._time = 0.0

    def send(self, content: bytes) -> None:
        self._near.sendall(content)

    def receive(self, timeout: float) -> bytes:
        try:
            return self._near.recv(4096)
        except BlockingIOError:
            self._time += timeout
            return b""
        except OSError as error:
            raise LinkError(f"{self.url} broke: {error}") from None

    def clock(self) -> float:
        return self._time

    def close(self) -> None:
        self._near.close()

    def heard(self) -> bytes | None:
        """Return what has come out at the far end since the last call; None where the link was closed."""
        with suppress(BlockingIOError):
            return self.far.recv(4096) or None
        return b""
