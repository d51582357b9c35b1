"""Thread that evaluates the workspace of the newest state: coarsely at first, then finely."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

from tensionlab.errors import TensionlabError
from tensionlab.view.state import State
from tensionlab.view.volume import COARSE, FINE, Volume, sweep

NEEDS = ("rig", "rotation", "metric")
"""Attributes of a state that its workspace depends on."""


def same_workspace(one: State | None, other: State) -> bool:
    """Tell whether two states have the same workspace."""
    return one is not None and all(getattr(one, name) is getattr(other, name) for name in NEEDS)


class WorkspaceWorker:
    """Evaluates the workspace of the state that was last wanted; a newer one makes it drop what it is at."""

    def __init__(self, found: Callable[[State, Volume], None]) -> None:
        self._found = found
        self._wake = threading.Condition()
        self._wanted: tuple[State, bool] | None = None
        self._changed = False
        self._open = True
        self._thread = threading.Thread(target=self._work, name="view workspace", daemon=True)
        self._thread.start()

    def want(self, state: State, *, fine: bool) -> None:
        """Ask for the workspace of a state; a fine one only where ``fine``, as nothing is being dragged."""
        with self._wake:
            self._wanted = (state, fine)
            self._changed = True
            self._wake.notify_all()

    def close(self) -> None:
        """End the thread."""
        with self._wake:
            self._open = False
            self._wake.notify_all()
        self._thread.join()

    def _still(self, state: State) -> bool:
        return self._open and self._wanted is not None and same_workspace(self._wanted[0], state)

    def _work(self) -> None:
        volume: Volume | None = None
        of: State | None = None
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._changed or not self._open)
                if not self._open:
                    return
                assert self._wanted is not None
                (state, fine), self._changed = self._wanted, False
            if state.display == "off":
                continue
            try:
                if volume is None or not same_workspace(of, state):
                    volume, of = sweep(state, COARSE, partial(self._still, state)), state
                if volume is None:
                    continue
                self._found(state, volume)
                if fine and len(volume.axes[0]) < FINE:
                    better = sweep(state, FINE, partial(self._still, state))
                    if better is not None:
                        volume = better
                        self._found(state, volume)
            except TensionlabError:
                volume = None
