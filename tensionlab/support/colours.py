"""Colours of figures, drawings and tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab.support.arrays import Floats

# Colours of figures and marks: Okabe and Ito 2008, "Color universal design".
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#777777"
BODY = "#D9C7B4"  # of a body that cables must stay clear of
RAMP = (BLUE, "#A8A8A8", RED)  # colours of tensions from the lower limit to the upper one, neutral in the middle
AXIS_COLOURS = {"x": BLUE, "y": ORANGE, "z": GREEN}
# Colour of the arrow of each force of a run.
FORCE_COLOURS = {"desired": ORANGE, "commanded": BLUE, "measured": GREEN}
Colours = NDArray[np.uint8]


def rgb(colour: str) -> Colours:
    """Return the colour of a text such as "#0072B2" as numbers (3,)."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.uint8)


def ramp(tensions: Floats, lower: Floats, upper: Floats) -> Colours:
    """Return colours (m, 3) by where tensions (m,) are between their limits (m,); grey for NaN."""
    share = (tensions - lower) / np.where(upper > lower, upper - lower, 1.0)
    stops = np.stack([rgb(colour) for colour in RAMP]).astype(np.float64)
    at = np.linspace(0.0, 1.0, len(stops))
    colours = np.stack([np.interp(np.nan_to_num(share), at, channel) for channel in stops.T], axis=-1)
    return np.where(np.isnan(share)[:, None], rgb(GREY), np.round(colours)).astype(np.uint8)
