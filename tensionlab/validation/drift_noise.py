"""A sensor's reading wanders: an Ornstein-Uhlenbeck process for each axis, sample by sample."""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats

RATE = 1000
"""Samples a second."""
WANDER = 1.0
"""Correlation time, in s."""
BLOCK = 1000
"""Samples at a time, so that no power of the decay gets out of range."""


class Wander:
    """What is to be added to each sample of three axes?

    Parameters
    ----------
    deviation : float
        Standard deviation, in N.
    seed : int
        The same one gives the same samples, in pieces of any size.
    """

    def __init__(self, deviation: float, seed: int) -> None:
        self._random = np.random.default_rng([seed, 1])
        self._share = float(np.exp(-1.0 / (RATE * WANDER)))
        self._kick = deviation * np.sqrt(1.0 - self._share**2)
        self._last: Floats = deviation * self._random.standard_normal(3)

    def take(self, count: int) -> Floats:
        """The next samples: (count, 3) array in N."""
        blocks = [self._block(min(BLOCK, count - start)) for start in range(0, count, BLOCK)]
        return np.concatenate([np.empty((0, 3)), *blocks])

    def _block(self, count: int) -> Floats:
        fading = self._share ** np.arange(1, count + 1)[:, None]
        kicks = self._kick * self._random.standard_normal((count, 3))
        values: Floats = fading * (self._last + np.cumsum(kicks / fading, axis=0))
        self._last = values[-1]
        return values
