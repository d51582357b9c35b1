"""Executors of tasks, such as a sweep's chunks: threads or workers of a Dask cluster; and the progress bar."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from datetime import timedelta
from typing import Any, Protocol, TypeVar
from urllib.parse import urlsplit

from tensionlab.errors import SweepError, needs
from tensionlab.support.files.reading import brief
from tensionlab.support.operating_system import processors

CHUNKS_PER_WORKER = 2
"""Under way at once, so that no worker waits and memory is bounded."""
CONNECT_TIMEOUT_S = 3.0
"""For a connection to a scheduler."""
CLUSTER_TIMEOUT_S = 10
"""For the answer of a cluster."""
BAR_DELAY_S = 2.0
"""Before a progress bar shows up."""


class Task(Protocol):
    """Part of the work, with all that it takes to do it: small enough to send to another machine."""

    def evaluate(self) -> Any:
        """Do it, and return what was found."""


AnyTask = TypeVar("AnyTask", bound=Task)


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
    with needs("cluster", "a cluster"):
        from distributed import Client, KilledWorker, as_completed
        from distributed.comm import CommClosedError
    _require_listening(address)
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
                futures.append(client.submit(_evaluate, task, pure=False))
                known[futures[-1].key] = task
            return futures

        running = as_completed(submit(CHUNKS_PER_WORKER * workers), loop=client.loop)
        try:
            for future in running:
                running.update(submit(1))
                yield known.pop(future.key), future.result()
        except (KilledWorker, CancelledError, CommClosedError) as error:
            raise SweepError(
                f"scheduler {address!r} gave up: {error}; with out, the same call goes on from here"
            ) from error


def _evaluate(task: Task) -> Any:
    return task.evaluate()


def _require_listening(address: str) -> None:
    """Refuse an address where nobody listens, at once: the client would try again until its time is over."""
    scheme, _, place = address.rpartition("://")
    if scheme not in ("tcp", "tls", ""):
        return
    try:
        parts = urlsplit(f"tcp://{place}")
        with socket.create_connection((parts.hostname or "", parts.port or 8786), CONNECT_TIMEOUT_S):
            pass
    except (OSError, ValueError) as error:  # also a port that is none, and a name that cannot be one
        raise _no_answer(address, error) from None


def _no_answer(address: str, error: Exception) -> SweepError:
    why = " ".join(str(error).split())
    return SweepError(
        f"scheduler {brief(address)} does not answer ({why:.100}); give one that runs, as tcp://host:port"
    )


@contextlib.contextmanager
def progress_bar(total: int, done: int, shown: bool) -> Iterator[Callable[[int], None]]:
    """Show a bar on stderr while the work lasts, if that is a terminal; it vanishes when done.

    ``total`` poses are all the work, ``done`` were finished before. What it yields is to be called with the
    number of further finished poses.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        TextColumn("Sweep"),
        BarColumn(),
        TextColumn("{task.completed:,.0f} of {task.total:,.0f} poses, {task.fields[speed]}"),
    )
    progress = Progress(*columns, console=Console(file=sys.stderr), transient=True)
    shown = shown and progress.console.is_terminal
    task = progress.add_task("", total=total, completed=done, speed="")
    start, new = time.perf_counter(), 0

    def advance(count: int) -> None:
        nonlocal new
        new += count
        elapsed = time.perf_counter() - start
        left = timedelta(seconds=round((total - done - new) * elapsed / new))
        progress.update(task, completed=done + new, speed=f"{new / elapsed:,.0f}/s, {left} left")
        if shown and elapsed > BAR_DELAY_S and not progress.live.is_started:
            progress.start()

    try:
        yield advance
    finally:
        if progress.live.is_started:
            progress.stop()
