"""Sweeps: metrics of rigs over configurations and poses, as one labelled dataset."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Sequence
from dataclasses import is_dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from tensionlab.errors import SweepError
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement, as_requirement
from tensionlab.model.rig import Rig
from tensionlab.workspace.metrics import Metric, make, name_of
from tensionlab.workspace.poses import Grid, PoseList
from tensionlab.workspace.sweep.dataset import empty_dataset
from tensionlab.workspace.sweep.executors import (
    BAR_DELAY_S,
    evaluate_on_cluster,
    evaluate_on_threads,
    progress_bar,
)
from tensionlab.workspace.sweep.needs import describe, estimate_seconds, require_space
from tensionlab.workspace.sweep.plan import Configurations, Plan, vary
from tensionlab.workspace.sweep.store import MemoryStore, ZarrStore

if TYPE_CHECKING:
    import xarray

CHUNK_VALUES = 65_536
"""Values of a metric in a chunk: 512 kB, so that a disk's confirmations take less time than the values."""


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
    progress: bool = True,
) -> xarray.Dataset:
    """Evaluate metrics of every configuration at every pose.

    If it takes more than two seconds, a line says how many values there are, how long they take and how much disk
    at most, and a bar on the terminal how far it is.

    Parameters
    ----------
    rigs : Rig, sequence of Rig, or Configurations
        Rigs with names that differ, or what `tensionlab.workspace.vary` returns.
    poses : Grid, PoseList or (k, d) array
        From `tensionlab.workspace`: `Grid`, `box`, `polyline`, `read_poses`; or positions in m.
    metrics : str, Metric, or sequence of them
        Names in `tensionlab.workspace.METRICS`, such as "capacity-margin" or "reachable-share:2.0", or instances.
    frames : mapping of name to Frame or (position, rotation), optional
        Where the body frames of the rigs are: one pose for each, the same all over the sweep.
    required : Requirement, (n,) array, (k, n) array or None
        What the cables must exert at every pose: a wrench, the vertices of a set, or a `tensionlab.Requirement`,
        which holds the weight as well if it says so. None is `Rig.required` of each rig.
    out : path, optional
        A folder, by custom called DIR.zarr, to which chunks are written as they are finished. A sweep that was
        killed goes on where it was when it is called again, and a finished one is only opened. Without it, the
        sweep is kept in memory.
    scheduler : str, optional
        Address of a Dask scheduler, as in "tcp://host:8786", whose workers evaluate the chunks; else the
        processors of this machine do.
    chunk : int
        Values of a metric in a chunk, at most. A store goes on with the chunks that it was begun with.
    progress : bool
        False for no line and no bar.

    Returns
    -------
    xarray.Dataset
        A variable for each metric, called as it was given, with the axes of the configurations, then those of the
        poses. NaN where a cable has no length, or a metric has no value. Every variable has ``units`` and
        ``long_name``. The coordinates ``anchor``, ``attachment``, ``lower`` and ``upper`` are the rigs themselves;
        ``required`` says in words what the cables must exert, ``characteristic_length`` at which arm a torque
        counts as a force. Among the attributes is the ``manifest``, as JSON: the call, versions, commit and
        processor.

    Raises
    ------
    SweepError, RigError, ShapeError, InputError
        Before any work: rigs, poses and metrics that do not fit, a place to write to that holds something else,
        a sweep too large for memory or disk, a scheduler that does not answer.
    MissingDependency
        If xarray or zarr (extra ``workspace``), or distributed (extra ``cluster``) is not installed.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = tl.workspace.box([-0.2, 0.2], 0.3, [-0.2, 0.2], step=0.1)
    >>> swept = tl.sweep(rig, poses, ["capacity-margin", "tension-factor"], progress=False)
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
        metrics=_by_name(metrics),
        frames={} if frames is None else frames,
        chunk=chunk,
        required=None if required is None else as_requirement(required),
    )
    if out is not None:
        require_space(plan, Path(out))
    empty = empty_dataset(plan)
    store = MemoryStore(plan, empty) if out is None else ZarrStore(Path(out), plan, empty)
    with contextlib.closing(store):
        count = math.prod(plan.tiles)
        missing = [number for number in range(count) if number not in store.finished]
        if missing:
            total, ahead = math.prod(plan.shape), sum(plan.size(number) for number in missing)
            tasks = (plan.task(number) for number in missing)
            if progress:
                seconds = estimate_seconds(plan) * ahead / total if scheduler is None else None
                if seconds is None or seconds > BAR_DELAY_S:
                    print(f"sweep: {describe(plan, seconds)}", file=sys.stderr)
            results = evaluate_on_threads(tasks) if scheduler is None else evaluate_on_cluster(scheduler, tasks)
            written = count - len(missing)
            try:
                with progress_bar(total, total - ahead, progress) as advance:
                    for task, values in results:
                        store.write(task, values)
                        written += 1
                        advance(plan.size(task.number))
            except KeyboardInterrupt:
                if out is None:
                    raise
                raise KeyboardInterrupt(f"{written:,} of {count:,} chunks are written") from None
        return store.dataset()


def _by_name(metrics: str | Metric | Sequence[str | Metric]) -> dict[str, Metric]:
    """Return the metrics by the names that their variables get."""
    listed = [metrics] if isinstance(metrics, str) or not isinstance(metrics, Sequence) else metrics
    found: dict[str, Metric] = {}
    for each in listed:
        if not isinstance(each, str) and (isinstance(each, type) or not is_dataclass(each)):
            raise SweepError(f"{each!r} is no metric; give names in METRICS, or instances of metrics")
        name, metric = (each, make(each)) if isinstance(each, str) else (name_of(each), each)
        if name in found:
            raise SweepError(f"metric {name!r} is there twice; give it once")
        found[name] = metric
    if not found:
        raise SweepError("no metric is named; give one at least, such as 'capacity-margin'")
    return found
