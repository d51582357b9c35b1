"""How long ago was the set-point sent that a module reports to follow?"""

from __future__ import annotations

import math

import numpy as np

from tensionlab.arrays import Floats, Integers

NUMBERS = 256
"""Sequence numbers of set-points; then they begin anew."""
KEPT_S = 5.0
"""So far back are times of set-points kept, in s."""


class SetPointDelays:
    """Times at which set-points were sent, by their numbers.

    A number stands for many set-points at high rates. Which one it is follows from how many were sent since the
    last report; of the first one that is reported, the newest is taken.

    Parameters
    ----------
    count : int
        Of modules, m.
    rate : float
        Set-points a second.
    """

    def __init__(self, count: int, rate: float) -> None:
        self._kept = NUMBERS * math.ceil(KEPT_S * rate / NUMBERS)
        self._times = np.full((self._kept, count), np.nan)
        self._indices = np.arange(count)
        self._sent: Integers = np.full(
            count, -1, dtype=np.int64
        )  # the latest, counted through; -1 before the first
        self._first = np.full(count, np.nan)  # when that was, in s
        self._own: Integers = np.zeros(count, dtype=np.int64)  # the first one
        self._followed: Integers = np.full(count, -1, dtype=np.int64)
        self._sent_then: Integers = np.zeros(count, dtype=np.int64)  # the latest when `_followed` changed

    def send(self, sequences: Integers, now: float) -> None:
        """Note numbers (m,) of set-points that were sent at a time in s; -1 where none was."""
        new = sequences >= 0
        first = new & (self._sent < 0)
        self._own[first] = sequences[first] + NUMBERS
        self._first[first] = now
        following = self._sent + (sequences - self._sent) % NUMBERS
        self._sent = np.where(first, self._own, np.where(new, following, self._sent))
        self._times[self._sent[new] % self._kept, self._indices[new]] = now

    def delays(self, taken: Integers, now: float) -> tuple[Floats, Floats]:
        """Return how old the set-points are that modules report to follow, by their numbers (m,); -1: none yet.

        Returns
        -------
        (m,) array
            In s; NaN where a module has not reported to follow one of these.
        (m,) array
            The same; there, the time since the first was sent.
        """
        newest = self._sent - (self._sent - taken) % NUMBERS
        step = (taken - self._followed) % NUMBERS
        step = step + NUMBERS * np.rint((self._sent - self._sent_then - step) / NUMBERS).astype(np.int64)
        likely = np.minimum(self._followed + np.maximum(step, 0), newest)
        known = (taken >= 0) & (newest >= self._own) & (self._sent >= 0)
        found = np.where(known, np.where(self._followed >= self._own, likely, newest), self._followed)
        self._sent_then = np.where(found != self._followed, self._sent, self._sent_then)
        self._followed = found
        ages = np.where(known, now - self._times[found % self._kept, self._indices], np.nan)
        return ages, np.where(known, ages, now - self._first)
