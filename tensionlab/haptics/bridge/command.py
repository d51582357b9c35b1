"""Command of a bridge: one client at a time, over WebSocket or OSC, within a budget and with a report."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from tensionlab.errors import TensionlabError

SILENCE_S = 5.0  # a client in command loses it after this time without a valid message
MESSAGES_PER_S, MESSAGES_AT_ONCE = 500.0, 100.0
BYTES_PER_S, BYTES_AT_ONCE = 1e6, 250e3
READ_SHARE, READ_AT_ONCE_S = 0.2, 0.1  # share of one processor, and burst, for reading and answering a client
LIMITS = (
    (f"a flood: at most {MESSAGES_PER_S:g} messages a second", MESSAGES_PER_S, MESSAGES_AT_ONCE),
    (f"too many bytes: at most {1e-3 * BYTES_PER_S:g} kB a second", BYTES_PER_S, BYTES_AT_ONCE),
    (f"too much to read: at most {100 * READ_SHARE:g} % of a processor's time", READ_SHARE, READ_AT_ONCE_S),
)  # of a client, with the reason of a refusal
REPORT_S = 5.0  # period in which a line is reported once, and then only counted
MAX_LINES = 20  # lines in a period


class FrameRefused(TensionlabError):  # noqa: N818 - what it is
    """Frame of a client that is not in command, or of bodies that the rig does not have."""


@dataclass(eq=False)
class Commander:
    """Client that commands, or did; the name is for messages to others."""

    name: str
    last_seen: float  # time of its latest valid message, in s
    on_dismissed: Callable[[str], None]  # called with the reason when it loses the command, from any thread
    dismissed: str = ""  # why it lost the command; empty while it has it


@dataclass
class Command:
    """Command of one client at a time. Used by several threads.

    ``report`` is called with a line when a client takes or loses it.
    """

    report: Callable[[str], None] = lambda line: None
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _holder: Commander | None = None

    def take(self, name: str, now: float, on_dismissed: Callable[[str], None]) -> Commander:
        """Give the command to a client; `FrameRefused` if another one has it and is not silent."""
        with self._lock:
            self.require_free(now)
            previous_commander = self._holder
            commander = self._holder = Commander(name, now, on_dismissed)
        if previous_commander is not None:
            self._dismiss(previous_commander, f"silent for {SILENCE_S:g} s: {name} commands now")
        self.report(f"{name}: commands")
        return commander

    def require_free(self, now: float) -> None:
        """Raise `FrameRefused` while another client commands."""
        holder = self._holder
        if holder is not None and now - holder.last_seen < SILENCE_S:
            until = f"{holder.name} has gone or been silent for {SILENCE_S:g} s"
            raise FrameRefused(f"another client commands; watch at /events, or wait until {until}")

    def leave(self, commander: Commander) -> None:
        """Free the command, if this client has it."""
        with self._lock:
            if self._holder is commander:
                self._holder = None

    def dismiss(self, reason: str) -> None:
        """Take the command from its holder, with a reason."""
        with self._lock:
            holder, self._holder = self._holder, None
        if holder is not None:
            self._dismiss(holder, reason)

    def _dismiss(self, commander: Commander, reason: str) -> None:
        commander.dismissed = reason
        self.report(f"{commander.name}: dismissed: {reason}")
        commander.on_dismissed(reason)


@dataclass
class LeakyBucket:
    """Limit of a flow, on average and at once."""

    per_second: float
    at_once: float
    _level: float = 0.0
    _latest: float | None = None

    def add(self, amount: float, now: float) -> None:
        """Add an amount at a time in s."""
        passed = 0.0 if self._latest is None else max(now - self._latest, 0.0)
        self._latest = now
        leaked = max(self._level - passed * self.per_second, 0.0)
        self._level = min(leaked + amount, 2.0 * self.at_once)  # a long enough pause empties it

    @property
    def full(self) -> bool:
        """Whether the flow exceeds the limit."""
        return self._level > self.at_once

    @property
    def calm(self) -> bool:
        """Whether it is less than half full."""
        return self._level < 0.5 * self.at_once


class Budget:
    """Budget of one client: messages, bytes, and processor time of the thread that reads them."""

    def __init__(self) -> None:
        self._buckets = {reason: LeakyBucket(*limit) for reason, *limit in LIMITS}

    def refuse(self, size: int, now: float) -> str:
        """Count a message by its bytes; return why it must not be read, or an empty string."""
        self._add((1.0, float(size), 0.0), now)
        return next((reason for reason, bucket in self._buckets.items() if bucket.full), "")

    @property
    def calm(self) -> bool:
        """Whether the client has recently used less than half of its budget."""
        return all(bucket.calm for bucket in self._buckets.values())

    def add_reading(self, seconds: float, now: float) -> None:
        """Count the processor time of a message."""
        self._add((0.0, 0.0, seconds), now)

    def _add(self, amounts: tuple[float, float, float], now: float) -> None:
        for bucket, amount in zip(self._buckets.values(), amounts, strict=True):
            bucket.add(amount, now)


class LimitedReport:
    """Report to a terminal, line by line; repeated lines, and those beyond a limit, are only counted.

    ``say`` is called with each line, from the thread that reports; ``clock`` returns the time in s.
    """

    def __init__(self, say: Callable[[str], None], clock: Callable[[], float] = time.perf_counter) -> None:
        self._say, self._clock = say, clock
        self._lock = threading.Lock()
        self._reported: set[str] = set()
        self._withheld, self._since = 0, clock()

    def __call__(self, line: str) -> None:
        """Report a line, or count it."""
        if self._clock() - self._since >= REPORT_S:
            self.finish()
        with self._lock:
            fresh = line not in self._reported and len(self._reported) < MAX_LINES
            self._withheld += not fresh
            if fresh:
                self._reported.add(line)
        if fresh:
            self._say(line)

    def finish(self) -> None:
        """Report the count, and start a new period."""
        with self._lock:
            withheld, self._withheld, self._since = self._withheld, 0, self._clock()
            self._reported.clear()
        if withheld:
            self._say(f"{withheld} more such lines")
