"""Two scales in one panel: what motors pull, and, smaller, what only brakes can hold."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHADE = "#F4F1E6"
BEYOND = 0.45
"""Share of a panel that the smaller scale takes."""
WORTH = 1.6
"""Below so many times the knee, one scale does."""
FEW = 2.5
"""At least so many steps from tick to tick fit on the larger scale."""


def two_scales(axes: Axes, values: Floats, knee: float) -> bool:
    """Choose the range of the vertical axis, with a smaller scale beyond a knee if that is needed.

    Parameters
    ----------
    axes : Axes
    values : array
        All that is drawn; NaN is left out.
    knee : float
        Beyond it, up and down, the scale is smaller; a shade tells where.

    Returns
    -------
    bool
        Whether there are two.
    """
    low = min(0.0, float(np.nanmin(values, initial=0.0)))
    high = max(0.0, float(np.nanmax(values, initial=0.0)))
    most = 1.05 * max(high, -low)
    if most <= WORTH * knee:
        spare = 0.06 * max(high - low, 0.1)
        axes.set_ylim(low - spare if low < 0.0 else 0.0, high + spare)
        return False
    slope = BEYOND / (1.0 - BEYOND) * knee / (most - knee)

    def smaller(value: Any) -> Floats:
        size = np.abs(value)
        return np.asarray(np.sign(value) * np.where(size > knee, knee + slope * (size - knee), size))

    def larger(value: Any) -> Floats:
        size = np.abs(value)
        return np.asarray(np.sign(value) * np.where(size > knee, knee + (size - knee) / slope, size))

    axes.set_yscale("function", functions=(smaller, larger))
    bottom = 1.05 * low if low < -knee else low - 0.05 * knee if low < 0.0 else 0.0
    top = 1.05 * high if high > knee else high + 0.05 * knee
    axes.set_ylim(bottom, top)
    fine, coarse = _round(knee / FEW), _round((most - knee) / 2.0)
    above = np.arange(coarse, most, coarse)
    sizes = [*np.arange(0.0, 0.9 * knee, fine), *above[above > knee + 0.1 * (most - knee)]]
    ticks = sorted({sign * float(size) for size in sizes for sign in (1.0, -1.0)})
    axes.set_yticks([tick for tick in ticks if bottom <= tick <= top], minor=False)
    axes.minorticks_off()
    axes.yaxis.set_major_formatter("{x:g}")
    for edge, end in ((knee, top), (-knee, bottom)):
        if edge * end > 0.0 and abs(end) > knee:
            axes.axhspan(edge, end, color=SHADE, linewidth=0.0, zorder=0)
    return True


def _round(step: float) -> float:
    """Which of 1, 2, 5 times a power of ten is at most so large?"""
    power = 10.0 ** math.floor(math.log10(step))
    return next(each * power for each in (5.0, 2.0, 1.0) if each * power <= step * (1.0 + 1e-9))
