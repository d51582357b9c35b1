"""Threads of the design page: one that works on all that waits, and one on what came last."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

LOG = logging.getLogger(__name__)
Item = TypeVar("Item")


class Worker(Generic[Item]):
    """Thread on which ``work`` is called, once it is started, with all items that were put since the last call."""

    def __init__(self, name: str, work: Callable[[list[Item]], None]) -> None:
        self._work = work
        self._wake = threading.Condition()
        self._waiting: list[Item] = []
        self._open = True
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.start = self._thread.start

    @property
    def idle(self) -> bool:
        """Whether nothing waits and the thread is to go on."""
        return self._open and not self._waiting

    def put(self, item: Item, replaces: Callable[[Item], bool] = lambda last: False) -> None:
        """Add an item, from any thread, after those waiting; the last of these that it replaces are dropped."""
        with self._wake:
            while self._waiting and replaces(self._waiting[-1]):
                self._waiting.pop()
            self._waiting.append(item)
            self._wake.notify_all()

    def close(self) -> None:
        """End the thread; what waits is not worked on."""
        with self._wake:
            self._open = False
            self._wake.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._waiting or not self._open)
                if not self._open:
                    return
                waiting, self._waiting = self._waiting, []
            self._work(waiting)


class Latest(Generic[Item]):
    """Worker on the newest of the submitted items.

    ``work`` is called with it, and with a function that tells whether it still is the newest; it may return early
    once that is False.
    """

    def __init__(self, name: str, work: Callable[[Item, Callable[[], bool]], None]) -> None:
        self._name, self._work = name, work
        self._worker: Worker[Item] = Worker(f"view {name}", self._run)
        self.close = self._worker.close
        self._worker.start()

    def submit(self, item: Item) -> None:
        """Work on an item instead of those before; from any thread."""
        self._worker.put(item, replaces=lambda last: True)

    def _run(self, items: list[Item]) -> None:
        try:
            self._work(items[-1], lambda: self._worker.idle)
        except Exception as error:  # the next item may succeed
            LOG.warning("view %s: %s: %s", self._name, type(error).__name__, error)
