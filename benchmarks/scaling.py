"""Sweep and proof on 1, 2, 4, ... workers of Dask, and what 10¹² poses would cost on a cluster.

`python -m benchmarks.scaling` starts as many workers as this machine has processors, at most 16, each with one
thread. Then it measures the parts of a chunk's cost, and extrapolates.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tensionlab.benchmark.speed import seconds
from tensionlab.model.files import load_rig
from tensionlab.support.arrays import Floats
from tensionlab.support.operating_system import KERNEL_THREADS, processor_name
from tensionlab.workspace import Grid, certify, metric, vary
from tensionlab.workspace.certification import WRENCH_CLOSURE
from tensionlab.workspace.sweep import CHUNK_VALUES, sweep
from tensionlab.workspace.sweep.dataset import empty_dataset
from tensionlab.workspace.sweep.executors import evaluate_on_cluster
from tensionlab.workspace.sweep.plan import Plan
from tensionlab.workspace.sweep.store import ZarrStore

POSES = 10**12
CLUSTERS = (2, 16, 128, 1024)  # workers of the extrapolation
TASKS = 400  # that measure the scheduler
DISK_BYTES_S = 200e6  # of a disk that all values pass through: assumed, not measured
RIG, METRIC, GRID, RESOLUTION_M = load_rig("ipanema-1"), "capacity-margin", (128, 128, 64), 0.0125
PARTS = ("processors", "scheduler", "caller", "disk")
REGION = np.stack([0.9 * RIG.anchors.min(axis=0), 0.9 * RIG.anchors.max(axis=0)], axis=1)
GRID_POSES = Grid(*(np.linspace(low, high, count) for (low, high), count in zip(REGION, GRID, strict=True)))


class Idle(NamedTuple):
    """Task that does nothing but return some values."""

    values: int

    def evaluate(self) -> Floats:
        """Return them."""
        return np.zeros(self.values)


def processor_seconds(work: Callable[[], object]) -> float:
    """Return the processor time that it takes, in s."""
    began = time.process_time()
    work()
    return time.process_time() - began


@contextmanager
def cluster(workers: int, threads: int = 1) -> Iterator[str]:
    """Start workers, each a process; gives the address of their scheduler."""
    from distributed import Client, LocalCluster

    local = LocalCluster(n_workers=workers, threads_per_worker=threads, dashboard_address=None)
    with local as started, Client(started) as client:
        client.run(lambda: __import__("tensionlab.workspace"))
        yield started.scheduler_address


def scale(counts: list[int]) -> None:
    """Print times and efficiencies on each number of workers."""
    alone = np.full(2, np.nan)
    print("workers   sweep, s  efficiency   certify, s  efficiency")
    for workers in counts:
        with cluster(workers) as address, tempfile.TemporaryDirectory() as folder:
            swept = seconds(partial(sweep, RIG, GRID_POSES, METRIC, scheduler=address, out=f"{folder}/a.zarr"))
            proved = seconds(partial(certify, RIG, REGION, WRENCH_CLOSURE, RESOLUTION_M, scheduler=address))
        alone = np.array([swept, proved]) if workers == 1 else alone
        share = alone / [swept, proved] / workers
        print(f"{workers:7} {swept:10.1f} {share[0]:11.0%} {proved:12.1f} {share[1]:11.0%}")


def costs_of_poses(chunks: int) -> Floats:
    """Return the processor time to evaluate and to write a pose, in s, and its bytes on disk."""
    plan = Plan(vary(RIG), GRID_POSES, (metric(METRIC),), {}, CHUNK_VALUES)
    spent, values = np.zeros(2), 0
    with tempfile.TemporaryDirectory() as folder:
        store = ZarrStore(f"{folder}/sweep.zarr", plan, empty_dataset(plan))
        for task in map(plan.task, range(chunks)):
            part = task.evaluate()
            write = partial(store.write, task, part)
            spent += [processor_seconds(task.evaluate), processor_seconds(write)]
            values += part.size
        store.close()
        files = Path(folder, "sweep.zarr", METRIC, "c").rglob("*")
        size = sum(file.stat().st_size for file in files if file.is_file())
    return np.array([*spent, size]) / values


def extrapolate(costs: Floats, by_workers: float, by_caller: float) -> None:
    """Print the hours of 10¹² poses that each part alone would take, and which is longest."""
    (evaluate, write, size), chunks = costs, POSES / CHUNK_VALUES
    print(f"a pose: {1e6 * evaluate:.2f} µs to evaluate, {1e6 * write:.3f} µs and {size:.2f} bytes to write")
    print(f"chunks of {CHUNK_VALUES:,} poses a second: {by_workers:.0f} if workers write, {by_caller:.0f} if not")
    print(f"10¹² poses: {POSES * size / 1e12:.1f} TB in {chunks:,.0f} files")
    print("workers" + "".join(f"{part + ' h':>13}" for part in PARTS) + "   limit       least chunk")
    for workers in CLUSTERS:
        parts = POSES * (evaluate + write) / workers, chunks / by_workers, chunks / by_caller
        hours = np.array([*parts, POSES * size / DISK_BYTES_S]) / 3600
        cells, chunk = "".join(f"{value:13,.1f}" for value in hours), workers / by_workers / (evaluate + write)
        print(f"{workers:7}{cells}   {PARTS[np.argmax(hours)]:12}{chunk:12,.0f}")


def main() -> None:
    """Print the tables."""
    os.environ[KERNEL_THREADS] = "1"  # of each worker, so that a worker is a processor
    cores = os.cpu_count() or 1
    print(f"{processor_name()}, {cores} processors, load {os.getloadavg()[0]:.1f}")
    scale([count for count in (1, 2, 4, 8, 16) if count <= cores])
    with cluster(1, 32) as address:
        few, all_values = (map(Idle, [values] * TASKS) for values in (1, CHUNK_VALUES))
        rates = [TASKS / seconds(lambda: list(evaluate_on_cluster(address, each))) for each in (few, all_values)]  # noqa: B023
    extrapolate(costs_of_poses(chunks=8), *rates)


if __name__ == "__main__":
    main()
