"""Cells of a box: each is cut in two along all axes, as far down as the resolution says."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError
from tensionlab.support.arrays import Floats, Integers, require_finite

# Cells along the shortest edge to begin with: fewer would make the finest much smaller than they need be.
MIN_ROOTS = 4
MAX_AXIS_CELLS = 2**30  # largest number of cells along one axis; more are taken for a mistaken resolution


@dataclass(frozen=True, eq=False)
class Subdivision:
    """Box from ``low`` with edges ``extent`` (d,), in m, in cells (roots times 2^level) along each axis.

    A cell is its level and its place along each axis. An axis without extent has one cell, which is never cut.
    """

    low: Floats
    extent: Floats
    roots: Integers
    levels: int

    @property
    def dimension(self) -> int:
        """Dimension of space: 2 or 3."""
        return len(self.low)

    @property
    def volume(self) -> float:
        """Volume of the box, in m to the power of the number of its axes that have an extent."""
        return float(np.prod(self.extent[self.extent > 0]))

    def edges(self, level: int) -> Floats:
        """Return the edges (d,) of the cells of a level, in m."""
        return self.extent / np.where(self.extent > 0, self.roots * 2.0**level, 1)

    def centres(self, level: int, places: Integers) -> Floats:
        """Return the centres (k, d) of cells, in m."""
        return self.low + (places + 0.5) * self.edges(level)

    def cell_volume(self, level: int) -> float:
        """Return the volume of each cell of a level."""
        return float(np.prod(self.edges(level)[self.extent > 0]))

    def first(self) -> Integers:
        """Return the places (k, d) of the cells of the first level."""
        return np.indices(tuple(self.roots.tolist())).reshape(self.dimension, -1).T.astype(np.int64)

    def children(self, places: Integers) -> Integers:
        """Return the places of the cells that cells are cut into."""
        cut = self.extent > 0
        parts = np.array(list(product(*((0, 1) if each else (0,) for each in cut))))
        doubled = places[:, None] * np.where(cut, 2, 1)
        return np.asarray(doubled + parts).reshape(-1, self.dimension)

    def place_of(self, level: int, position: Floats) -> Integers:
        """Return the places (k, d) of the cells that hold positions (k, d) of the box."""
        edges = self.edges(level)
        along = (position - self.low) / np.where(edges > 0, edges, 1.0)
        last = np.where(edges > 0, self.roots * 2**level, 1) - 1
        return np.clip(np.floor(along), 0, last).astype(np.int64)


def subdivide(region: ArrayLike, resolution: ArrayLike, dimension: int) -> Subdivision:
    """Return the cells of a region (d, 2), in m, the finest of which have edges of the resolution at most.

    InputError if the region or the resolution, one for all axes or one for each, makes no sense.
    """
    ends = require_finite("region", region, 2)
    if ends.shape != (dimension, 2):
        raise InputError(
            f"region has shape {ends.shape}; give where it starts and ends along {'xyz'[:dimension]}, in m"
        )
    low, extent = ends[:, 0], ends[:, 1] - ends[:, 0]
    if not (extent >= 0).all() or not (extent > 0).any():
        axis = int(np.argmin(extent))
        raise InputError(
            f"region runs from {ends[axis, 0]:g} to {ends[axis, 1]:g} along {'xyz'[axis]}; give the lower end "
            "first, and an extent along one axis at least"
        )
    steps = require_finite("resolution", resolution, 0)
    if steps.shape not in ((), (dimension,)) or not (steps > 0).all():
        raise InputError(f"resolution is {resolution!r}; give one length in m, or one for each axis, above zero")
    counts = np.maximum(1, np.ceil(extent / steps * (1 - 1e-12)))
    if not (counts <= MAX_AXIS_CELLS).all():
        raise InputError(f"resolution is {resolution!r}; the region has {counts.max():.2g} of that along an axis")
    levels = max(0, int(np.log2(counts[extent > 0].min() / MIN_ROOTS)))
    roots = np.where(extent > 0, np.ceil(counts / 2**levels), 1).astype(np.int64)
    return Subdivision(low, extent, roots, levels)
