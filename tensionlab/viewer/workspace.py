"""Workspace of the newest state: evaluated coarsely at first, then finely."""

from __future__ import annotations

from collections.abc import Callable

from tensionlab.errors import TensionlabError
from tensionlab.viewer.latest import Latest
from tensionlab.viewer.state import DesignState, of_ghost
from tensionlab.viewer.volume import COARSE, FINE, Volume, bounds, sweep

DEPENDS_ON = ("rig", "rotation", "metric", "ghost")
"""Attributes of a state that its workspace depends on."""
Volumes = tuple[Volume, Volume | None]
"""Workspace of a rig, and that of the other rig over the same box."""


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
