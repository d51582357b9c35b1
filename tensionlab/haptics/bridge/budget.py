"""Budget of a client: how many messages, bytes and seconds of reading it may cost."""

from __future__ import annotations

from dataclasses import dataclass, field

MESSAGES_PER_S, MESSAGES_AT_ONCE = 500.0, 100.0
BYTES_PER_S, BYTES_AT_ONCE = 1e6, 250e3
WORK_SHARE, WORK_AT_ONCE_S = 0.2, 0.1
"""Of one processor's time, for reading and answering what a client sends."""


@dataclass
class Bucket:
    """A bucket that leaks: what may flow on average, and at once.

    Parameters
    ----------
    per_second, at_once : float
    """

    per_second: float
    at_once: float
    _level: float = 0.0
    _latest: float | None = None

    def add(self, amount: float, now: float) -> None:
        """Pour something in, at a time in s."""
        passed = 0.0 if self._latest is None else max(now - self._latest, 0.0)
        self._latest = now
        leaked = max(self._level - passed * self.per_second, 0.0)
        self._level = min(leaked + amount, 2.0 * self.at_once)  # who has paused long enough may go on

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
    """What one client may cost, by the clock and by the processor's time of the thread that reads."""

    _messages: Bucket = field(default_factory=lambda: Bucket(MESSAGES_PER_S, MESSAGES_AT_ONCE))
    _bytes: Bucket = field(default_factory=lambda: Bucket(BYTES_PER_S, BYTES_AT_ONCE))
    _work: Bucket = field(default_factory=lambda: Bucket(WORK_SHARE, WORK_AT_ONCE_S))

    def refuses(self, size: int, now: float) -> str:
        """Count a message of so many bytes; return why it must not be read, or an empty string."""
        self._messages.add(1.0, now)
        self._bytes.add(float(size), now)
        self._work.add(0.0, now)
        if self._messages.full:
            return f"a flood: at most {MESSAGES_PER_S:g} messages a second"
        if self._bytes.full:
            return f"too many bytes: at most {1e-3 * BYTES_PER_S:g} kB a second"
        if self._work.full:
            return f"too much to read: at most {100 * WORK_SHARE:g} % of a processor's time"
        return ""

    @property
    def calm(self) -> bool:
        """Whether the client has kept well within its budget of late."""
        return self._messages.calm and self._bytes.calm and self._work.calm

    def worked(self, seconds: float, now: float) -> None:
        """Count the processor's time that a message has cost."""
        self._work.add(seconds, now)
