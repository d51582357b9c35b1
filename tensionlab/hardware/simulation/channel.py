"""What a link does to bytes on their way: it delays, loses and damages them."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass, field

from tensionlab.errors import HardwareError


@dataclass(frozen=True)
class Conditions:
    """How good is a link, in each of its two directions?

    Attributes
    ----------
    latency : float
        Least time that bytes take one way, in s.
    jitter : float
        They take up to so much longer, in s; evenly distributed, but no byte overtakes another.
    drop : float
        Share of the bytes that are lost, 0 to 1.
    corrupt : float
        Share of the bytes that arrive with one bit flipped, 0 to 1.

    Raises
    ------
    HardwareError
        For a number that cannot be.
    """

    latency: float = 0.0
    jitter: float = 0.0
    drop: float = 0.0
    corrupt: float = 0.0

    def __post_init__(self) -> None:
        for name in ("latency", "jitter"):
            if not 0.0 <= getattr(self, name) <= 60.0:
                raise HardwareError(f"{name} is from 0 to 60 s; got {getattr(self, name)}")
        for name in ("drop", "corrupt"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise HardwareError(f"{name} is a share, from 0 to 1; got {getattr(self, name)}")


@dataclass
class Channel:
    """One direction of a link. What is put in comes out in the same order, some time later; None is its end."""

    conditions: Conditions
    random: random.Random
    _waiting: deque[tuple[float, bytes | None]] = field(default_factory=deque)
    _latest: float = 0.0

    def put(self, content: bytes | None, now: float) -> None:
        """Send bytes at a time in s, or the end of the connection (None)."""
        due = now + self.conditions.latency + self.random.uniform(0.0, self.conditions.jitter)
        self._latest = max(self._latest, due)
        self._waiting.append((self._latest, content if content is None else self._damaged(content)))

    def take(self, now: float) -> list[bytes | None]:
        """What has arrived by now?"""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now:
            arrived.append(self._waiting.popleft()[1])
        return arrived

    @property
    def due(self) -> float:
        """When the next of it arrives, in s; infinite if nothing is on its way."""
        return self._waiting[0][0] if self._waiting else float("inf")

    def clear(self) -> None:
        """Forget what is on its way."""
        self._waiting.clear()

    def _damaged(self, content: bytes) -> bytes:
        drop, corrupt = self.conditions.drop, self.conditions.corrupt
        if drop == corrupt == 0.0:
            return content
        draw = self.random.random
        kept = (byte for byte in content if draw() >= drop)
        return bytes(byte ^ (1 << self.random.randrange(8)) if draw() < corrupt else byte for byte in kept)
