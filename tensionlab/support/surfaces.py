"""Surfaces around the part of a grid in which values are above a level."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import optional_import
from tensionlab.support.arrays import Floats

Surface = tuple[Floats, NDArray[np.int64]]  # vertices (k, 3), and triangles (f, 3) of their indices


def level_surface(values: Floats, axes: tuple[Floats, ...], level: float) -> Surface | None:
    """Return the surface around all that is above a level; None if nothing is.

    Triangles are seen anticlockwise from outside; the surface closes at the borders of the grid. NaN is below the
    level. Marching cubes: Lewiner, Lopes, Vieira and Tavares, "Efficient implementation of marching cubes' cases
    with topological guarantees", 2003, in scikit-image; `MissingDependency` if that is not installed.
    """
    if not (values > level).any():
        return None
    with optional_import("workspace", "the surface of a workspace"):
        from skimage.measure import marching_cubes
    # What lies outside is a little below the level, so that the surface closes at the border.
    margin = 1e-6 * (np.nanmax(values[np.isfinite(values)], initial=level) - level) + 1e-12
    heights = np.nan_to_num(values - level, nan=-margin, posinf=1e30, neginf=-margin)
    padded = np.pad(heights, 1, constant_values=-margin)
    step = np.array([axis[1] - axis[0] for axis in axes])
    march: Any = marching_cubes  # it has no types
    corners, faces, _, _ = march(padded, 0.0, spacing=tuple(step), gradient_direction="ascent")
    low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))
    return np.clip(corners - step + low, low, high), faces.astype(np.int64)
