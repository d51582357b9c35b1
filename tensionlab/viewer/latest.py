"""Thread that works on the newest item submitted, and drops its work for a newer one."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

LOG = logging.getLogger(__name__)
Item = TypeVar("Item")


class Latest(Generic[Item]):
    """Worker on the newest of the items that are submitted.

    ``work`` is called with it, and with a function that tells whether it still is the newest; it may return early
    once that is False. Items that were never begun are left out.

    Examples
    --------
    >>> import threading
    >>> from tensionlab.viewer.latest import Latest
    >>> done = threading.Event()
    >>> worker = Latest("example", lambda number, wanted: done.set() if number == 3 else None)
    >>> for number in range(4):
    ...     worker.submit(number)
    >>> done.wait()
    True
    >>> worker.close()
    """

    def __init__(self, name: str, work: Callable[[Item, Callable[[], bool]], None]) -> None:
        self._name, self._work = name, work
        self._wake = threading.Condition()
        self._newest: list[Item] = []
        self._open = True
        self._thread = threading.Thread(target=self._run, name=f"view {name}", daemon=True)
        self._thread.start()

    def submit(self, item: Item) -> None:
        """Work on an item instead of those before; from any thread."""
        with self._wake:
            self._newest = [item]
            self._wake.notify_all()

    def close(self) -> None:
        """End the thread; its work is no longer wanted."""
        with self._wake:
            self._open = False
            self._wake.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._newest or not self._open)
                if not self._open:
                    return
                item, self._newest = self._newest[0], []
            try:
                self._work(item, lambda: self._open and not self._newest)
            except Exception as error:  # the next item may succeed
                LOG.warning("view %s: %s: %s", self._name, type(error).__name__, error)
