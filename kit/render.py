"""Pictures of solids: parallel projection, shaded by direction, with a dark line at every edge and outline."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from build123d.topology import Part

Array = np.ndarray[Any, np.dtype[np.float64]]
LIGHT = np.array([0.25, 0.45, 0.86])  # towards the light, in axes of the picture: right, up, towards the eye
OVERSAMPLING = 2


def triangles(part: Part, tolerance: float = 0.05) -> Array:
    """Return the surface of a part as triangles, (count, 3, 3) in mm, counter-clockwise from outside."""
    vertices, faces = part.tessellate(tolerance, 0.12)
    points = np.array([tuple(vertex) for vertex in vertices])
    return np.asarray(points[np.array(faces)], dtype=np.float64)


def camera(azimuth: float, elevation: float) -> Array:
    """Return the axes of a picture as rows, right, up and towards the eye, for an eye at two angles in degrees."""
    a, e = math.radians(azimuth), math.radians(elevation)
    return np.array([
        [-math.sin(a), math.cos(a), 0.0],
        [-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e)],
        [math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)],
    ])  # fmt: skip


def rasterise(corners: Array, depth: Array, index: Array, mark: int) -> None:
    """Draw a triangle, in pixels and depth towards the eye, where it is before all others."""
    height, width = depth.shape
    left, low = np.maximum(np.floor(corners[:, :2].min(axis=0)).astype(int), 0)
    right, high = np.minimum(np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1, (width, height))
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area <= 1e-9 or left >= right or low >= high:  # from behind, or no pixel
        return
    x, y = np.arange(left, right)[None, :] + 0.5, np.arange(low, high)[:, None] + 0.5
    v = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
    w = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
    z = az + v * (bz - az) + w * (cz - az)
    window = np.s_[low:high, left:right]
    seen = (v >= 0) & (w >= 0) & (v + w <= 1) & (z > depth[window])
    depth[window][seen] = z[seen]
    index[window][seen] = mark


def picture(
    parts: Iterable[tuple[Part, str]], azimuth: float, elevation: float, size: Sequence[int] = (480, 400)
) -> Array:
    """Return a picture of parts in their colours (#rrggbb), (height, width, 3) from 0 to 1."""
    meshes = [(triangles(part), colour) for part, colour in parts]
    axes = camera(azimuth, elevation)
    seen = [mesh @ axes.T for mesh, _ in meshes]
    everything = np.concatenate(seen).reshape(-1, 3)
    low, high = everything.min(axis=0), everything.max(axis=0)
    pixels = np.array(size) * OVERSAMPLING
    scale = 0.94 * float((pixels / (high - low)[:2]).min())
    depth = np.full(pixels[::-1], -np.inf)
    index = np.full(pixels[::-1], -1.0)
    normals: list[Array] = []
    colours: list[list[float]] = []
    for mesh, (_, colour) in zip(seen, meshes, strict=True):
        for triangle in mesh:
            corners = triangle.copy()
            corners[:, :2] = (triangle[:, :2] - (low + high)[:2] / 2) * scale + pixels / 2
            normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
            rasterise(corners, depth, index, len(normals))
            normals.append(normal / max(float(np.linalg.norm(normal)), 1e-12))
            colours.append([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    return shaded(depth, index.astype(int), np.array(normals), np.array(colours))


def shaded(depth: Array, index: Any, normals: Array, colours: Array) -> Array:
    """Return the colours of pixels from the triangles that they show, averaged over the oversampling."""
    light = 0.45 + 0.55 * np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
    image = np.where((index < 0)[..., None], 1.0, (colours * light[:, None])[index])
    facing = np.where((index < 0)[..., None], 0.0, normals[index])
    far = np.where(index < 0, -1e3, depth)
    edge = np.zeros(index.shape, dtype=bool)
    for axis in (0, 1):
        step = np.roll(far, 1, axis) - far
        turn = (np.roll(facing, 1, axis) * facing).sum(axis=-1)
        edge |= (np.abs(step) > 1.5) | ((turn < 0.85) & (index >= 0))
    image[edge] *= 0.35
    height, width = index.shape
    blocks = image.reshape(height // OVERSAMPLING, OVERSAMPLING, width // OVERSAMPLING, OVERSAMPLING, 3)
    return np.asarray(blocks.mean(axis=(1, 3))[::-1])
