"""Threads that work on the newest state: the workspace coarsely at first, then finely; and solvers."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from tensionlab.errors import TensionlabError
from tensionlab.viewer.state import DesignState, of_ghost
from tensionlab.viewer.volume import COARSE, FINE, Volume, bounds, sweep

LOG = logging.getLogger(__name__)
Item = TypeVar("Item")
DEPENDS_ON = ("rig", "rotation", "metric", "ghost")  # attributes of a state that its workspace depends on
Volumes = tuple[Volume, Volume | None]  # workspace of a rig, and that of the other rig over the same box


class Latest(Generic[Item]):
    """Worker on the newest of the items that are submitted.

    ``work`` is called with it, and with a function that tells whether it still is the newest; it may return early
    once that is False. Items that were never begun are left out.

    Examples
    --------
    >>> import threading
    >>> from tensionlab.viewer.workers import Latest
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


def same_workspace(one: DesignState | None, other: DesignState | None) -> bool:
    """Return whether two states have the same workspace."""
    return None not in (one, other) and all(getattr(one, name) is getattr(other, name) for name in DEPENDS_ON)


class WorkspaceWorker:
    """Evaluates the workspace of the state that was last submitted, on a thread of its own.

    ``found`` is called with a coarse workspace, then with a fine one unless something is being dragged.
    """

    def __init__(self, found: Callable[[DesignState, Volume, Volume | None], None]) -> None:
        self._found = found
        self._newest: DesignState | None = None
        self._evaluated: DesignState | None = None
        self._volumes: Volumes | None = None
        self._worker = Latest("workspace", self._work)
        self.close = self._worker.close

    def submit(self, state: DesignState, *, fine: bool) -> None:
        """Have the workspace of a state evaluated; a fine one only where ``fine``."""
        self._newest = state
        self._worker.submit((state, fine))

    def _work(self, item: tuple[DesignState, bool], _: Callable[[], bool]) -> None:
        state, fine = item
        if state.display == "off":
            return
        if not same_workspace(self._evaluated, state):
            self._volumes, self._evaluated = self._evaluate(state, COARSE), state
        if self._volumes is None:
            self._evaluated = None
            return
        self._found(state, *self._volumes)
        if fine and len(self._volumes[0].axes[0]) < FINE and (better := self._evaluate(state, FINE)):
            self._volumes = better
            self._found(state, *better)

    def _evaluate(self, state: DesignState, resolution: int) -> Volumes | None:
        """Return the workspaces of a state and of the other rig; None if no longer wanted, or not defined."""
        box = bounds(state.rig)

        def wanted() -> bool:
            return same_workspace(self._newest, state)  # a force or a colour may have changed meanwhile

        ghost = None
        try:
            volume = sweep(state, box, resolution, wanted)
            if volume is not None and state.ghost is not None and state.ghost.dimension == state.rig.dimension:
                ghost = sweep(of_ghost(state, state.ghost), box, resolution, wanted)
        except TensionlabError:  # a metric that one of the rigs does not have
            return None
        return None if volume is None else (volume, ghost)
