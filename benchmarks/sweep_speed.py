"""Speed of sweeps: the kernel alone, in memory, to disk, and through a Dask scheduler of this machine.

``python -m benchmarks.sweep_speed`` prints poses a second of the capacity margin, and, from the times of a chunk,
how long 10⁹ poses would take on a cluster. ``--workers`` are the processes of Dask.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tensionlab.benchmark.speed import describe_kernels
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.workspace import Grid, capacity_margin, metric, vary
from tensionlab.workspace.sweep import CHUNK_VALUES, sweep
from tensionlab.workspace.sweep.dataset import empty_dataset
from tensionlab.workspace.sweep.plan import Plan
from tensionlab.workspace.sweep.store import ZarrStore

RIGS = ("bartels2026-validation", "ipanema-1")
KERNEL_POSES = 2048  # of one call of the kernel alone: their structure matrices stay in the cache
EDGE_M = 0.01  # between the anchors' box and the poses
LARGE = 10**9  # poses of a sweep that is worth a cluster
CLUSTER_WORKERS = (4, 16, 64)


def grid(rig: Rig, poses: int) -> Grid:
    """Return that many poses, and a few more, in the box of the anchors."""
    low, high = rig.anchors.min(axis=0) + EDGE_M, rig.anchors.max(axis=0) - EDGE_M
    count = int(np.ceil(poses ** (1 / rig.dimension)))
    return Grid(*(np.linspace(a, b, count) for a, b in zip(low, high, strict=True)))


def seconds(work: Callable[[], object], rounds: int) -> float:
    """Return the least time of some rounds."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def kernel_rate(rig: Rig, poses: Grid, rounds: int) -> float:
    """Return poses a second of one processor, structure matrices made and checked before."""
    position, _ = poses.arrays()
    structure = rig.structure_matrix(position[:: max(1, len(position) // KERNEL_POSES)][:KERNEL_POSES])
    return len(structure) / seconds(lambda: capacity_margin(structure, rig.limits), 20 * rounds)


def write_seconds(rig: Rig, poses: Grid, chunks: int) -> float:
    """Return the mean time to write a chunk to disk, in s."""
    plan = Plan(vary(rig), poses, (metric("capacity-margin"),), {}, CHUNK_VALUES)
    spent, chunks = 0.0, min(chunks, math.prod(plan.tiles))
    with tempfile.TemporaryDirectory() as folder:
        store = ZarrStore(Path(folder) / "sweep.zarr", plan, empty_dataset(plan))
        with contextlib.closing(store):
            for task in map(plan.task, range(chunks)):
                values = task.evaluate()
                start = time.perf_counter()
                store.write(task, values)
                spent += time.perf_counter() - start
    return spent / chunks


def cluster_rate(rig: Rig, poses: Grid, workers: int) -> float:
    """Return poses a second through a Dask scheduler with a number of workers on this machine, to disk."""
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
        tempfile.TemporaryDirectory() as folder,
    ):
        client.run(lambda: __import__("tensionlab.workspace.sweep"))
        address = cluster.scheduler_address
        start = time.perf_counter()
        sweep(rig, poses, "capacity-margin", scheduler=address, out=Path(folder) / "sweep.zarr")
        return len(poses.arrays()[0]) / (time.perf_counter() - start)


def main() -> None:
    """Print the table, and the plan of a large sweep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=4_000_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    print(f"{describe_kernels()}; chunks of {CHUNK_VALUES:,} poses")
    print("Million poses a second   kernel, 1 core   in memory   to disk   Dask, to disk")
    for name in RIGS:
        rig = load_rig(name)
        poses = grid(rig, options.poses)
        count = len(poses.arrays()[0])
        kernel = kernel_rate(rig, poses, options.rounds)
        memory = count / seconds(lambda: sweep(rig, poses, "capacity-margin"), options.rounds)  # noqa: B023
        with tempfile.TemporaryDirectory() as folder:
            places = (Path(folder) / f"{k}.zarr" for k in range(options.rounds))
            disk = count / seconds(
                lambda: sweep(rig, poses, "capacity-margin", out=next(places)),  # noqa: B023
                options.rounds,
            )
        dask = cluster_rate(rig, poses, options.workers)
        cells = "".join(
            f"{rate / 1e6:>{width}.2f}"
            for rate, width in zip((kernel, memory, disk, dask), (17, 12, 10, 16), strict=True)
        )
        print(f"{name:22}{cells}")
        chunk, written = CHUNK_VALUES * options.workers / dask, write_seconds(rig, poses, 32)
        print(f"  a chunk: {1e3 * chunk:.0f} ms of a Dask worker, {1e3 * written:.1f} ms to disk, one by one")
        for workers in CLUSTER_WORKERS:
            minutes = LARGE / CHUNK_VALUES * max(chunk / workers, written) / 60
            print(f"  10⁹ poses with {workers} workers: {minutes:.1f} min")


if __name__ == "__main__":
    main()
