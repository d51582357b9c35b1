"""Shares of a box, from values at the nodes of a grid."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.support.arrays import Floats


def node_weights(axis: Floats) -> Floats:
    """Return the share of an interval that is nearest to each node: half a step at the ends, a whole one between.

    On a grid in space a node in a face then counts half, in an edge a quarter, in a corner an eighth (the
    trapezoidal rule). Nodes are coordinates in any order.
    """
    order = np.argsort(axis)
    nodes = axis[order]
    lengths = np.diff(np.concatenate([nodes[:1], (nodes[1:] + nodes[:-1]) / 2, nodes[-1:]]))
    weights = np.empty(len(axis))
    weights[order] = lengths / lengths.sum() if lengths.any() else 1.0 / len(axis)
    return weights


def equal_weights(count: int) -> Floats:
    """Return the weights of poses that are no grid, or of orientations."""
    return np.full(count, 1.0 / count)


def weighted_share(holds: ArrayLike, weights: Sequence[Floats]) -> Floats:
    """Return the share (...) of a grid where something holds, (..., *grid), from the weights along each axis."""
    share = np.asarray(holds, float)
    for along in reversed(weights):
        share = share @ along
    return share


def describe_step(axes: Iterable[Floats | None]) -> str:
    """Return the step of a grid in words, such as "0.1 m apart" or "0.1 x 0.2 m apart"."""
    steps = [float(np.ptp(axis)) / (len(axis) - 1) for axis in axes if axis is not None and len(axis) > 1]
    texts = [f"{step:.3g}" for step in steps]
    return f"{' x '.join(texts if len(set(texts)) > 1 else texts[:1])} m apart" if texts else ""
