"""State of a process's run for other processes on this computer.

A thread waits at a UDP port of 127.0.0.1. A request is the token, which is in the notes of the locks, a space and
a topic, and is answered with one datagram of JSON. The thread is apart from the loop of a run and the reader of
links, and nothing that comes to its port reaches a module.
"""

from __future__ import annotations

import logging
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

HOST = "127.0.0.1"
MIN_PERIOD_S = 0.05  # between requests; faster ones get lost, so that a flood does not slow down a run
MAX_REQUEST_BYTES, MAX_REPLY_BYTES = 64, 1 << 16
MAX_REMEMBERED = 8  # watchers that get an announced topic


class Publisher:
    """Thread that answers requests for topics.

    It listens at `port`; a request must begin with the `token`. `topics` has a function for each name, which
    returns the answer, of at most `MAX_REPLY_BYTES`.
    """

    def __init__(self) -> None:
        self.topics: dict[str, Callable[[], bytes]] = {}
        self.token = secrets.token_hex(16)
        self._watchers: deque[Any] = deque(maxlen=MAX_REMEMBERED)  # their addresses
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        # macOS sends no more at once.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MAX_REPLY_BYTES)
        self._socket.bind((HOST, 0))
        self.port: int = self._socket.getsockname()[1]
        threading.Thread(target=self._serve, name="telemetry for watchers", daemon=True).start()

    def _serve(self) -> None:
        while True:
            with suppress(OSError):  # of a watcher that has ended, or does not read
                request, watcher = self._socket.recvfrom(MAX_REQUEST_BYTES)
                token, _, topic = request.partition(b" ")
                if secrets.compare_digest(token, self.token.encode()):
                    self._send(topic.decode(errors="replace"), watcher)
                    if watcher not in self._watchers:
                        self._watchers.append(watcher)
            time.sleep(MIN_PERIOD_S)

    def _send(self, topic: str, watcher: Any) -> None:
        """Send a topic, if there is such a one; an error in packing it is logged."""
        if (pack := self.topics.get(topic)) is not None:
            try:
                answer = pack()
            except Exception:
                logging.getLogger(__name__).exception("an answer about %s", topic)
            else:
                self._socket.sendto(answer, watcher)

    def announce(self, topic: str) -> None:
        """Send a topic unasked to the latest watchers, for whom a request may be too late."""
        for watcher in list(self._watchers):
            with suppress(OSError):
                self._send(topic, watcher)


class Watcher:
    """Watcher of the topics of another process; `refused` is whether that process has ended."""

    def __init__(self, port: int, token: str) -> None:
        self.refused = False
        self._token = token
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((HOST, port))
        self._socket.setblocking(False)

    def ask(self, topic: str) -> None:
        """Request a topic."""
        try:
            self._socket.send(f"{self._token} {topic}".encode())
        except (ConnectionRefusedError, ConnectionResetError):
            self.refused = True
        except OSError:
            pass

    def answers(self) -> Iterator[bytes]:
        """Yield the answers that have come."""
        try:
            while True:
                yield self._socket.recv(MAX_REPLY_BYTES)
        except (ConnectionRefusedError, ConnectionResetError):
            self.refused = True
        except OSError:
            pass

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


_publisher: Publisher | None = None
_starting = threading.Lock()


def started() -> Publisher | None:
    """Return the publisher of this process if one has been started."""
    return _publisher


def publisher() -> Publisher | None:
    """Return the publisher of this process, started at the first call; None where it gets no port."""
    global _publisher  # noqa: PLW0603 - one for all links of the process
    with _starting, suppress(OSError):
        _publisher = _publisher or Publisher()
    return _publisher
