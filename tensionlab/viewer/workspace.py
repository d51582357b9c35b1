"""Workspace of the newest state: evaluated coarsely at first, then finely."""

from __future__ import annotations

from collections.abc import Callable

from tensionlab.errors import TensionlabError
from tensionlab.viewer.latest import Latest
from tensionlab.viewer.state import State, of_ghost
from tensionlab.viewer.volume import COARSE, FINE, Volume, bounds, sweep

NEEDS = ("rig", "rotation", "metric", "ghost")
"""Attributes of a state that its workspace depends on."""
Volumes = tuple[Volume, Volume | None]
"""Workspace of a rig, and that of the other rig over the same box."""


def same_workspace(one: State | None, other: State | None) -> bool:
    """Tell whether two states have the same workspace."""
    return None not in (one, other) and all(getattr(one, name) is getattr(other, name) for name in NEEDS)


class WorkspaceWorker:
    """Evaluates the workspace of the state that was last wanted, on a thread of its own.

    ``found`` is called with what is there, first a coarse one, then a fine one unless something is being dragged.
    """

    def __init__(self, found: Callable[[State, Volume, Volume | None], None]) -> None:
        self._found = found
        self._newest: State | None = None
        self._of: State | None = None
        self._volumes: Volumes | None = None
        self._worker = Latest("workspace", self._work)
        self.close = self._worker.close

    def want(self, state: State, *, fine: bool) -> None:
        """Ask for the workspace of a state; a fine one only where ``fine``, as nothing is being dragged."""
        self._newest = state
        self._worker.want((state, fine))

    def _work(self, wanted: tuple[State, bool], _: Callable[[], bool]) -> None:
        state, fine = wanted
        if state.display == "off":
            return
        if not same_workspace(self._of, state):
            self._volumes, self._of = self._evaluate(state, COARSE), state
        if self._volumes is None:
            self._of = None
            return
        self._found(state, *self._volumes)
        if fine and len(self._volumes[0].axes[0]) < FINE and (better := self._evaluate(state, FINE)):
            self._volumes = better
            self._found(state, *better)

    def _evaluate(self, state: State, resolution: int) -> Volumes | None:
        """Return the workspaces of a state and of the other rig; None where they are not wanted or cannot be."""
        box = bounds(state.rig)

        def wanted() -> bool:
            return same_workspace(self._newest, state)  # a force or a colour may have changed meanwhile

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
