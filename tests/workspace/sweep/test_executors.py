"""Chunks are evaluated by threads of this process, or by the workers of a real Dask cluster."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.workspace import Grid
from tensionlab.workspace.sweep import executors
from tests.helpers.tallied import read, tallied

CUBE = tl.box_corners([2.0, 1.0, 3.0])
POSES = Grid(np.linspace(-0.9, 0.9, 40), np.linspace(-0.4, 0.4, 5), np.linspace(-1.0, 1.0, 3))
COUNT, CHUNK = 40, 15


def test_all_processors_work_and_few_chunks_wait(monkeypatch):
    monkeypatch.delenv("TENSIONLAB_NUM_THREADS", raising=False)
    monkeypatch.setattr(executors, "processors", lambda: 3)
    threads, waiting = set(), []
    together = threading.Barrier(3, timeout=600.0)

    class Task:
        def evaluate(self):
            if threading.get_ident() not in threads:
                threads.add(threading.get_ident())
                together.wait()  # until three work at once
            return np.zeros(1)

    def tasks():
        for number in range(50):
            waiting.append(number)
            yield Task()

    done = 0
    for _ in executors.evaluate_on_threads(tasks()):
        done += 1
        assert len(waiting) - done <= executors.CHUNKS_PER_WORKER * 3
    assert (done, len(threads)) == (50, 3)


def test_the_number_of_threads_can_be_set(monkeypatch):
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "1")
    threads = set()

    class Task:
        def evaluate(self):
            threads.add(threading.get_ident())

    assert len(list(executors.evaluate_on_threads(Task() for _ in range(9)))) == 9
    assert len(threads) == 1


def test_an_error_of_a_chunk_ends_the_sweep():
    class Task:
        def evaluate(self):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        list(executors.evaluate_on_threads(Task() for _ in range(1_000_000)))


@pytest.fixture
def start():
    """Start programs, and kill those that are left in the end."""
    started = []

    def program(*words):
        path = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
        process = subprocess.Popen(
            [sys.executable, "-m", *map(str, words)],
            env={**os.environ, "PYTHONPATH": path},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        started.append(process)
        return process

    yield program
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def scheduler():
    """Address of a scheduler in this process, over TCP."""
    from distributed import LocalCluster

    where = {"protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": ":0"}
    with LocalCluster(n_workers=0, threads_per_worker=1, processes=False, **where) as cluster:
        yield cluster.scheduler_address


def worker(start, scheduler):
    return start("distributed.cli.dask_worker", scheduler, "--no-nanny", "--nthreads", 1, "--no-dashboard")


def wait_for_workers(scheduler, count):
    from distributed import Client

    with Client(scheduler, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=600)


def wait_for(condition):
    deadline = time.monotonic() + 600
    while not condition():
        assert time.monotonic() < deadline, "waited for too long"
        time.sleep(0.01)


def test_a_cluster_whose_worker_dies_half_way_gives_the_same(start, scheduler, tmp_path):
    workers = [worker(start, scheduler), worker(start, scheduler)]
    wait_for_workers(scheduler, 2)
    tally, gate = tmp_path / "tally", tmp_path / "gate"
    dead, alive = workers[0].pid, workers[1].pid

    def kill():
        wait_for(lambda: all(Path(f"{gate}.{process}").exists() for process in (dead, alive)))
        workers[0].kill()
        workers[0].wait()
        gate.touch()

    killer = threading.Thread(target=kill)
    killer.start()
    metrics = ["capacity-margin", tallied(tally, gate=gate, held_after=COUNT // 2)]
    data = tl.sweep(CUBE, POSES, metrics, out=tmp_path / "sweep.zarr", scheduler=scheduler, chunk=CHUNK).load()
    killer.join()
    assert workers[0].wait() == -signal.SIGKILL
    assert workers[1].poll() is None

    by_process = {process: [pose for who, pose in read(tally) if who == process] for process in (dead, alive)}
    assert 0 < len(by_process[dead]) < COUNT
    assert len(set(by_process[dead]) | set(by_process[alive])) == COUNT  # what died with the worker was done again
    assert set(by_process[dead]) & set(by_process[alive])
    expected = tl.sweep(CUBE, POSES, ["capacity-margin", tallied(tmp_path / "local")])
    xr.testing.assert_equal(data, expected)


class Arrays:
    """Task of arrays; its answer is whether each is aligned, with arrays again."""

    def __init__(self, count):
        self._arrays = [np.full(size, 0.5) for size in range(1, count)]

    def evaluate(self):
        return [each.flags.aligned for each in self._arrays], self._arrays


def test_a_cluster_gives_the_same_as_threads_and_brings_aligned_arrays():
    from distributed import LocalCluster

    where = {"protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": ":0"}
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **where) as cluster:
        address = cluster.scheduler_address
        data = tl.sweep(CUBE, POSES, "capacity-margin", scheduler=address, chunk=CHUNK)
        for _, (there, arrays) in executors.evaluate_on_cluster(address, map(Arrays, (2, 12, 300))):
            assert all(there)
            assert all(each.flags.aligned for each in arrays)
    xr.testing.assert_equal(data, tl.sweep(CUBE, POSES, "capacity-margin"))


def test_a_scheduler_without_workers_is_refused(scheduler):
    with pytest.raises(SweepError, match="has no workers; start some with: dask worker tcp://"):
        tl.sweep(CUBE, POSES, "capacity-margin", scheduler=scheduler)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x"])
def test_a_scheduler_that_does_not_answer_is_named(address, monkeypatch):
    monkeypatch.setattr(executors, "CLUSTER_TIMEOUT_S", 0.5)
    with pytest.raises(SweepError, match=f"scheduler '{address}' does not answer"):
        tl.sweep(CUBE, POSES, "capacity-margin", scheduler=address)
