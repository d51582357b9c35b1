"""How long do messages take to a module, and at which rate of set-points is it safe?"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensionlab.errors import LinkTimeout
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import Ping, Pong

PATIENCE = 1.0
"""How long an answer may take, in s; later, it counts as lost."""
TRIES = 3
"""Set-points that must have a chance to arrive before the last one taken runs out, at least."""
RARE = 1e-6
"""How seldom all of them may be lost."""
HIGHEST, HIGHEST_BLUETOOTH = 1000.0, 100.0
"""Set-points a second, at most."""
BLUETOOTH = ("bt://", "/dev/rfcomm", "/dev/cu.tensionlab-", "/dev/tty.tensionlab-")
"""What the URL of a link by Bluetooth begins with; those of Windows do not say."""


@dataclass(frozen=True)
class Trips:
    """How did so many pings go?

    Attributes
    ----------
    times : tuple of float
        Of those that came back: there and back, in s.
    lost : int
        Those that did not.
    offset : float
        What the module's clock shows more than that of the link, in s; NaN if none came back.
    offset_error : float
        By how much that may be wrong, in s: half the shortest trip.
    """

    times: tuple[float, ...]
    lost: int
    offset: float
    offset_error: float

    def percentile(self, share: float) -> float:
        """Which time do so many per cent of the trips not exceed? NaN if none came back."""
        return float(np.percentile(self.times, share, method="higher")) if self.times else math.nan

    @property
    def loss(self) -> float:
        """Which share did not come back?"""
        sent = len(self.times) + self.lost
        return self.lost / sent if sent else 0.0


def measure(client: ModuleClient, count: int, told: Callable[[int], bool]) -> Trips:
    """How long do pings take? Each is sent once, when the one before is back or lost.

    Parameters
    ----------
    client : ModuleClient
    count : int
        How many.
    told : callable
        Told after each how many are done; whether to go on.
    """
    times: list[float] = []
    offsets: list[float] = []
    done = 0
    while done < count:
        began = client.link.clock()
        try:
            pong = client.request(Ping(done), Pong, (PATIENCE,))
            now = client.link.clock()
            times.append(now - began)
            offsets.append(1e-6 * pong.time_us - (began + now) / 2)
        except LinkTimeout:
            pass
        done += 1
        if not told(done):
            break
    if not times:
        return Trips((), done, math.nan, math.nan)
    best = int(np.argmin(times))
    return Trips(tuple(times), done - len(times), offsets[best], times[best] / 2)


def safe_rates(trips: Trips, ttl: float, *, bluetooth: bool) -> tuple[float, float] | None:
    """How often must set-points be sent, and how often may they? In Hz; None if no rate is safe.

    A set-point must outlive the wait for the next. So at least three are sent within the time to live, less the
    time that 99 of 100 take one way (half the trip); and more where so many are lost that all of them would be,
    more often than once in a million times. At most 100 are sent a second over Bluetooth, whose turns are few, and
    1000 over anything else.

    Parameters
    ----------
    trips : Trips
    ttl : float
        Time to live of the module's set-points, in s.
    bluetooth : bool
        Whether the link is one by Bluetooth.
    """
    left = ttl - trips.percentile(99.0) / 2
    if not left > 0.0:  # nor where nothing came back
        return None
    tries = TRIES if trips.loss == 0.0 else max(TRIES, math.ceil(math.log(RARE) / math.log(trips.loss)))
    least, most = tries / left, HIGHEST_BLUETOOTH if bluetooth else HIGHEST
    return (least, most) if least <= most else None


def is_bluetooth(url: str) -> bool:
    """Whether a link is one by Bluetooth, as far as its URL tells."""
    return url.startswith(BLUETOOTH)
