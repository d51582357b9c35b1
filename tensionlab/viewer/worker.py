"""Threads of the design page: one that works on all that waits, and one on what came last."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

LOG = logging.getLogger(__name__)
Item = TypeVar("Item")


class Worker(Generic[Item]):
    """Thread on which ``work`` is called, once it is started, with all items that were put since the last call."""

    def __init__(self, name: str, work: Callable[[list[Item]], None]) -> None:
        self._work = work
        self._waiting: SimpleQueue[Item | None] = SimpleQueue()  # None ends the thread
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.start, self.put, self.has_all = self._thread.start, self._waiting.put, self._waiting.empty

    def close(self) -> None:
        """End the thread; what waits is not worked on."""
        self._waiting.put(None)
        self._thread.join()

    def _run(self) -> None:
        while True:
            items = [self._waiting.get()]
            with suppress(Empty):
                while True:
                    items.append(self._waiting.get_nowait())
            if None in items:
                return
            self._work([item for item in items if item is not None])


class Latest(Worker[Item]):
    """Worker on the newest of the items.

    ``work`` is called with it, and with a function that tells whether it still is the newest; it may return early
    once that is False.
    """

    def __init__(self, name: str, work: Callable[[Item, Callable[[], bool]], None]) -> None:
        def work_on_last(items: list[Item]) -> None:
            try:
                work(items[-1], self.has_all)
            except Exception as error:  # the next item may succeed
                LOG.warning("view %s: %s: %s", name, type(error).__name__, error)

        super().__init__(f"view {name}", work_on_last)
        self.start()
