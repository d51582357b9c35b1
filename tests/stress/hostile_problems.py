"""Problems made to defeat a tension solver: nearly flat rigs, wrenches on faces, edges and corners, odd scales."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.benchmark.rigs import unit_vectors
from tensionlab.solvers.base import POLICIES, Policy, Problem
from tensionlab.solvers.least_squares import Newton
from tensionlab.solvers.programs import times
from tensionlab.support.arrays import Floats

SHAPES = ((1, 2), (2, 2), (2, 3), (2, 4), (3, 2), (3, 3), (3, 4), (3, 5), (3, 8), (6, 6), (6, 7), (6, 8))
# Structure entries and tensions are multiples of this before rows are scaled, so that `W t` is exact.
GRID = 2.0**-16
BLOCK = 4000  # problems that are solved at once ...
VARIANTS = 16  # ... and the wrenches that each rig is given among them
ROW_POWERS = 46  # a row is scaled by at least 2 to the minus this: the rest of a nearly flat rig

Draw = Callable[[np.random.Generator, int, int], Floats]


def _spread(rng: np.random.Generator, n: int, m: int) -> Floats:
    return np.round(unit_vectors(rng, m, n).T / GRID) * GRID


def _flat(rng: np.random.Generator, n: int, m: int) -> Floats:
    """Cables nearly in a plane or along a line, or exactly so."""
    structure = _spread(rng, n, m)
    for row in rng.permutation(n)[: rng.integers(1, n + 1) if n > 1 else 0]:
        structure[row] *= 0.0 if rng.random() < 0.25 else 2.0 ** -rng.integers(4, ROW_POWERS)
    return structure


def _parallel(rng: np.random.Generator, n: int, m: int) -> Floats:
    """Cables along one another, or opposed, or off by a hair."""
    structure = _spread(rng, n, m)
    for column in range(1, m):
        if rng.random() < 0.5:
            structure[:, column] = rng.choice((-1.0, 1.0)) * structure[:, rng.integers(column)]
            if rng.random() < 0.5:
                structure[rng.integers(n), column] += GRID * rng.integers(-4, 5)
    return structure


def _integer(rng: np.random.Generator, n: int, m: int) -> Floats:
    return rng.integers(-3, 4, (n, m)).astype(float)


def _scaled(rng: np.random.Generator, n: int, m: int) -> Floats:
    """Whole rigs from 1e-9 to 1e9, or rows of very different size."""
    powers = rng.integers(-30, 31, 1) if rng.random() < 0.7 else rng.integers(-15, 16, n)
    return _spread(rng, n, m) * 2.0 ** powers[:, None]


def _turned(rng: np.random.Generator, n: int, m: int) -> Floats:
    """Draw a nearly flat rig whose plane is no coordinate plane: ``W t`` is rounded."""
    return np.asarray(np.linalg.qr(rng.normal(size=(n, n)))[0] @ _flat(rng, n, m))


GEOMETRIES: dict[str, Draw] = {
    "spread": _spread,
    "flat": _flat,
    "parallel": _parallel,
    "integer": _integer,
    "scaled": _scaled,
    "turned": _turned,
}


def _limits(rng: np.random.Generator, m: int) -> tuple[Floats, Floats]:
    kind = rng.random()
    lower = np.full(m, rng.choice((0.0, 0.0, 0.5, 1.0)))
    upper = np.full(m, rng.choice((6.0, 10.0)))
    if kind < 0.2:
        lower, upper = rng.integers(0, 3, m).astype(float), rng.integers(3, 9, m).astype(float)
    elif kind < 0.4:  # some without play, some strong
        pinned = rng.random(m) < 0.3
        upper = np.where(pinned, lower, np.where(rng.random(m) < 0.2, 186.0, upper))
    elif kind < 0.6:
        power = 2.0 ** rng.integers(-30, 31)
        lower, upper = lower * power, upper * power
    return lower, upper


def _tensions(rng: np.random.Generator, lower: Floats, upper: Floats) -> Floats:
    """Tensions at a corner, on an edge or a face of their limits, or between them."""
    m = len(lower)
    inside = lower + (upper - lower) * rng.integers(0, 257, m) / 256
    free = rng.permutation(m) < rng.choice((0, 0, 1, 2, m))
    return np.where(free, inside, np.where(rng.random(m) < 0.5, lower, upper))


def _moved(rng: np.random.Generator, structure: Floats, wrench: Floats) -> Floats:
    """Return the wrench, or move it, much or by a hair: longer, along a component, or where the rig is weakest."""
    kind, by = rng.random(), 10.0 ** rng.uniform(-13.0, 0.5)
    length = float(np.linalg.norm(wrench))
    if kind < 0.4:
        return wrench
    if kind < 0.55:
        return np.asarray(wrench * (1.0 + by))
    if kind < 0.6:
        return np.asarray(wrench * 10.0 ** rng.uniform(0.0, 9.0))
    if kind < 0.75:
        return np.asarray(wrench + by * max(1.0, length) * np.eye(len(wrench))[rng.integers(len(wrench))])
    if kind < 0.9:
        return np.asarray(wrench + by * max(1.0, length) * np.linalg.svd(structure)[0][:, -1])
    return np.asarray(wrench + by * rng.normal(size=len(wrench)))


def hostile_problems(
    rng: np.random.Generator, n: int, m: int, count: int, policy: Policy | None = "force"
) -> tuple[Problem, Floats, NDArray[np.str_]]:
    """Draw hostile problems of one shape.

    Parameters
    ----------
    rng : Generator
    n, m, count : int
        Wrench components, cables, problems.
    policy : {"force", "tension", "direction"}
        The policy they ask for.

    Returns
    -------
    problems : Problem
    tensions : (count, m) array
        Inside the limits, in N. Where ``W t = w`` in exact arithmetic they prove the wrench feasible.
    kinds : (count,) array of str
        Keys of `GEOMETRIES`.
    """
    kinds = rng.choice(list(GEOMETRIES), count)
    structure = np.empty((count, n, m))
    wrench = np.empty((count, n))
    lower, upper, tensions = (np.empty((count, m)) for _ in range(3))
    for row, kind in enumerate(kinds):
        structure[row] = GEOMETRIES[kind](rng, n, m)
        lower[row], upper[row] = _limits(rng, m)
        tensions[row] = _tensions(rng, lower[row], upper[row])
        wrench[row] = _moved(rng, structure[row], structure[row] @ tensions[row])
    references = (np.zeros_like(lower), lower, (lower + upper) / 2)
    reference = references[rng.integers(3)]
    return Problem(structure, wrench, lower, upper, reference, np.ones(n), policy), tensions, kinds


def solve_blocks(blocks: int, seed: int) -> int:
    """Solve blocks of rigs with many wrenches at corners and on edges each; return the most iterations of one."""
    rng, most = np.random.default_rng(seed), 0
    for block in range(blocks):
        rigs, _, _ = hostile_problems(rng, *SHAPES[block % len(SHAPES)], BLOCK // VARIANTS)
        many = rigs.take(np.repeat(np.arange(len(rigs)), VARIANTS))
        share = rng.choice((0.0, 0.0, 1.0, 1.0, 0.5, 0.25), many.lower.shape)
        wrench = times(many.structure, many.lower + share * (many.upper - many.lower))
        size = 10.0 ** rng.uniform(-14.0, 0.0, (len(wrench), 1)) * (rng.random((len(wrench), 1)) < 0.7)
        off = rng.normal(size=wrench.shape) * np.maximum(1.0, np.linalg.norm(wrench, axis=1, keepdims=True))
        for policy in POLICIES:
            answer = Newton().solve(replace(many, wrench=wrench + size * off, policy=policy))
            most = max(most, int(answer.iterations.max()))
    return most
