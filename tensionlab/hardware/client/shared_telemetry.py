"""Telemetry of modules for other processes on this computer, published by the process that has their links.

A thread waits at a UDP port of 127.0.0.1 and answers requests with the right token, which is in the notes of the
locks, with one datagram per module: JSON, with the latest telemetry as a frame. A request may name a topic
instead, such as the run of that process (`tensionlab.hardware.sharing`). The thread is apart from the loop of a
run and from the reader of links, and nothing that comes to its port reaches a module.
"""

from __future__ import annotations

import json
import logging
import math
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tensionlab.errors import ProtocolError
from tensionlab.hardware.protocol.messages import Decoder, Telemetry, read

HOST = "127.0.0.1"
MIN_PERIOD_S = 0.05  # between requests; faster ones get lost, so that a flood does not slow down a run
MAX_REQUEST_BYTES, MAX_REPLY_BYTES = 64, 1 << 16
MAX_REMEMBERED = 8  # watchers that get the last state of a topic


@dataclass(frozen=True)
class Report:
    """Reply about a module: its link and name, its latest telemetry, if any, and the age of that in s.

    `bad_frames` is the number of frames that arrived damaged.
    """

    url: str
    name: str
    telemetry: Telemetry | None
    age: float
    bad_frames: int

    def pack(self) -> bytes:
        """Return the datagram."""
        frame = "" if self.telemetry is None else self.telemetry.frame(0).pack().hex()
        age = self.age if math.isfinite(self.age) else None
        row = {"url": self.url, "name": self.name, "age": age, "bad_frames": self.bad_frames, "telemetry": frame}
        return json.dumps(row).encode()

    @classmethod
    def unpack(cls, content: bytes) -> Report:
        """Return the report of a datagram; ValueError, KeyError, TypeError or `ProtocolError` if it is none."""
        row: dict[str, Any] = json.loads(content)
        frames = Decoder().feed(bytes.fromhex(row["telemetry"]))
        telemetry = read(frames[0]) if frames else None
        if not (telemetry is None or isinstance(telemetry, Telemetry)):
            raise ProtocolError("no telemetry")
        age = math.inf if row["age"] is None else float(row["age"])
        return cls(str(row["url"]), str(row["name"]), telemetry, age, int(row["bad_frames"]))


class Publisher:
    """Thread that answers requests for telemetry and other topics.

    Attributes
    ----------
    port, token : int, str
        Where it listens, and what a request must be or begin with, followed by a space and a topic.
    reports : dict
        Function that returns the `Report`, by the URL of the link.
    topics : dict
        Function that returns the answer, of at most `MAX_REPLY_BYTES`, by the name of the topic.
    """

    def __init__(self) -> None:
        self.reports: dict[str, Callable[[], Report]] = {}
        self.topics: dict[str, Callable[[], bytes]] = {}
        self.token = secrets.token_hex(16)
        self._watchers: deque[Any] = deque(maxlen=MAX_REMEMBERED)  # addresses of clients that asked for topics
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDBUF, MAX_REPLY_BYTES
        )  # macOS sends no more at once
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
                    if topic and watcher not in self._watchers:
                        self._watchers.append(watcher)
            time.sleep(MIN_PERIOD_S)

    def _send(self, topic: str, watcher: Any) -> None:
        """Send each answer that can be packed; the error of another is logged."""
        known: dict[str, Callable[[], bytes | Report]] = dict(self.topics if topic else self.reports)
        for name, ask in known.items():
            if topic not in ("", name):
                continue
            try:
                found = ask()
                answer = found.pack() if isinstance(found, Report) else found
            except Exception:
                logging.getLogger(__name__).exception("an answer about %s", name)
                continue
            self._socket.sendto(answer, watcher)

    def announce(self, topic: str) -> None:
        """Send a topic unasked to the latest watchers, for whom a request may be too late."""
        for watcher in list(self._watchers):
            with suppress(OSError):
                self._send(topic, watcher)


class Watcher:
    """Watcher of the published modules of another process, or of one of its topics.

    `refused` is whether that process has ended.
    """

    def __init__(self, port: int, token: str) -> None:
        self.refused = False
        self._token = token.encode()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((HOST, port))
        self._socket.setblocking(False)

    def ask(self, topic: str = "") -> None:
        """Request a report of each module, or a topic."""
        request = self._token + (b" " + topic.encode() if topic else b"")
        try:
            self._socket.send(request)
        except (ConnectionRefusedError, ConnectionResetError):
            self.refused = True
        except OSError:
            pass

    def answers(self) -> Iterator[bytes]:
        """Yield the answers that have come."""
        while True:
            try:
                yield self._socket.recv(MAX_REPLY_BYTES)
            except (ConnectionRefusedError, ConnectionResetError):
                self.refused = True
                return
            except OSError:
                return

    def reports(self) -> Iterator[Report]:
        """Yield the reports that have come."""
        for content in self.answers():
            with suppress(ValueError, ArithmeticError, LookupError, TypeError, ProtocolError):
                yield Report.unpack(content)

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
