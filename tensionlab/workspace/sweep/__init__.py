"""Sweeps: metrics of rigs over configurations and poses, as one labelled dataset."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from tensionlab.errors import SweepError
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement, as_requirement
from tensionlab.model.rig import Rig
from tensionlab.workspace.metrics import Metric, metric
from tensionlab.workspace.poses import Grid, PoseList
from tensionlab.workspace.sweep.dataset import empty_dataset
from tensionlab.workspace.sweep.executors import evaluate_on_cluster, evaluate_on_threads
from tensionlab.workspace.sweep.plan import Configurations, Plan, vary
from tensionlab.workspace.sweep.store import MemoryStore, ZarrStore

if TYPE_CHECKING:
    import xarray

CHUNK_VALUES = 65_536  # values of a metric in a chunk: 512 kB, so that writing takes less time than evaluating


def sweep(
    rigs: Rig | Sequence[Rig] | Configurations,
    poses: Grid | PoseList | ArrayLike,
    metrics: str | Metric | Sequence[str | Metric],
    *,
    frames: Frames | None = None,
    required: Requirement | ArrayLike | None = None,
    out: str | PathLike[str] | None = None,
    scheduler: str | None = None,
    chunk: int = CHUNK_VALUES,
    progress: Callable[[float], None] | None = None,
) -> xarray.Dataset:
    """Evaluate metrics of every configuration at every pose.

    Parameters
    ----------
    rigs : Rig, sequence of Rig, or Configurations
        Rigs with names that differ, or what `tensionlab.workspace.vary` returns.
    poses : Grid, PoseList or (k, d) array
        From `tensionlab.workspace`: `Grid`, `box`, `read_poses`; or positions in m.
    metrics : str, Metric, or sequence of them
        Metrics, or their names, as in `tensionlab.workspace.metric`.
    frames : mapping of name to Frame or (position, rotation), optional
        Poses of the rigs' body frames: one for each, the same throughout the sweep.
    required : Requirement, (n,) array, (k, n) array or None
        What the cables must exert at every pose: a wrench, the vertices of a set, or a `tensionlab.Requirement`.
        None is `Rig.required` of each rig.
    out : path or URL, optional
        Zarr store, DIR.zarr, to which chunks are written as they are finished. Called again, an interrupted sweep
        is resumed, and a finished one is only opened. Without it, the sweep is kept in memory. At a URL that
        fsspec knows, as in "s3://bucket/sweep.zarr", whoever evaluates a chunk writes it.
    scheduler : str, optional
        Address of a Dask scheduler, as in "tcp://host:8786"; else the processors of this machine do the work.
    chunk : int
        Largest number of values of a metric in a chunk.
    progress : callable, optional
        Called with the share of the chunks that are finished, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        A variable for each metric, named after it, with the axes of the configurations, then those of the poses.
        NaN where a cable has no length, or a metric has no value. Every variable has ``units`` and ``long_name``.
        Coordinates describe the rigs, and what is required of them. Among the attributes is the ``manifest``, as
        JSON: the call, versions, commit and processor.

    Raises
    ------
    SweepError, RigError, ShapeError, InputError
        Before any work: rigs, poses and metrics that do not fit, a folder that holds something else, a sweep too
        large for memory, a scheduler that does not answer.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = tl.workspace.box([-0.2, 0.2], 0.3, [-0.2, 0.2], step=0.1)
    >>> swept = tl.sweep(rig, poses, ["capacity-margin", "tension-factor"])
    >>> dict(swept["capacity-margin"].sizes)
    {'rig': 1, 'x': 5, 'y': 1, 'z': 5}
    >>> print(f'{float(swept["capacity-margin"].max()):.3f} {swept["capacity-margin"].units}')
    3.681 N
    """
    if not (isinstance(chunk, int) and chunk >= 1):
        raise SweepError(f"chunk is {chunk!r}; give a number of values, 1 or more")
    plan = Plan(
        configurations=rigs if isinstance(rigs, Configurations) else vary(rigs),
        poses=poses if isinstance(poses, (Grid, PoseList)) else PoseList(poses),  # type: ignore[arg-type]
        metrics=tuple(map(metric, [metrics] if isinstance(metrics, (str, Metric)) else metrics)),
        frames={} if frames is None else frames,
        chunk=chunk,
        required=None if required is None else as_requirement(required),
    )
    if not plan.metrics:
        raise SweepError("no metric is named; give one at least, such as 'capacity-margin'")
    empty = empty_dataset(plan)
    store = MemoryStore(plan, empty) if out is None else ZarrStore(out, plan, empty)
    with contextlib.closing(store):
        if store.missing:
            tasks = map(store.task, store.missing)
            results = evaluate_on_threads(tasks) if scheduler is None else evaluate_on_cluster(scheduler, tasks)
            total = math.prod(plan.tiles)
            for finished, (task, values) in enumerate(results, start=total - len(store.missing) + 1):
                store.write(task, values)
                if progress is not None:
                    progress(finished / total)
        return store.dataset()
