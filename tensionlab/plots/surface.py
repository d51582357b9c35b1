"""Where is a value above a level? The surface around that part of a grid, as triangles."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from tensionlab.arrays import Floats


def level_surface(values: Floats, axes: tuple[Floats, Floats, Floats], level: float) -> Floats:
    """Which triangles lie around all that is above the level?

    Each cell of the grid is cut into six tetrahedra, and each of those by a plane where its corners lie on
    different sides of the level. The grid is taken to be below the level outside its borders, so that the
    surface is closed.

    Source: Doi and Koide, "An efficient method of triangulating equi-valued surfaces by using tetrahedral
    cells", 1991.

    Parameters
    ----------
    values : (a, b, c) array
        On the grid; NaN counts as below the level.
    axes : arrays of length a, b and c
        Coordinates, in m.
    level : float

    Returns
    -------
    (k, 3, 3) array
        Corners of the triangles, in m.
    """
    low = level - 1e-3 * (np.nanmax(values, initial=level) - level) - 1e-12
    padded = np.pad(np.where(np.isfinite(values), values, low), 1, constant_values=low) - level
    # Just outside the border, so that the surface closes there.
    coordinates = [np.concatenate([axis[:1], axis, axis[-1:]]) for axis in axes]
    steps = np.array([[(np.arange(3) < k)[list(order)] for k in range(4)] for order in permutations(range(3))])
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in padded.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    tetrahedra = (cells[:, None, None, :] + steps.astype(int)).reshape(-1, 4, 3)
    above = padded[tuple(np.moveaxis(tetrahedra, -1, 0))]
    inside = (above > 0).sum(axis=1)
    found = []
    for count, ring in (
        (1, [(0, 1), (0, 2), (0, 3)]),
        (2, [(0, 2), (0, 3), (1, 3), (1, 2)]),
        (3, [(0, 3), (1, 3), (2, 3)]),
    ):
        chosen = inside == count
        order = np.argsort(-above[chosen], axis=1)
        height = np.take_along_axis(above[chosen], order, axis=1)
        index = np.take_along_axis(tetrahedra[chosen], order[..., None], axis=1)
        points = np.stack([axis[index[..., i]] for i, axis in enumerate(coordinates)], axis=-1)
        share = {(i, j): height[:, i] / (height[:, i] - height[:, j]) for i, j in ring}
        corners = [points[:, i] + share[i, j][:, None] * (points[:, j] - points[:, i]) for i, j in ring]
        found.append(np.stack(corners[:3], axis=1))
        if count == 2:
            found.append(np.stack([corners[0], corners[2], corners[3]], axis=1))
    return np.concatenate(found)
