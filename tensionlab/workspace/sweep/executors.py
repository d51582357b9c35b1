"""Who evaluates the chunks of a sweep: the threads of this process, or the workers of a Dask cluster."""

from __future__ import annotations

import itertools
import os
import socket
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from typing import Any
from urllib.parse import urlsplit

from tensionlab.arrays import Floats
from tensionlab.errors import MissingDependency, SweepError
from tensionlab.files.reading import brief
from tensionlab.workspace.sweep.plan import Task

AHEAD = 2
"""Chunks under way for each worker, so that none waits and memory is bounded."""

CONNECTING = 3.0
"""Seconds that a connection to its scheduler may take."""
PATIENCE = 10
"""Seconds that a cluster has to answer."""


def locally(tasks: Iterable[Task]) -> Iterator[tuple[Task, Floats]]:
    """Evaluate tasks on all processors, ``TENSIONLAB_NUM_THREADS`` of them if it is set; yields as they finish.

    Threads serve: kernels and NumPy's loops run without the interpreter's lock.
    """
    asked = os.environ.get("TENSIONLAB_NUM_THREADS", "")
    workers = int(asked) if asked.isdecimal() and int(asked) else _processors()
    waiting = iter(tasks)
    running: dict[Future[Floats], Task] = {}
    with ThreadPoolExecutor(workers) as pool:
        try:
            while True:
                for task in itertools.islice(waiting, AHEAD * workers - len(running)):
                    running[pool.submit(task.evaluate)] = task
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            for future in running:
                future.cancel()


def on_cluster(address: str, tasks: Iterable[Task]) -> Iterator[tuple[Task, Floats]]:
    """Evaluate tasks on an existing Dask cluster; yields as they finish.

    Where a worker dies, the scheduler gives its tasks to another. Workers need tensionlab installed, and no file
    of this machine: a task holds all that it needs.

    Raises
    ------
    MissingDependency
        If dask.distributed is not installed.
    SweepError
        If the scheduler does not answer, has no workers, is lost, or lost too many workers.
    """
    try:
        from distributed import Client, KilledWorker, as_completed
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise MissingDependency('a cluster needs dask.distributed: pip install "tensionlab[cluster]"') from error
    _require_listening(address)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, RuntimeError) as error:
        raise _silent(address, error) from None
    with client:
        workers = sum(client.nthreads().values())
        if not workers:
            raise SweepError(f"scheduler {address!r} has no workers; start some with: dask worker {address}")
        waiting = iter(tasks)
        known: dict[str, Task] = {}

        def submit(count: int) -> list[Any]:
            futures = []
            for task in itertools.islice(waiting, count):
                futures.append(client.submit(Task.evaluate, task, pure=False))
                known[futures[-1].key] = task
            return futures

        running = as_completed(submit(AHEAD * workers), loop=client.loop)
        try:
            for future in running:
                running.update(submit(1))
                yield known.pop(future.key), future.result()
        except (KilledWorker, CancelledError, CommClosedError) as error:
            raise SweepError(
                f"scheduler {address!r} gave up: {error}; with out, the same call goes on from here"
            ) from error


def _require_listening(address: str) -> None:
    """Refuse an address where nobody listens, at once: the client would try again until its time is over."""
    scheme, _, place = address.rpartition("://")
    if scheme not in ("tcp", "tls", ""):
        return
    try:
        parts = urlsplit(f"tcp://{place}")
        with socket.create_connection((parts.hostname or "", parts.port or 8786), CONNECTING):
            pass
    except (OSError, ValueError) as error:  # also a port that is none, and a name that cannot be one
        raise _silent(address, error) from None


def _silent(address: str, error: Exception) -> SweepError:
    why = " ".join(str(error).split())
    return SweepError(
        f"scheduler {brief(address)} does not answer ({why:.100}); give one that runs, as tcp://host:port"
    )


def _processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
