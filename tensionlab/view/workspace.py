"""Thread that evaluates the workspace of the newest state: coarsely at first, then finely."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

from tensionlab.errors import TensionlabError
from tensionlab.view.state import State, of_ghost
from tensionlab.view.volume import COARSE, FINE, Volume, bounds, sweep

NEEDS = ("rig", "rotation", "metric", "ghost")
"""Attributes of a state that its workspace depends on."""


def same_workspace(one: State | None, other: State) -> bool:
    """Tell whether two states have the same workspace."""
    return one is not None and all(getattr(one, name) is getattr(other, name) for name in NEEDS)


class WorkspaceWorker:
    """Evaluates the workspace of the state that was last wanted; a newer one makes it drop what it is at.

    The other rig's workspace, if there is one, is evaluated over the same box.
    """

    def __init__(self, found: Callable[[State, Volume, Volume | None], None]) -> None:
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
        volumes: tuple[Volume, Volume | None] | None = None
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
            if volumes is None or not same_workspace(of, state):
                volumes, of = self._evaluate(state, COARSE), state
            if volumes is None:
                continue
            self._found(state, *volumes)
            if fine and len(volumes[0].axes[0]) < FINE and (better := self._evaluate(state, FINE)):
                volumes = better
                self._found(state, *volumes)

    def _evaluate(self, state: State, resolution: int) -> tuple[Volume, Volume | None] | None:
        """Return the workspaces of a state and of the other rig; None where they are not wanted or cannot be."""
        box, wanted = bounds(state.rig), partial(self._still, state)
        try:
            volume = sweep(state, box, resolution, wanted)
        except TensionlabError:  # a metric that this rig has not
            return None
        if volume is None:
            return None
        if state.ghost is None or state.ghost.dimension != state.rig.dimension:
            return volume, None
        try:
            return volume, sweep(of_ghost(state, state.ghost), box, resolution, wanted)
        except TensionlabError:
            return volume, None
