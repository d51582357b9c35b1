"""Executors of tasks, such as a sweep's chunks: threads, or workers of a Dask cluster."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from typing import Any, Protocol, TypeVar

from tensionlab.errors import SweepError, optional_import
from tensionlab.support.files.reading import brief
from tensionlab.support.operating_system import KERNEL_THREADS, processors

CHUNKS_PER_WORKER = 2  # under way at once, so that no worker waits and memory is bounded
CLUSTER_TIMEOUT_S = 10  # longest time until a scheduler answers


class ExecutorTask(Protocol):
    """Part of the work, with all its data: small enough to send to another machine."""

    def evaluate(self) -> Any: ...  # noqa: D102 - the result


AnyTask = TypeVar("AnyTask", bound=ExecutorTask)


def evaluate_on_threads(tasks: Iterable[AnyTask]) -> Iterator[tuple[AnyTask, Any]]:
    """Evaluate tasks on all processors, ``TENSIONLAB_NUM_THREADS`` of them if it is set; yields as they finish.

    Threads serve: kernels and NumPy's loops run without the interpreter's lock.
    """
    setting = os.environ.get(KERNEL_THREADS, "")
    threads = int(setting) if setting.isdecimal() and int(setting) else processors()
    with ThreadPoolExecutor(threads) as pool:
        yield from _evaluate(tasks, threads, lambda task: pool.submit(task.evaluate))


def evaluate_on_cluster(address: str, tasks: Iterable[AnyTask]) -> Iterator[tuple[AnyTask, Any]]:
    """Evaluate tasks on an existing Dask cluster; yields as they finish.

    Where a worker dies, the scheduler gives its tasks to another. Workers need tensionlab, and no file of this
    machine. SweepError if the scheduler does not answer, has no workers, is lost, or lost too many workers.
    """
    with optional_import("cluster", "a cluster"):
        from distributed import Client, KilledWorker
        from distributed.comm import CommClosedError, parse_address, parse_host_port
        from distributed.protocol import pickle
    try:
        parse_host_port(parse_address(address)[1])  # a client that is refused this late waits at its end
        client = Client(address, timeout=CLUSTER_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, RuntimeError) as error:
        why = " ".join(str(error).split())
        raise SweepError(
            f"scheduler {brief(address)} does not answer ({why:.100}); give one that runs, as tcp://host:port"
        ) from None
    with client:
        workers = sum(client.nthreads().values())
        if not workers:
            raise SweepError(f"scheduler {address!r} has no workers; start some with: dask worker {address}")
        pool = client.get_executor(pure=False)
        try:
            for task, pickled in _evaluate(
                tasks, workers, lambda task: pool.submit(_evaluate_pickled, pickle.dumps(task))
            ):
                yield task, pickle.loads(pickled)
        except (KilledWorker, CancelledError, CommClosedError) as error:
            raise SweepError(f"scheduler {address!r} gave up: {error}; with out, the same call resumes") from error


def _evaluate(
    tasks: Iterable[AnyTask], workers: int, submit: Callable[[AnyTask], Future[Any]]
) -> Iterator[tuple[AnyTask, Any]]:
    """Yield tasks and their results as they finish, a few under way at a time."""
    waiting = iter(tasks)
    running: dict[Future[Any], AnyTask] = {}
    try:
        while True:
            for task in itertools.islice(waiting, CHUNKS_PER_WORKER * workers - len(running)):
                running[submit(task)] = task
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()


def _evaluate_pickled(task: bytes) -> bytes:
    """Evaluate a task, sent as bytes as is its answer: Dask would send arrays without alignment."""
    from distributed.protocol import pickle

    answer: bytes = pickle.dumps(pickle.loads(task).evaluate())
    return answer
