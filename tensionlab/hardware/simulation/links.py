"""Links to simulated modules, and links that delay, lose and damage bytes on purpose."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass, field

from tensionlab.errors import InputError, LinkError
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


@dataclass(frozen=True)
class Conditions:
    """Conditions of a link, in each of its two directions.

    Bytes arrive in order after `latency` s and up to `jitter` s more, uniformly distributed. Shares of them, 0 to
    1, are lost (`drop`) or arrive with one bit flipped (`corrupt`).
    """

    latency: float = 0.0
    jitter: float = 0.0
    drop: float = 0.0
    corrupt: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            largest, unit = (60, "60 s") if name in ("latency", "jitter") else (1, "1")
            if not 0.0 <= value <= largest:
                raise InputError(f"{name} is from 0 to {unit}; got {value}")


@dataclass
class Channel:
    """Direction of a link: bytes come out later, in the same order; None is its end."""

    conditions: Conditions
    random: random.Random
    _waiting: deque[tuple[float, bytes | None]] = field(default_factory=deque)

    def put(self, content: bytes | None, now: float) -> None:
        """Send bytes at a time in s, or the end of the connection (None)."""
        due = now + self.conditions.latency + self.random.uniform(0.0, self.conditions.jitter)
        if self._waiting:
            due = max(due, self._waiting[-1][0])
        self._waiting.append((due, content if content is None else self._damaged(content)))

    def take(self, now: float) -> list[bytes | None]:
        """Return what has arrived by now."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now:
            arrived.append(self._waiting.popleft()[1])
        return arrived

    def clear(self) -> None:
        """Discard what is on its way."""
        self._waiting.clear()

    def _damaged(self, content: bytes) -> bytes:
        drop, corrupt = self.conditions.drop, self.conditions.corrupt
        if drop == corrupt == 0.0:
            return content
        draw = self.random.random
        kept = (byte for byte in content if draw() >= drop)
        return bytes(byte ^ (1 << self.random.randrange(8)) if draw() < corrupt else byte for byte in kept)


class SimulatedLink:
    """Link to a simulated module of this process, whose time passes in `receive`, and in `advance`."""

    lockstep = True
    file: int | None = None

    def __init__(self, module: SimulatedModule, url: str = "sim:") -> None:
        self.module = module
        self.url = url
        self._open = True

    def send(self, content: bytes) -> None:
        """Hand bytes over."""
        self._require_open()
        self.module.receive(content)

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes, a step of the firmware at a time."""
        self._require_open()
        steps = int(timeout / STEP_S + 1e-6)
        while not (content := self.module.transmit()) and steps > 0:
            self.module.advance(STEP_S)
            steps -= 1
        return content

    def clock(self) -> float:
        """Return the module's time, in s."""
        return self.module.seconds

    def close(self) -> None:
        """Tell the firmware that its link is closed."""
        if self._open:
            self.module.close_link()
        self._open = False

    def _require_open(self) -> None:
        if not self._open:
            raise LinkError(f"{self.url} is closed")


class FaultyLink:
    """Link that owns another one and delays, loses and damages its bytes.

    The other link is one to a simulated module of this process; bytes move only during `receive` and `send`. The
    seed is that of the damage.
    """

    lockstep = True
    file: int | None = None

    def __init__(self, inner: Link, conditions: Conditions | None = None, *, seed: int = 0) -> None:
        self.inner, self.url, self.clock = inner, inner.url, inner.clock
        conditions = Conditions() if conditions is None else conditions
        self._outbound = Channel(conditions, random.Random(f"out {seed}"))
        self._inbound = Channel(conditions, random.Random(f"in {seed}"))

    def send(self, content: bytes) -> None:
        """Send bytes, which may come late, damaged or never."""
        self._outbound.put(content, self.clock())
        self._deliver(self.clock())

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes, and deliver sent ones meanwhile."""
        now = self.clock()
        end = now + timeout
        while True:
            self._deliver(now)
            if arrived := b"".join(filter(None, self._inbound.take(now))):
                return arrived
            content = self.inner.receive(min(max(end - now, 0.0), STEP_S))
            if not content and now >= end:
                return b""
            previous_time, now = now, self.clock()
            if content:
                self._inbound.put(content, now)
            elif now == previous_time:  # less than a step of the firmware is left
                return b""

    def close(self) -> None:
        """Close the link inside."""
        self.inner.close()

    def _deliver(self, now: float) -> None:
        for content in self._outbound.take(now):
            if content:
                self.inner.send(content)
