"""Links to simulated modules, and links that delay, lose and damage bytes on purpose."""

from __future__ import annotations

import random
import threading
from collections import deque
from dataclasses import dataclass, field

from tensionlab.errors import InputError, LinkError
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


@dataclass(frozen=True)
class Conditions:
    """Conditions of a link, in each of its two directions.

    Bytes take `latency` s and up to `jitter` s more, evenly distributed, and none overtakes another. Shares of
    them, 0 to 1, are lost (`drop`) or arrive with one bit flipped (`corrupt`).
    """

    latency: float = 0.0
    jitter: float = 0.0
    drop: float = 0.0
    corrupt: float = 0.0

    def __post_init__(self) -> None:
        for name in ("latency", "jitter"):
            if not 0.0 <= getattr(self, name) <= 60.0:
                raise InputError(f"{name} is from 0 to 60 s; got {getattr(self, name)}")
        for name in ("drop", "corrupt"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"{name} is a share, from 0 to 1; got {getattr(self, name)}")


@dataclass
class Channel:
    """Direction of a link: bytes come out in the same order, some time later; None is its end."""

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
        """Return what has arrived by now."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now:
            arrived.append(self._waiting.popleft()[1])
        return arrived

    @property
    def due(self) -> float:
        """Time at which the next bytes arrive, in s; infinite if none are on their way."""
        return self._waiting[0][0] if self._waiting else float("inf")

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
    """Link to a simulated module of this process, whose time passes while somebody waits, and in `advance`."""

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


POLL_PERIOD_S = 1e-3  # how late bytes may be beyond their delay; with a simulated module, a step of its firmware


class FaultyLink:
    """Link around another, which it owns, whose bytes are late, lost and damaged; it can be cut, and frozen.

    Bytes move on while somebody receives or sends: there is a thread that reads each real link, and the time of a
    simulated module passes only while somebody waits. The seed is that of the damage.
    """

    file: int | None = None  # bytes that come late come from here

    def __init__(self, inner: Link, conditions: Conditions | None = None, *, seed: int = 0) -> None:
        self.inner = inner
        self.url = inner.url
        self.lockstep = inner.lockstep
        conditions = Conditions() if conditions is None else conditions
        self._outbound = Channel(conditions, random.Random(f"out {seed}"))
        self._inbound = Channel(conditions, random.Random(f"in {seed}"))
        self._grain = STEP_S if inner.lockstep else POLL_PERIOD_S
        self._turn = threading.Lock()  # one thread receives, others send
        self._cut = False
        self._frozen = False

    def send(self, content: bytes) -> None:
        """Send bytes, which may come late, damaged or never."""
        self._require_whole()
        with self._turn:
            if not self._frozen:
                self._outbound.put(content, self.clock())
        self._deliver(self.clock())

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes, and meanwhile deliver what others sent."""
        now = self.clock()
        end = now + timeout
        while True:
            self._require_whole()
            self._deliver(now)
            with self._turn:
                arrived = b"".join(content for content in self._inbound.take(now) if content)
            if arrived:
                return arrived
            content = self.inner.receive(min(max(end - now, 0.0), self._grain))
            before, now = now, self.clock()
            with self._turn:
                if content and not self._frozen:
                    self._inbound.put(content, now)
                    continue
            if before >= end or (not content and now == before):  # less than a step of the firmware is left
                return b""

    def clock(self) -> float:
        """Return the time of the link inside, in s."""
        return self.inner.clock()

    def close(self) -> None:
        """Close the link inside."""
        self.inner.close()

    def cut(self) -> None:
        """Break for good: users get a `LinkError`, and the module finds its link closed."""
        self._cut = True
        self.inner.close()

    def freeze(self) -> None:
        """Lose all bytes from now on, those on their way too, without a sign of it."""
        with self._turn:
            self._frozen = True
            self._outbound.clear()
            self._inbound.clear()

    def thaw(self) -> None:
        """Let bytes through again."""
        self._frozen = False

    def _deliver(self, now: float) -> None:
        """Deliver what has arrived at the module's end by now."""
        with self._turn:
            for content in self._outbound.take(now):
                if content:
                    self.inner.send(content)

    def _require_whole(self) -> None:
        if self._cut:
            raise LinkError(f"{self.url} broke: it was cut")
