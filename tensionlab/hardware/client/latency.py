"""Round-trip times of pings to a module, and the safe rate of set-points that follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensionlab.errors import LinkTimeout
from tensionlab.hardware.client.links import serial_ports
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import Ping, Pong

PING_TIMEOUT_S = 1.0  # an answer that takes longer counts as lost
MIN_SET_POINTS = 3  # least number of set-points sent within the time to live of one
MAX_LOSS = 1e-6  # largest probability that all of them are lost
MAX_RATE_HZ, MAX_BLUETOOTH_RATE_HZ = 1000.0, 100.0
# Start of the URL of a link by Bluetooth; that of a COM port does not tell, but its description does.
BLUETOOTH_PREFIXES = ("bt://", "/dev/rfcomm", "/dev/cu.tensionlab-", "/dev/tty.tensionlab-")


@dataclass(frozen=True)
class RoundTrips:
    """Round-trip times of the pings that came back, in s, and the number of those that were lost.

    `offset` is the module's clock less that of the link, in s, and its error half the shortest trip; NaN if none
    came back.
    """

    times: tuple[float, ...]
    lost: int
    offset: float
    offset_error: float

    def percentile(self, share: float) -> float:
        """Return the time that so many per cent of the trips do not exceed, in s; NaN if none came back."""
        return float(np.percentile(self.times, share, method="higher")) if self.times else math.nan

    @property
    def loss(self) -> float:
        """Share of the pings that were lost."""
        sent = len(self.times) + self.lost
        return self.lost / sent if sent else 0.0


def measure(client: ModuleClient, count: int, progress: Callable[[int], bool]) -> RoundTrips:
    """Send pings, each once, when the one before is back or lost.

    After each, `progress` is called with the number so far and returns whether to go on.
    """
    times: list[float] = []
    offsets: list[float] = []
    done = 0
    while done < count:
        began = client.link.clock()
        try:
            pong = client.request(Ping(done), Pong, (PING_TIMEOUT_S,))
            now = client.link.clock()
            times.append(now - began)
            offsets.append(1e-6 * pong.time_us - (began + now) / 2)
        except LinkTimeout:
            pass
        done += 1
        if not progress(done):
            break
    if not times:
        return RoundTrips((), done, math.nan, math.nan)
    best = int(np.argmin(times))
    return RoundTrips(tuple(times), done - len(times), offsets[best], times[best] / 2)


def safe_rates(trips: RoundTrips, ttl: float, *, bluetooth: bool) -> tuple[float, float] | None:
    """Return the lowest and highest safe rate of set-points, in Hz; None if no rate is safe.

    A set-point must outlive the wait for the next. So at least three are sent within the time to live `ttl`, in s,
    less the time that 99 of 100 take one way (half the trip); and more where all of them would be lost more often
    than once in a million times. At most 100 are sent a second over Bluetooth, and 1000 over anything else.
    """
    left = ttl - trips.percentile(99.0) / 2
    if not left > 0.0:  # nor where nothing came back
        return None
    needed = (
        MIN_SET_POINTS
        if trips.loss == 0.0
        else max(MIN_SET_POINTS, math.ceil(math.log(MAX_LOSS) / math.log(trips.loss)))
    )
    least, most = needed / left, MAX_BLUETOOTH_RATE_HZ if bluetooth else MAX_RATE_HZ
    return (least, most) if least <= most else None


def is_bluetooth(url: str) -> bool:
    """Return whether a link is by Bluetooth, as far as its URL or the system tells."""
    if url.upper().startswith("COM"):
        return any(port.bluetooth for port in serial_ports() if port.url.upper() == url.upper())
    return url.startswith(BLUETOOTH_PREFIXES)
