"""What a measure came to, in a few numbers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray

SAMPLE = 4_000_000
"""Values that a median is taken of, at most; of a larger sweep every second one, or every third, and so on."""


@dataclass(frozen=True)
class Summary:
    """How large is a measure, over many poses?

    Attributes
    ----------
    poses, missing : int
        How many poses there are, and how many have no value.
    least, median, largest : float
        Of those that have one; NaN if none has.
    above_zero : float
        Share of the poses with a value where it is above zero.
    """

    poses: int
    missing: int
    least: float
    median: float
    largest: float
    above_zero: float


def summarise(measure: xarray.DataArray) -> Summary:
    """How large is a measure? Reads one chunk of a store at a time.

    Parameters
    ----------
    measure : DataArray
        A variable of what `tensionlab.sweep` returns, or a part of it, such as that of one rig.
    """
    parts = measure.encoding.get("preferred_chunks", {})
    sizes = [parts.get(dim, length) for dim, length in measure.sizes.items()]
    stride = -(-measure.size // SAMPLE)
    least, largest = np.inf, -np.inf
    count = above = 0
    sample = []
    for start in itertools.product(*map(range, itertools.repeat(0), measure.shape, sizes)):
        block = tuple(slice(first, first + size) for first, size in zip(start, sizes, strict=True))
        values = measure[block].values.ravel()
        values = values[~np.isnan(values)]
        if values.size:
            least, largest = min(least, values.min()), max(largest, values.max())
            count += values.size
            above += int(np.count_nonzero(values > 0))
            sample.append(values[::stride])
    if not count:
        return Summary(measure.size, measure.size, np.nan, np.nan, np.nan, np.nan)
    median = float(np.median(np.concatenate(sample)))
    return Summary(measure.size, measure.size - count, float(least), median, float(largest), above / count)
