"""Thread that searches for a layout, and tells what it finds as it finds it."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tensionlab.errors import InputError, TensionlabError
from tensionlab.model.rig import Rig
from tensionlab.workspace.layout.results import Layout
from tensionlab.workspace.layout.task import LayoutTask


class _Stopped(Exception):  # noqa: N818 - no error
    """Raised in a search to end it."""


class LayoutRunner:
    """A search at a time, on a thread of its own.

    ``better`` is called with each layout that is better than those before, ``progress`` with the share that is
    done and what is said of it: how the best scores, that it was stopped, or what went wrong.
    """

    def __init__(self, better: Callable[[Layout], None], progress: Callable[[float, str], None]) -> None:
        self._better, self._progress = better, progress
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()

    @property
    def running(self) -> bool:
        """Whether there is a search."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, task: LayoutTask, rig: Rig) -> None:
        """Begin a search for rigs like one that is shown; nothing while there is one.

        Raises
        ------
        InputError
            If that rig is of another kind than those that are searched for.
        """
        kind = "point" if task.space.dimension == 3 else "planar-point"
        if rig.kind != kind:
            raise InputError(f"{task.name} is searched for {kind} rigs, and {rig.name} is a {rig.kind} rig")
        if self.running:
            return
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, args=(task,), name="view search", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the search, if there is one, and wait until it has ended; the best rig so far stays."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, task: LayoutTask) -> None:
        best: list[Layout] = []

        def said() -> str:
            if not best:
                return "nothing is found yet"
            rig, score = best[-1].rig, best[-1].score
            return f"{rig.name}: {score:.4g} is {task.objective.describe(rig)}"

        def progress(share: float) -> None:
            if self._stop.is_set():
                raise _Stopped
            self._progress(share, said())

        def better(layout: Layout) -> None:
            best.append(layout)
            self._better(layout)

        try:
            found = task.run(progress, better)
        except _Stopped:
            self._progress(0.0, f"stopped; {said()}")
        except TensionlabError as error:
            self._progress(0.0, str(error))
        else:
            if found.best.rig != best[-1].rig:  # it has another number of modules than was searched for last
                better(found.best)
            self._progress(1.0, said())
