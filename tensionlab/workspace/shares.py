"""Shares of a workspace that a grid of poses estimates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.support.arrays import Floats


def node_weights(axis: Floats, measure: Callable[[Floats], Floats] | None = None) -> Floats:
    """Return the share of an interval that is nearest to each node, in any order (the trapezoidal rule).

    ``measure`` is the integral of a density along the axis; left out, the density is the same everywhere.
    """
    order = np.argsort(axis)
    nodes = axis[order]
    borders = np.concatenate([nodes[:1], (nodes[1:] + nodes[:-1]) / 2, nodes[-1:]])
    lengths = np.diff(borders if measure is None else measure(borders))
    weights = np.empty(len(axis))
    weights[order] = lengths / lengths.sum() if lengths.any() else 1.0 / len(axis)
    return weights


def weighted_share(holds: ArrayLike, weights: Sequence[Floats]) -> Floats:
    """Return the share (...) of a grid where something holds, (..., *grid), from the weights along each axis."""
    share = np.asarray(holds, float)
    for along in reversed(weights):
        share = share @ along
    return share.round(12)  # all and nothing are 1 and 0, without the rounding of the weights


def describe_step(axes: Iterable[Floats | None]) -> str:
    """Return the step of a grid in words, such as "0.1 m apart" or "0.1 x 0.2 m apart"."""
    steps = [float(np.ptp(axis)) / (len(axis) - 1) for axis in axes if axis is not None and len(axis) > 1]
    texts = [f"{step:.3g}" for step in steps]
    return f"{' x '.join(texts if len(set(texts)) > 1 else texts[:1])} m apart" if texts else ""
