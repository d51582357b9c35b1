"""Surfaces of a space, and their nearest points, to which anchors snap."""

from __future__ import annotations

from itertools import product

import numpy as np

from tensionlab.model.module import WORLD
from tensionlab.support.arrays import Floats
from tensionlab.workspace.layout.space import Space


def nearest_on_surfaces(space: Space, place: Floats) -> Floats:
    """Return the point of the surfaces nearest to a place, (d,), in m; the place if none is in the world."""
    best = place
    least = np.inf
    for corner, edges in _surfaces(space):
        # Of a rectangle or a box this is the nearest point, of a skew surface one that is near.
        share = np.clip(np.linalg.lstsq(edges.T, place - corner, rcond=None)[0], 0.0, 1.0)
        point = corner + share @ edges
        distance = float(np.linalg.norm(point - place))
        if distance < least:
            best, least = point, distance
    return np.asarray(best)


def outlines(space: Space) -> Floats:
    """Return the edges of all surfaces as line segments (k, 2, d), in m."""
    found: list[Floats] = []
    for corner, edges in _surfaces(space):
        corners = corner + np.array(list(product((0.0, 1.0), repeat=len(edges)))) @ edges
        pairs = product(range(len(corners)), (1 << bit for bit in range(len(edges))))
        found += [corners[[i, i | step]] for i, step in pairs if not i & step]
    return np.stack(found) if found else np.empty((0, 2, space.dimension))


def _surfaces(space: Space) -> list[tuple[Floats, Floats]]:
    """Return corner (d,) and edges (k, d) of the surfaces that stand in the world."""
    return [(surface.corner, surface.edges) for surface in space.surfaces if surface.frame == WORLD]
