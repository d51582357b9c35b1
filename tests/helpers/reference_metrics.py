"""Reference metrics of the workspace: by a simplex code, and by Qhull on all corners of the box."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from tensionlab.support.arrays import Floats


def corners(lower: Floats, upper: Floats) -> Floats:
    """All corners of the box, (2^m, m)."""
    return np.array(list(product(*zip(lower, upper, strict=True))))


def hull_margins(W: Floats, lower: Floats, upper: Floats, wrenches: Floats) -> Floats:
    """Least signed distance from each wrench to a facet of the available set, which has volume."""
    if len(W) == 1:
        ends = np.sort((corners(lower, upper) @ W.T)[:, 0])
        return np.minimum(wrenches - ends[0], ends[-1] - wrenches).min(axis=1)
    facets = ConvexHull(corners(lower, upper) @ W.T).equations
    return np.asarray(-(wrenches @ facets[:, :-1].T + facets[:, -1]).max(axis=1))


def renders(W: Floats, lower: Floats, upper: Floats, wrench: Floats) -> bool:
    """Whether tensions inside the limits render the wrench."""
    limits = np.column_stack([lower, upper])
    return bool(linprog(np.zeros(len(lower)), A_eq=W, b_eq=wrench, bounds=limits, method="highs-ds").success)


def evenness(W: Floats) -> float:
    """The largest ratio of least to largest tension without a wrench; 0 if there is none."""
    m = W.shape[1]
    # min tau subject to W t = 0 and 1 <= t <= tau
    rows = np.column_stack([np.eye(m), -np.ones(m)])
    balance = np.column_stack([W, np.zeros(len(W))])
    found = linprog(
        np.append(np.zeros(m), 1.0), rows, np.zeros(m), balance, np.zeros(len(W)), (1.0, None), method="highs-ds"
    )
    return float(1.0 / found.fun) if found.success else 0.0
