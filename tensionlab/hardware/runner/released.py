"""What modules that dropped out of a run still pull with, as far as is known: no cable goes slack at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError, LinkError, LinkTimeout
from tensionlab.hardware.protocol.codes import LATCHED_STATES, State

RELAX_S = 2.0
"""A module that timed out keeps its cable taut for so long, in s, before it lets it go."""


@dataclass(frozen=True)
class Release:
    """How a module lets go.

    Attributes
    ----------
    tension : float
        What it pulls with until it begins to, in N.
    begin : float
        When it begins to, in s.
    slew : float
        How fast its tension sinks, in N/s.
    taut : float
        Where it stays for `RELAX_S`, in N; 0: nowhere.
    """

    tension: float
    begin: float
    slew: float
    taut: float = 0.0

    def pull(self, now: float) -> float:
        """Return what it pulls with at a time in s, in N."""
        passed = now - self.begin
        if passed <= 0.0:
            return self.tension
        taut = min(self.taut, self.tension)
        if passed > RELAX_S:
            return max(taut - self.slew * (passed - RELAX_S), 0.0)
        return max(self.tension - self.slew * passed, taut)


NOTHING = Release(0.0, 0.0, 1.0)


class ReleasedModules:
    """Modules that dropped out, and how each lets go.

    Parameters
    ----------
    lower : (m,) array
        Of the tension limits, in N.
    slews : sequence of float
        How fast each module lets its tension change, in N/s.
    ttl : float
        Of set-points, in s.
    """

    def __init__(self, lower: Floats, slews: Sequence[float], ttl: float) -> None:
        self._lower, self._slews, self._ttl = lower, slews, ttl
        self._releases: dict[int, Release] = {}

    def add(
        self, index: int, tension: float, heard: float, now: float, state: State | None, error: HardwareError
    ) -> None:
        """Note a module that dropped out.

        Parameters
        ----------
        index : int
        tension : float
            Of its last set-point, in N.
        heard, now : float
            When it was heard last, and what time it is, in s.
        state : State or None
            As it said last.
        error : HardwareError
            Why it dropped out.
        """
        slew, taut = self._slews[index], float(self._lower[index])
        if state in LATCHED_STATES:
            release = NOTHING  # its driver is off
        elif isinstance(error, LinkTimeout) and now - heard > self._ttl:
            # Nobody knows what still reaches it. What it follows lives on from then, and then it times out.
            release = Release(tension, heard + self._ttl, slew, taut)
        elif isinstance(error, LinkError) or state is State.TIMEOUT:
            release = Release(tension, now, slew, taut)  # a link that closes is a time that is out
        else:
            release = Release(tension, now, slew)  # it hears that it is to stop
        self._releases[index] = release

    def pulls(self, now: float) -> Floats:
        """Return what each pulls with at a time in s, (m,) in N; zero for those that take part."""
        pulls = np.zeros(len(self._lower))
        for index, release in self._releases.items():
            pulls[index] = release.pull(now)
        return pulls
