"""Command of a bridge: one client at a time, over WebSocket and OSC, and within a budget."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from tensionlab.errors import TensionlabError

SILENCE_S = 5.0  # a client in command that sends nothing valid for so long loses its place
MESSAGES_PER_S, MESSAGES_AT_ONCE = 500.0, 100.0
BYTES_PER_S, BYTES_AT_ONCE = 1e6, 250e3
READ_SHARE, READ_AT_ONCE_S = 0.2, 0.1  # share of one processor, and burst, for reading and answering a client


class FrameRefused(TensionlabError):  # noqa: N818 - what it is
    """Frame of a client that does not command, or of bodies that the rig does not have."""


@dataclass(eq=False)
class Commander:
    """Client that commands, or did.

    Attributes
    ----------
    name : str
        For messages to others.
    last_seen : float
        When its latest valid message came, in s.
    on_dismissed : callable
        Called with the reason when it loses its place, from any thread.
    dismissed : str
        Why it lost its place; empty while it has it.
    """

    name: str
    last_seen: float
    on_dismissed: Callable[[str], None]
    dismissed: str = ""


@dataclass
class Command:
    """Place of the client that commands. Used by several threads.

    Attributes
    ----------
    report : callable
        Called with a line when a client gets the place, or goes.
    """

    report: Callable[[str], None] = lambda line: None
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _holder: Commander | None = None

    def take(self, name: str, now: float, on_dismissed: Callable[[str], None]) -> Commander:
        """Give the place to a client, unless another one has it and is not silent.

        Raises
        ------
        FrameRefused
            Another one has it.
        """
        with self._lock:
            self.require_free(now)
            before = self._holder
            commander = self._holder = Commander(name, now, on_dismissed)
        if before is not None:
            self._dismiss(before, f"silent for {SILENCE_S:g} s: {name} commands now")
        self.report(f"{name}: commands")
        return commander

    def require_free(self, now: float) -> None:
        """Raise `FrameRefused` while another client commands."""
        holder = self._holder
        if holder is not None and now - holder.last_seen < SILENCE_S:
            raise FrameRefused(
                f"another client commands; watch at /events, or wait until {holder.name} has gone or been "
                f"silent for {SILENCE_S:g} s"
            )

    def leave(self, commander: Commander) -> None:
        """Free the place, if it is this client's."""
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
    """Limit of what may flow on average, and at once."""

    per_second: float
    at_once: float
    _level: float = 0.0
    _latest: float | None = None

    def add(self, amount: float, now: float) -> None:
        """Add an amount at a time in s."""
        passed = 0.0 if self._latest is None else max(now - self._latest, 0.0)
        self._latest = now
        leaked = max(self._level - passed * self.per_second, 0.0)
        self._level = min(leaked + amount, 2.0 * self.at_once)  # a pause that is long enough resets it

    @property
    def full(self) -> bool:
        """Whether it was too much."""
        return self._level > self.at_once

    @property
    def calm(self) -> bool:
        """Whether most of it has leaked away."""
        return self._level < 0.5 * self.at_once


@dataclass
class Budget:
    """Budget of one client, by the clock and by the processor's time of the thread that reads."""

    _messages: LeakyBucket = field(default_factory=lambda: LeakyBucket(MESSAGES_PER_S, MESSAGES_AT_ONCE))
    _bytes: LeakyBucket = field(default_factory=lambda: LeakyBucket(BYTES_PER_S, BYTES_AT_ONCE))
    _reading: LeakyBucket = field(default_factory=lambda: LeakyBucket(READ_SHARE, READ_AT_ONCE_S))

    def refuse(self, size: int, now: float) -> str:
        """Count a message by its bytes; return why it must not be read, or an empty string."""
        self._messages.add(1.0, now)
        self._bytes.add(float(size), now)
        self._reading.add(0.0, now)
        if self._messages.full:
            return f"a flood: at most {MESSAGES_PER_S:g} messages a second"
        if self._bytes.full:
            return f"too many bytes: at most {1e-3 * BYTES_PER_S:g} kB a second"
        if self._reading.full:
            return f"too much to read: at most {100 * READ_SHARE:g} % of a processor's time"
        return ""

    @property
    def calm(self) -> bool:
        """Whether the client has kept well within its budget of late."""
        return self._messages.calm and self._bytes.calm and self._reading.calm

    def add_reading(self, seconds: float, now: float) -> None:
        """Count the processor's time that a message has cost."""
        self._reading.add(seconds, now)
