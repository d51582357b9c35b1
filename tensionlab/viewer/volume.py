"""Workspace of a state: a metric over a box, the surface at a level, and its share of the box."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import optional_import
from tensionlab.model.pose import place_anchors
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.viewer.state import DesignState
from tensionlab.workspace.metrics import find_metric
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep.configurations import vary
from tensionlab.workspace.sweep.executors import evaluate_on_threads
from tensionlab.workspace.sweep.plan import Plan
from tensionlab.workspace.volume import node_weights, weighted_share

COARSE, FINE = 30, 80  # positions along each axis while something is dragged, and when it is released
CHUNK = 8_192  # positions that are evaluated between checks whether the result is still wanted
THIN = 0.5  # least length of an edge of the box, as a share of the longest one
FEW = 0.995  # quantile of the values that ends their range: some metrics grow without limit towards an anchor


@dataclass(frozen=True, eq=False)
class Volume:
    """Metric over a box around a rig.

    Attributes
    ----------
    axes : tuple of d arrays
        Coordinates along each axis, in m.
    values : array
        Metric at each position, one axis for each coordinate; NaN where it has no value.
    """

    axes: tuple[Floats, ...]
    values: Floats

    def share(self, level: float) -> float:
        """Return the share of the box in which the metric is above a level; NaN does not count as above."""
        return float(weighted_share(self.values > level, [node_weights(axis) for axis in self.axes]))

    @property
    def extent(self) -> tuple[float, float]:
        """Least value, and one that few exceed, of those that are finite; zeros where there is none."""
        finite = self.values[np.isfinite(self.values)]
        return (float(finite.min()), float(np.quantile(finite, FEW))) if finite.size else (0.0, 0.0)


@dataclass(frozen=True)
class Mesh:
    """Triangles in space: vertices (k, 3), in m, and faces (f, 3), seen anticlockwise from outside."""

    vertices: Floats
    faces: NDArray[np.int64]


def bounds(rig: Rig, *more: Floats) -> tuple[Floats, Floats]:
    """Return the low and high corner, (d,), in m, of a box around the anchors and the home of a rig.

    ``more`` are arrays (k, d) of points that are in it, too.

    Where all of them are nearly in a plane, as on a ceiling, the box reaches beyond it on the side of home.
    """
    points = np.concatenate([place_anchors(rig.modules, rig.anchors, rig.at_rest), rig.home[None], *more])
    low, high = points.min(axis=0), points.max(axis=0)
    missing = np.maximum(THIN * float((high - low).max()) - (high - low), 0.0)
    below = np.where(rig.home - low < high - rig.home, 1.0, np.where(rig.home - low > high - rig.home, 0.0, 0.5))
    return low - below * missing, high + (1.0 - below) * missing


def sweep(
    state: DesignState, box: tuple[Floats, Floats], resolution: int, wanted: Callable[[], bool]
) -> Volume | None:
    """Evaluate the metric of a state over a box, as `bounds` returns it; None as soon as it is no longer wanted.

    The platform is turned as it is at the hand. SweepError if the metric refuses the rig.
    """
    rig = state.rig
    axes = tuple(np.linspace(a, b, resolution) for a, b in zip(*box, strict=True))
    rotations = None if state.rotation is None else state.rotation[None]
    grid = Grid(axes[0], axes[1], axes[2] if len(axes) == 3 else None, rotations)
    plan = Plan(vary(rig), grid, (find_metric(state.metric),), rig.at_rest, CHUNK)
    plan.check(rig)
    values = np.empty(plan.shape)
    tasks = (plan.task(number) for number in range(math.prod(plan.tiles)))
    for task, found in evaluate_on_threads(tasks):
        values[task.block] = found[0]
        if not wanted():
            return None  # which closes the iterator, and with it what waits
    return Volume(axes, values.reshape((resolution,) * rig.dimension))


def surface(volume: Volume, level: float) -> Mesh | None:
    """Return the surface around all that is above a level, closed at the edges of the box; None if nothing is.

    In the plane, it is the region itself, as squares. Source: Lewiner, Lopes, Vieira and Tavares, "Efficient
    implementation of marching cubes' cases with topological guarantees", 2003, in scikit-image.
    """
    above = volume.values > level
    if not above.any():
        return None
    if volume.values.ndim == 2:
        return _squares(volume.axes, above)
    with optional_import("view", "the surface of a workspace"):
        from skimage.measure import marching_cubes
    step = np.array([axis[1] - axis[0] for axis in volume.axes])
    # What lies outside is a little below the level, so that the surface closes at the edge of the box.
    margin = 1e-6 * (np.nanmax(volume.values[np.isfinite(volume.values)]) - level) + 1e-12
    heights = np.nan_to_num(volume.values - level, nan=-margin, posinf=1e30, neginf=-margin)
    padded = np.pad(heights, 1, constant_values=-margin)
    march: Any = marching_cubes  # it has no types
    corners, faces, _, _ = march(padded, 0.0, spacing=tuple(step), gradient_direction="ascent")
    low = np.array([axis[0] for axis in volume.axes])
    high = np.array([axis[-1] for axis in volume.axes])
    return Mesh(np.clip(corners - step + low, low, high), faces.astype(np.int64))


def _squares(axes: tuple[Floats, ...], chosen: NDArray[np.bool_]) -> Mesh:
    """Return a square around each chosen point of a grid in the plane."""
    (i, j), half = np.nonzero(chosen), [0.5 * (axis[1] - axis[0]) for axis in axes]
    middle = np.column_stack([axes[0][i], axes[1][j], np.zeros(len(i))])
    ring = np.array(
        [[-half[0], -half[1], 0], [half[0], -half[1], 0], [half[0], half[1], 0], [-half[0], half[1], 0]]
    )
    corners = (middle[:, None] + ring).reshape(-1, 3)
    faces = (4 * np.arange(len(i))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return Mesh(corners, faces)
