"""A batch of problems as a solver is given it, for tests that call a solver without the interface."""

import numpy as np

from tensionlab.solvers.base import Problem


def problem(W, w, lower, upper, policy="force", reference=0.0):
    """A batch of wrenches (B, n); the structure matrix and the limits may be the same for all."""
    W, w = np.asarray(W, dtype=float, order="C"), np.atleast_2d(np.asarray(w, dtype=float))
    size, (n, m) = len(w), W.shape[-2:]
    lower, upper, reference = (
        np.broadcast_to(np.asarray(each, float), (size, m)).copy() for each in (lower, upper, reference)
    )
    return Problem(np.broadcast_to(W, (size, n, m)), w, lower, upper, reference, np.ones(n), policy)


def random_problem(n, m, count=40):
    """Random matrices, wrenches in and out of reach; some are singular, some cables have no play."""
    rng = np.random.default_rng(10 * n + m)
    W = rng.normal(size=(count, n, m))
    W[::5, -1] = W[::5, 0]
    lower = rng.uniform(0.0, 1.0, (count, m))
    upper = lower + rng.uniform(0.5, 6.0, (count, m)) * (rng.random((count, m)) < 0.9)
    wrench = np.einsum("bnm,bm->bn", W, rng.uniform(lower, upper)) * rng.choice([1.0, 1.0, 2.0], (count, 1))
    return problem(W, wrench, lower, upper, reference=rng.uniform(-2.0, 8.0, (count, m)))
