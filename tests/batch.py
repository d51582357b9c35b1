"""A batch of problems as a solver is given it, for tests that call a solver without the interface."""

import numpy as np

from tensionlab.solvers.contract import Problem


def problem(W, w, lower, upper, nearest="force"):
    """A batch: one structure matrix and limits for all wrenches."""
    W, w = np.asarray(W, dtype=float), np.atleast_2d(np.asarray(w, dtype=float))
    size, (n, m) = len(w), W.shape
    lower, upper = (np.broadcast_to(np.asarray(a, float), (size, m)) for a in (lower, upper))
    structure = np.broadcast_to(W, (size, n, m))
    return Problem(structure, w, lower, upper, np.zeros((size, m)), np.ones(n), nearest)
