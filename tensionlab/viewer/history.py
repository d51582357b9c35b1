"""Undo and redo of what a person designs."""

from __future__ import annotations

from dataclasses import replace

from tensionlab.viewer.state import HAND, DesignState

# Attributes of a state that are undone; those of its display stay.
UNDONE = ("rig", "position", "rotation", "wrench")
MAX_STEPS = 500


class History:
    """The states that there were, and the present one.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.viewer import history, state
    >>> past = history.History(state.begin(tl.load_rig("bartels2026-validation")))
    >>> past.record(state.move_hand(past.present, [0.0, 0.5, 0.0]))
    >>> past.undo().position
    array([0. , 0.3, 0. ])
    """

    def __init__(self, state: DesignState) -> None:
        self.present = state
        self._before: list[DesignState] = []
        self._after: list[DesignState] = []
        self._step: object = None

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to undo."""
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        """Whether a step was undone, and none made since."""
        return bool(self._after)

    def record(self, state: DesignState, step: object = None) -> None:
        """Make a state the present one.

        Edits with the same step, which is not None, are one: those of a drag are undone together. What changes
        none of `UNDONE` is no step.
        """
        if any(getattr(state, name) is not getattr(self.present, name) for name in UNDONE):
            if step is None or step is not self._step:
                self._before = [*self._before, self.present][-MAX_STEPS:]
            self._after.clear()
            self._step = step
        self.present = state

    def undo(self) -> DesignState:
        """Return to the state before the last step, if there is one."""
        return self._go(self._before, self._after)

    def redo(self) -> DesignState:
        """Return to the state that the last undo left, if there is one."""
        return self._go(self._after, self._before)

    def _go(self, source: list[DesignState], target: list[DesignState]) -> DesignState:
        if source:
            goal = source.pop()
            target.append(self.present)
            known = {HAND, *(module.name for module in goal.rig.modules)}
            selected = self.present.selected if self.present.selected in known else ""
            designed = {name: getattr(goal, name) for name in UNDONE}
            self.present = replace(self.present, **designed, selected=selected)
        self._step = None
        return self.present
