"""Random rigs: cables from everywhere to a point or a platform, and rigs that are nearly singular."""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

from tensionlab.arrays import Floats

ARM = 0.3
"""Standard deviation of the coordinates of a platform's attachments, in m."""
ROUNDS = 6
"""Corrections of a nearly singular rig, after which its condition is right ..."""
ACCURACY = 1e-3
"""... to this share, or the rig is drawn again."""


def unit(rng: np.random.Generator, *shape: int) -> Floats:
    """Draw directions spread evenly over the sphere; the last axis holds the components."""
    vectors = rng.normal(size=shape)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def structures(rng: np.random.Generator, n: int, m: int, count: int) -> Floats:
    """What are the structure matrices of random rigs?

    Parameters
    ----------
    rng : Generator
    n : {3, 6}
        3: a point; 6: a platform with attachments spread normally about its reference point.
    m, count : int
        Cables of each rig, and rigs.

    Returns
    -------
    (count, n, m) array
        Columns [u] or [u; r x u]; the directions u are spread evenly over the sphere.
    """
    directions = unit(rng, count, m, 3)
    return _columns(directions, None if n == 3 else rng.normal(scale=ARM, size=(count, m, 3)))


class Stream(NamedTuple):
    """Where the random numbers of a group of rigs come from, and its shape.

    Attributes
    ----------
    rng : Generator
    n, m, size : int
        Wrench components and cables of each rig, and rigs.
    """

    rng: np.random.Generator
    n: int
    m: int
    size: int

    def rigs(self) -> Floats:
        """Draw structure matrices, (size, n, m)."""
        return structures(self.rng, self.n, self.m, self.size)

    def between(self, ends: tuple[float, float]) -> Floats:
        """Draw numbers spread evenly over the orders of magnitude between two ends, (size,)."""
        return np.asarray(np.exp(self.rng.uniform(np.log(ends[0]), np.log(ends[1]), self.size)))


def streams(name: str, shapes: list[tuple[int, int]], count: int, seed: int) -> list[Stream]:
    """Which random numbers do the groups of a problem set draw from?

    Each has a generator of its own, so that another count or shape in one does not change another.

    Parameters
    ----------
    name : str
        Of the set; sets with the same seed have nothing in common.
    shapes : list of (int, int)
        Wrench components and cables of each group.
    count, seed : int
        The count is spread evenly over the groups, at least one in each.

    Returns
    -------
    list of Stream
    """
    sizes = [max(1, (count + i) // len(shapes)) for i in reversed(range(len(shapes)))]
    return [
        Stream(np.random.default_rng([zlib.crc32(name.encode()), seed, i]), n, m, size)
        for i, ((n, m), size) in enumerate(zip(shapes, sizes, strict=True))
    ]


def near_singular(rng: np.random.Generator, n: int, m: int, condition: Floats) -> Floats:
    """What are the structure matrices of random rigs that are nearly singular?

    A point rig (n = 3) is nearly singular because its cables are nearly in the plane z = 0, a platform (n = 6)
    because it is small.

    Parameters
    ----------
    rng : Generator
    n : {3, 6}
    m : int
        Cables of each rig, n or more.
    condition : (B,) array
        Largest over smallest singular value of each matrix, 100 or more.

    Returns
    -------
    (B, n, m) array
    """
    matrices = np.empty((len(condition), n, m))
    left = np.arange(len(condition))
    while left.size:
        matrices[left] = _squeezed(rng, n, m, condition[left])
        # A draw that is singular for another reason as well may miss its condition.
        left = left[np.abs(np.linalg.cond(matrices[left]) / condition[left] - 1.0) > ACCURACY]
    return matrices


def _squeezed(rng: np.random.Generator, n: int, m: int, condition: Floats) -> Floats:
    """Rigs so flat, or so small, that most have the condition: it goes with one over that size."""
    directions = unit(rng, len(condition), m, 3)
    arms = None if n == 3 else rng.normal(size=(len(condition), m, 3))
    size = 1.0 / condition
    for _ in range(ROUNDS):
        scale = size[:, None, None]
        matrices = _columns(_flat(directions, scale), None) if arms is None else _columns(directions, scale * arms)
        size = np.minimum(1.0, size * np.linalg.cond(matrices) / condition)
    return matrices


def _flat(directions: Floats, height: Floats) -> Floats:
    squeezed = directions * np.concatenate([np.ones_like(height), np.ones_like(height), height], axis=-1)
    return np.asarray(squeezed / np.linalg.norm(squeezed, axis=-1, keepdims=True))


def _columns(directions: Floats, arms: Floats | None) -> Floats:
    """Structure matrices (B, n, m) of cables that pull at the arms r in the directions u, both (B, m, 3)."""
    columns = directions if arms is None else np.concatenate([directions, np.cross(arms, directions)], axis=-1)
    return np.ascontiguousarray(np.swapaxes(columns, 1, 2))
