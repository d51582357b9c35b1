"""Executors of tasks, such as a sweep's chunks: threads, or workers of a Dask cluster."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from typing import Any, Protocol, TypeVar

from tensionlab.errors import SweepError, optional_import
from tensionlab.support.files.reading import brief
from tensionlab.support.operating_system import processors

CHUNKS_PER_WORKER = 2  # under way at once, so that no worker waits and memory is bounded
CLUSTER_TIMEOUT_S = 10  # longest time until a scheduler answers, in s


class ExecutorTask(Protocol):
    """Part of the work, with all that it takes to do it: small enough to send to another machine."""

    def evaluate(self) -> Any:
        """Do it, and return what was found."""


AnyTask = TypeVar("AnyTask", bound=ExecutorTask)


def evaluate_on_threads(tasks: Iterable[AnyTask]) -> Iterator[tuple[AnyTask, Any]]:
    """Evaluate tasks on all processors, ``TENSIONLAB_NUM_THREADS`` of them if it is set; yields as they finish.

    Threads serve: kernels and NumPy's loops run without the interpreter's lock.
    """
    waiting = iter(tasks)
    running: dict[Future[Any], AnyTask] = {}
    with ThreadPoolExecutor(threads := thread_count()) as pool:
        try:
            while True:
                for task in itertools.islice(waiting, CHUNKS_PER_WORKER * threads - len(running)):
                    running[pool.submit(task.evaluate)] = task
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            for future in running:
                future.cancel()


def thread_count() -> int:
    """Return how many threads evaluate chunks: ``TENSIONLAB_NUM_THREADS``, or one on each processor."""
    setting = os.environ.get("TENSIONLAB_NUM_THREADS", "")
    return int(setting) if setting.isdecimal() and int(setting) else processors()


def evaluate_on_cluster(address: str, tasks: Iterable[AnyTask]) -> Iterator[tuple[AnyTask, Any]]:
    """Evaluate tasks on an existing Dask cluster; yields as they finish.

    Where a worker dies, the scheduler gives its tasks to another. Workers need tensionlab installed, and no file
    of this machine: a task holds all that it needs. SweepError if the scheduler does not answer, has no workers,
    is lost, or lost too many workers.
    """
    with optional_import("cluster", "a cluster"):
        from distributed import Client, KilledWorker, as_completed
        from distributed.comm import CommClosedError
        from distributed.protocol import pickle
    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, RuntimeError) as error:
        raise _no_answer(address, error) from None
    with client:
        workers = sum(client.nthreads().values())
        if not workers:
            raise SweepError(f"scheduler {address!r} has no workers; start some with: dask worker {address}")
        waiting = iter(tasks)
        known: dict[str, AnyTask] = {}

        def submit(count: int) -> list[Any]:
            futures = []
            for task in itertools.islice(waiting, count):
                futures.append(client.submit(_evaluate, pickle.dumps(task), pure=False))
                known[futures[-1].key] = task
            return futures

        running = as_completed(submit(CHUNKS_PER_WORKER * workers), loop=client.loop)
        try:
            for future in running:
                running.update(submit(1))
                yield known.pop(future.key), pickle.loads(future.result())
        except (KilledWorker, CancelledError, CommClosedError) as error:
            raise SweepError(f"scheduler {address!r} gave up: {error}; with out, the same call resumes") from error


def _evaluate(task: bytes) -> bytes:
    """Evaluate a task. It and its answer travel as bytes: arrays beside a message would come without alignment."""
    from distributed.protocol import pickle

    answer: bytes = pickle.dumps(pickle.loads(task).evaluate())
    return answer


def _no_answer(address: str, error: Exception) -> SweepError:
    why = " ".join(str(error).split())
    return SweepError(
        f"scheduler {brief(address)} does not answer ({why:.100}); give one that runs, as tcp://host:port"
    )
