"""A link that goes wrong on purpose, around any other: for tests of what then becomes of the modules."""

from __future__ import annotations

import random
import threading

from tensionlab.errors import LinkError
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.simulation.channel import Channel, Conditions
from tensionlab.hardware.simulation.simulated_module import STEP_S

GRAIN = 1e-3
"""How late bytes may be beyond their delay, in s; with a simulated module, a step of its firmware."""


class FaultyLink:
    """A link whose bytes are late, lost and damaged; it can be cut, and frozen.

    What is on its way moves on while somebody receives, or sends: there is a thread that reads each real link, and
    the time of a simulated module passes only while somebody waits.

    Parameters
    ----------
    inner : Link
        The link that is made worse. It belongs to this one, which closes it.
    conditions : Conditions
        Of each of the two directions; perfect if left out.
    seed : int
        Of the accidents.
    """

    def __init__(self, inner: Link, conditions: Conditions | None = None, *, seed: int = 0) -> None:
        self.inner = inner
        self.url = inner.url
        self.lockstep = inner.lockstep
        conditions = Conditions() if conditions is None else conditions
        self._outbound = Channel(conditions, random.Random(f"out {seed}"))
        self._inbound = Channel(conditions, random.Random(f"in {seed}"))
        self._grain = STEP_S if inner.lockstep else GRAIN
        self._turn = threading.Lock()  # one thread receives, others send
        self._cut = False
        self._frozen = False

    def send(self, content: bytes) -> None:
        """Send bytes, which may come late, damaged or never."""
        self._require_whole()
        with self._turn:
            if not self._frozen:
                self._outbound.put(content, self.clock())
        self._deliver()

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes, and meanwhile let pass on what others sent."""
        end = self.clock() + timeout
        while True:
            self._require_whole()
            self._deliver()
            now = self.clock()
            with self._turn:
                arrived = b"".join(content for content in self._inbound.take(now) if content)
            if arrived:
                return arrived
            content = self.inner.receive(min(max(end - now, 0.0), self._grain))
            with self._turn:
                if content and not self._frozen:
                    self._inbound.put(content, self.clock())
                    continue
            if now >= end or (not content and self.clock() == now):  # less than a step of the firmware is left
                return b""

    def clock(self) -> float:
        """Time of the link inside, in s."""
        return self.inner.clock()

    def close(self) -> None:
        """Close the link inside."""
        self.inner.close()

    def cut(self) -> None:
        """Break for good: whoever uses it gets a `LinkError`, and the module finds its link closed."""
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

    def _deliver(self) -> None:
        """Hand on what has arrived at the module's end by now."""
        with self._turn:
            for content in self._outbound.take(self.clock()):
                if content:
                    self.inner.send(content)

    def _require_whole(self) -> None:
        if self._cut:
            raise LinkError(f"{self.url} broke: it was cut")
