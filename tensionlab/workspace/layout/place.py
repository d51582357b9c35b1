"""From numbers between 0 and 1 to anchors, and from anchors to capacity margins, for many layouts at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tensionlab.arrays import Floats, Integers
from tensionlab.model import kinematics
from tensionlab.model.module import TensionLimits
from tensionlab.workspace.gradient import margin_gradient
from tensionlab.workspace.layout.space import Space
from tensionlab.workspace.margin import capacity_margin

CHUNK = 50_000
"""Points of layouts that are worked on at once; it bounds the memory."""

BORDER = 0.15
"""What of an edge's genes stands for each of its two ends, as a share of the edge: good places are often there."""


class Places(NamedTuple):
    """On which surfaces do modules stand, and where on them?

    Attributes
    ----------
    surfaces : (..., k) array
        Indices of surfaces.
    along : (..., k, d) array
        Shares of the surface's edges, from 0 to 1; without effect where it has fewer than d.
    """

    surfaces: Integers
    along: Floats


def decode(space: Space, genes: Floats) -> Places:
    """Which places do genes stand for?

    Of the d + 1 genes of a module, the first picks the surface, all of which are equally likely, so that a search
    finds the small ones too. The others are the shares of its edges.

    Parameters
    ----------
    space : Space
    genes : (..., k, d + 1) array
        From 0 to 1.
    """
    count = len(space.surfaces)
    surfaces = np.minimum((genes[..., 0] * count).astype(np.int64), count - 1)
    return Places(surfaces, np.clip(genes[..., 1:] * (1 + 2 * BORDER) - BORDER, 0.0, 1.0))


def anchors(space: Space, places: Places) -> Floats:
    """Where in the world are all modules, the fixed ones last? (..., m, d), in m."""
    placed = space.placed
    put = placed.corners[places.surfaces] + np.einsum(
        "...k,...kd->...d", places.along, placed.edges[places.surfaces]
    )
    fixed = np.broadcast_to(placed.fixed, (*put.shape[:-2], *placed.fixed.shape))
    return np.concatenate([put, fixed], axis=-2)


def limits(space: Space, count: int) -> TensionLimits:
    """Which limits have all modules, the fixed ones last?"""
    lower, upper = ([limit] * count for limit in space.limits)
    return TensionLimits(
        np.array([*lower, *(module.lower for module in space.fixed)]),
        np.array([*upper, *(module.upper for module in space.fixed)]),
    )


def margins(anchors: Floats, limits: TensionLimits, target: Floats) -> Floats:
    """How much force can layouts render in every direction, at each point of the target?

    Parameters
    ----------
    anchors : (..., m, d) array
        In the world, in m.
    limits : TensionLimits
    target : (P, d) array
        In m.

    Returns
    -------
    (..., P) array
        Capacity margins about no force, in N.
    """
    flat = anchors.reshape(-1, *anchors.shape[-2:])
    found = np.empty((len(flat), len(target)))
    rows = max(1, CHUNK // len(target))
    for start in range(0, len(flat), rows):
        _, directions = kinematics.cables(flat[start : start + rows, None], target, None)
        found[start : start + rows] = capacity_margin(kinematics.structure_matrix(directions, None), limits)
    return found.reshape(*anchors.shape[:-2], len(target))


def slopes(space: Space, places: Places, limits: TensionLimits, target: Floats) -> tuple[Floats, Floats]:
    """How do the margins of one layout change as its modules move along their surfaces?

    Returns
    -------
    margins : (P,) array
        In N.
    slopes : (P, k, d) array
        In N for the whole length of each edge.
    """
    lengths, directions = kinematics.cables(anchors(space, places), target, None)
    found = margin_gradient(kinematics.structure_matrix(directions, None), limits)
    by_anchor = kinematics.anchor_gradient(found.structure, lengths, directions, None)
    edges = space.placed.edges[places.surfaces]
    put = by_anchor[:, : len(places.surfaces)]
    return found.margin, np.einsum("pkd,ked->pke", put, edges)
