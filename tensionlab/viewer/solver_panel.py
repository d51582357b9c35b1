"""The tab of the panel in which solvers are compared: which, at what, and what they answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, ORANGE, PURPLE, RED
from tensionlab.viewer import state as edits
from tensionlab.viewer import words
from tensionlab.viewer.solver_study import Answer, Problems
from tensionlab.viewer.state import STUDIES, State

if TYPE_CHECKING:
    import viser

LINES = (BLUE, ORANGE, GREEN, RED, "#56B4E9", PURPLE, "#999999")
"""Colours of solvers, in their order; after the last, the first again."""
CHART_PIXELS = 190


class SolverPanel:
    """Fields, table and charts of the comparison of solvers."""

    def __init__(
        self,
        gui: viser.GuiApi,
        bind: Callable[[Any, Callable[[Any], edits.Edit]], Any],
        solvers: Sequence[str],
        tab: Any,
    ) -> None:
        """``bind`` makes what is entered in a field an edit; charts that come later are put in ``tab``, too."""
        self._gui, self._tab = gui, tab
        self._boxes = {}
        with gui.add_folder("compare with", expand_by_default=False):
            for name in solvers:
                self._boxes[name] = bind(gui.add_checkbox(name, False), _with_solver(name))
        self._study = bind(gui.add_dropdown("at", STUDIES), lambda study: edits.choose(study=study))
        self._table = gui.add_html("")
        self._bars = gui.add_html("")
        self._charts: list[Any] = []
        self._names: tuple[str, ...] = ()

    def show(self, state: State) -> None:
        """Bring the fields up to date."""
        for name, box in self._boxes.items():
            box.value = name in state.compared
        self._study.value = state.study

    def show_answers(self, state: State, asked: Problems, answers: Sequence[Answer]) -> None:
        """Show what solvers answer: a table, bars, and lines along the study; nothing for one solver alone."""
        if len(answers) < 2:
            answers = []
        self._table.content = words.solver_table(answers, LINES)
        self._bars.content = words.solver_bars(state, answers, LINES)
        known = [each for each in answers if each.study is not None]
        names = tuple(each.solver for each in known)
        module = state.selected if state.selected in [each.name for each in state.rig.modules] else None
        index = 0 if module is None else [each.name for each in state.rig.modules].index(module)
        lines: list[tuple[str, list[Floats]]] = [
            ("error N", [each.study.residual for each in known if each.study is not None]),
            (
                f"tension of {state.rig.modules[index].name} N",
                [each.study.tensions[:, index] for each in known if each.study is not None],
            ),
        ]
        while self._charts and (names != self._names or not known):
            self._charts.pop().remove()
        self._names = names
        if not known:
            return
        if not self._charts:
            self._charts = [self._add_chart(names, asked.along) for _ in lines]
        for chart, (title, values) in zip(self._charts, lines, strict=True):
            chart.title = title
            chart.data = (asked.along, *values)

    def _add_chart(self, names: Sequence[str], along: Floats) -> Any:
        series: list[dict[str, Any]] = [{"label": "at"}]
        series += [
            {"label": name, "stroke": LINES[i % len(LINES)], "width": 2, "points": {"show": False}}
            for i, name in enumerate(names)
        ]
        add: Any = self._gui.add_uplot
        with self._tab:
            return add(
                (along, *(np.zeros(len(along)) for _ in names)), tuple(series), title=" ", height=CHART_PIXELS,
                scales={"x": {"time": False}}, legend={"show": False},
            )  # fmt: skip


def _with_solver(name: str) -> Callable[[Any], edits.Edit]:
    """Return what a box does: the edit that compares a solver, or no longer."""

    def change(compared: bool) -> edits.Edit:
        def edit(state: State) -> State:
            others = tuple(each for each in state.compared if each != name)
            return edits.choose(compared=(*others, name) if compared else others)(state)

        return edit

    return change
