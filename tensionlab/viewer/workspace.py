"""Workspace of a state: a metric over a box and its surface at a level, evaluated on a thread."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tensionlab.errors import TensionlabError
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.surfaces import level_surface
from tensionlab.viewer.scene import Mesh, bounds
from tensionlab.viewer.state import DesignState, ghost_state
from tensionlab.viewer.worker import Latest
from tensionlab.workspace.metrics import METRICS, metric
from tensionlab.workspace.poses import Grid, PoseList
from tensionlab.workspace.shares import node_weights, weighted_share
from tensionlab.workspace.sweep.executors import evaluate_on_threads
from tensionlab.workspace.sweep.plan import Plan, vary

COARSE, FINE = 30, 80  # positions along each axis while something is dragged, and when it is released
CHUNK = 8_192  # positions that are evaluated between checks whether the result is still wanted
RANGE_QUANTILE = 0.995  # upper end of the range of values: some metrics grow without limit towards an anchor
DEPENDS_ON = ("rig", "rotation", "metric", "ghost")  # attributes of a state that its workspace depends on


@dataclass(frozen=True, eq=False)
class Volume:
    """Metric over a box around a rig."""

    axes: tuple[Floats, ...]  # coordinates along each axis, in m
    values: Floats  # at each position, one axis for each coordinate; NaN where there is none

    def share(self, level: float) -> float:
        """Return the share of the box in which the metric is above a level; NaN does not count as above."""
        return float(weighted_share(self.values > level, [node_weights(axis) for axis in self.axes]))

    @property
    def extent(self) -> tuple[float, float]:
        """Smallest finite value, and the quantile `RANGE_QUANTILE`; zeros if no value is finite."""
        finite = self.values[np.isfinite(self.values)]
        return (float(finite.min()), float(np.quantile(finite, RANGE_QUANTILE))) if finite.size else (0.0, 0.0)


Volumes = tuple[Volume, Volume | None]  # workspace of a rig, and that of the other rig over the same box


def usable_metrics(rig: Rig) -> list[str]:
    """Return the names of the metrics with a level that a rig has all the numbers for."""
    names = []
    for name, candidate in METRICS.items():
        with suppress(TensionlabError):
            Plan(vary(rig), PoseList(rig.home[None]), (candidate,), rig.at_rest, CHUNK).check(rig)
            names += [name] if candidate.direction != "none" else []
    return names


def sweep(
    state: DesignState, box: tuple[Floats, Floats], resolution: int, wanted: Callable[[], bool]
) -> Volume | None:
    """Evaluate the metric of a state over a box; None as soon as it is no longer wanted.

    The platform is turned as it is at the hand. SweepError if the metric refuses the rig.
    """
    rig = state.rig
    axes = tuple(np.linspace(a, b, resolution) for a, b in zip(*box, strict=True))
    rotations = None if state.rotation is None else state.rotation[None]
    grid = Grid(axes[0], axes[1], axes[2] if len(axes) == 3 else None, rotations)
    plan = Plan(vary(rig), grid, (metric(state.metric),), rig.at_rest, CHUNK)
    plan.check(rig)
    values = np.empty(plan.shape)
    tasks = (plan.task(number) for number in range(math.prod(plan.tiles)))
    for task, results in evaluate_on_threads(tasks):
        values[task.block] = results[0]
        if not wanted():
            return None  # which closes the iterator, and with it the waiting tasks
    return Volume(axes, values.reshape((resolution,) * rig.dimension))


def surface(volume: Volume, level: float) -> Mesh | None:
    """Return the surface around all that is above a level; in the plane the region, as squares; None if empty."""
    if volume.values.ndim == 3:
        triangles = level_surface(volume.values, volume.axes, level)
        return None if triangles is None else Mesh(*triangles)
    above = np.argwhere(volume.values > level)
    if not len(above):
        return None
    half = [0.5 * (axis[1] - axis[0]) for axis in volume.axes]
    middle = np.column_stack([axis[index] for axis, index in zip(volume.axes, above.T, strict=True)])
    ring = middle[:, None] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = np.pad(ring.reshape(-1, 2), ((0, 0), (0, 1)))
    faces = 4 * np.arange(len(above))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(corners, faces.reshape(-1, 3))


def same_workspace(one: DesignState | None, other: DesignState | None) -> bool:
    """Return whether two states have the same workspace."""
    return None not in (one, other) and all(getattr(one, name) is getattr(other, name) for name in DEPENDS_ON)


class WorkspaceWorker:
    """Evaluates the workspace of the state that was last submitted.

    ``show`` is called with a coarse workspace, then with a fine one unless something is being dragged.
    """

    def __init__(self, show: Callable[[Volume, Volume | None], None]) -> None:
        self._show = show
        self._newest: DesignState | None = None
        self._evaluated: DesignState | None = None
        self._volumes: Volumes | None = None
        self._worker = Latest("workspace", self._work)
        self.close = self._worker.close

    def submit(self, state: DesignState, *, fine: bool) -> None:
        """Have the workspace of a state evaluated; a fine one only where ``fine``."""
        self._newest = state
        self._worker.put((state, fine))

    def _work(self, item: tuple[DesignState, bool], _: Callable[[], bool]) -> None:
        state, fine = item
        if not state.show_workspace:
            return
        if not same_workspace(self._evaluated, state):
            self._volumes = self._evaluate(state, COARSE)
            self._evaluated = None if self._volumes is None else state
        if self._volumes is None:
            return
        self._show(*self._volumes)
        if fine and len(self._volumes[0].axes[0]) < FINE and (better := self._evaluate(state, FINE)):
            self._volumes = better
            self._show(*better)

    def _evaluate(self, state: DesignState, resolution: int) -> Volumes | None:
        """Return the workspaces of a state and of the other rig; None if no longer wanted, or not defined."""
        box, other = bounds(state.rig), ghost_state(state)

        def wanted() -> bool:
            return same_workspace(self._newest, state)  # a force or a colour may have changed meanwhile

        try:
            volume = sweep(state, box, resolution, wanted)
            if volume is None:
                return None
            return volume, None if other is None else sweep(other, box, resolution, wanted)
        except TensionlabError:  # a metric that one of the rigs does not have
            return None
