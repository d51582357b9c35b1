"""Undo and redo of the design page, and the thread that makes people's edits in their order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from tensionlab.errors import TensionlabError
from tensionlab.viewer.state import HAND, DesignState, Edit
from tensionlab.viewer.worker import Worker

UNDOABLE = ("rig", "position", "rotation", "wrench")  # attributes of a state that undo restores
MAX_STEPS = 500


class History:
    """The present state, and those that undo and redo return to."""

    def __init__(self, state: DesignState) -> None:
        self.present = state
        self._before: list[DesignState] = []
        self._after: list[DesignState] = []
        self._step: object = None

    def record(self, state: DesignState, step: object = None) -> None:
        """Make a state the present one.

        Edits with the same step that is not None are undone together, such as those of a drag. A change of none of
        `UNDOABLE` is no step.
        """
        if any(getattr(state, name) is not getattr(self.present, name) for name in UNDOABLE):
            if step is None or step is not self._step:
                self._before = [*self._before, self.present][-MAX_STEPS:]
            self._after.clear()
            self._step = step
        self.present = state

    def undo(self) -> None:
        """Return to the state before the last step, if there is one."""
        self._restore(self._before, self._after)

    def redo(self) -> None:
        """Return to the state before the last undo, if there is one."""
        self._restore(self._after, self._before)

    def _restore(self, source: list[DesignState], target: list[DesignState]) -> None:
        self._step = None
        if source:
            goal = source.pop()
            target.append(self.present)
            selected = self.present.selected if self.present.selected in (HAND, *goal.names) else ""
            restored = {name: getattr(goal, name) for name in UNDOABLE}
            self.present = replace(self.present, **restored, selected=selected)


class EditQueue:
    """Edits from any thread, made on one thread in their order.

    ``show`` is called with what went wrong, or "", after each round: all edits that waited meanwhile. So there is
    one allocation for each picture, however fast a mouse moves.
    """

    def __init__(self, state: DesignState, show: Callable[[str], None]) -> None:
        self.history = History(state)
        self._show = show
        self._worker = Worker("view", self._work)
        self.put, self.close = self._worker.put, self._worker.close  # `put` queues a function

    def start(self) -> None:
        """Show the state, and begin to make edits."""
        self._show("")
        self._worker.start()

    def edit(self, change: Edit, step: object = None) -> None:
        """Queue an edit; those of one step are undone together."""
        self.put(lambda: self.history.record(change(self.history.present), step))

    def undo(self) -> None:
        """Queue the undoing of the last step."""
        self.put(self.history.undo)

    def redo(self) -> None:
        """Queue the redoing of the step undone last."""
        self.put(self.history.redo)

    def _work(self, waiting: list[Callable[[], object]]) -> None:
        previous_state, problem = self.history.present, ""
        for act in waiting:
            try:
                act()
            except Exception as error:  # whatever it is, the page must survive it
                problem = _describe(error)
        try:
            self._show(problem)
        except Exception as error:  # a state that cannot be shown is not kept
            self.history.present = previous_state
            self._show(_describe(error))


def _describe(error: Exception) -> str:
    return str(error) if isinstance(error, TensionlabError) else f"{type(error).__name__}: {error}"
