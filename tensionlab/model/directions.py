"""Sets of directions, unit vectors, that an experiment commands one after another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.support.arrays import Floats, pad_last_axis
from tensionlab.support.files.tables import read_table

MAX_DIRECTIONS = 10_000_000
CIRCLE_COUNT = 72  # directions of the planar default: one every 5 degrees


def grid18() -> Floats:
    """Return the 182 directions of the published validation.

    A latitude and longitude grid of 18 degrees: 9 rings of 20 vectors and the 2 poles, which lie on Y (up).
    The paper gives the count alone, so that the grid is this one is an inference: no subdivided icosahedron,
    cube or octahedron has 182 vertices. 42 of the 182 lie within 18 degrees of a pole. Unit vectors, (182, 3): the
    upper pole, the rings from the top down, the lower pole.
    """
    polar = np.radians(18.0 * np.arange(1, 10))[:, None]
    azimuth = np.radians(18.0 * np.arange(20))[None, :]
    height = np.broadcast_to(np.cos(polar), (9, 20))
    rings = np.stack([np.sin(polar) * np.cos(azimuth), height, np.sin(polar) * np.sin(azimuth)], axis=-1)
    up = np.array([[0.0, 1.0, 0.0]])
    return np.concatenate([up, rings.reshape(-1, 3), -up])


def fibonacci(count: int) -> Floats:
    """Return `count` directions, (count, 3), that cover the sphere about evenly, from the top down.

    The golden-angle spiral around Y (González 2010, "Measurement of areas on a sphere using Fibonacci and
    latitude-longitude lattices", with points in the middle of equal-area bands), so that plain means over it
    are means over the sphere.
    """
    _require_positive(count)
    index = np.arange(count)
    height = 1.0 - (2.0 * index + 1.0) / count
    radius = np.sqrt(1.0 - height**2)
    azimuth = np.pi * (3.0 - np.sqrt(5.0)) * index
    return np.stack([radius * np.cos(azimuth), height, radius * np.sin(azimuth)], axis=-1)


def circle(count: int = CIRCLE_COUNT) -> Floats:
    """Return `count` directions, (count, 2), that cover the plane evenly, from the first axis to the second."""
    _require_positive(count)
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _require_positive(count: int) -> None:
    if not 1 <= count <= MAX_DIRECTIONS:
        raise InputError(f"a set of directions has 1 to {MAX_DIRECTIONS:,} vectors; got {count}")


def read_csv(path: str | Path) -> Floats:
    """Read directions from a table with columns x, y, z, in the plane x, y, as unit vectors (K, 3) or (K, 2).

    The lengths of rows do not matter. DataError names the file and the row if one has no direction.
    """
    columns = read_table(path, ["x", "y"], ["z"], error=DataError, what="a list of directions (*.csv)")
    vectors = np.stack([columns[name] for name in "xyz" if name in columns], axis=1)
    if (none := ~vectors.any(axis=1)).any():
        raise DataError(f"{path}: direction {none.argmax() + 1} is 0 along all axes; leave it out")
    # Scaled by the largest entry first, so that tiny and huge rows neither vanish nor overflow.
    vectors /= np.abs(vectors).max(axis=1, keepdims=True)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors


def parse(text: str) -> Floats:
    """Return the directions that the text of ``--directions`` means.

    ``grid18``, ``fibonacci:N``, ``circle:N`` (planar rigs) or the path of a ``.csv`` file.
    """
    if text == "grid18":
        return grid18()
    name, _, count = text.partition(":")
    if name in ("fibonacci", "circle") and count.isdecimal():
        return fibonacci(int(count)) if name == "fibonacci" else circle(int(count))
    if text.lower().endswith(".csv"):
        return read_csv(text)
    raise InputError(f"directions {text!r}: write grid18, fibonacci:N, circle:N or the path of a .csv file")


def forces(vectors: Floats, components: int, dimension: int) -> Floats:
    """Return forces, (K, dimension), in N, as wrenches without torque, (K, components)."""
    if vectors.ndim != 2 or vectors.shape[1] != dimension:
        wanted = "x,y,z; try grid18 or fibonacci:N" if dimension == 3 else "two components; try circle:N"
        raise ShapeError(f"the rig needs directions of {wanted} (they have shape {vectors.shape})")
    return pad_last_axis(vectors, components)
