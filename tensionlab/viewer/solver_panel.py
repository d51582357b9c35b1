"""The tab of the panel in which solvers are compared: a table, and charts along a study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, ORANGE, PURPLE, RED
from tensionlab.viewer.html import render
from tensionlab.viewer.solver_study import SolverAnswers, StudyProblems
from tensionlab.viewer.state import STUDIES, DesignState

if TYPE_CHECKING:
    import viser

# Colours of solvers, in their order; after the last, the first again.
SERIES_COLOURS = (BLUE, ORANGE, GREEN, RED, "#56B4E9", PURPLE, "#999999")
CHART_PIXELS = 190
Bind = Callable[[Any, Callable[[DesignState], Any], Callable[[DesignState, Any], DesignState]], Any]


class SolverPanel:
    """Fields, table and charts of the comparison of solvers."""

    def __init__(self, gui: viser.GuiApi, bind: Bind, solvers: Sequence[str], tab: Any) -> None:
        """``bind`` ties a field to the state; charts that come later are put in ``tab``, too."""
        self._gui, self._tab = gui, tab
        with gui.add_folder("compare with", expand_by_default=False):
            for name in solvers:
                bind(gui.add_checkbox(name, False), _is_compared(name), _compare(name))
        bind(
            gui.add_dropdown("at", STUDIES),
            lambda state: state.study,
            lambda state, study: replace(state, study=study),
        )
        self._table = gui.add_html("")
        self._charts: list[Any] = []
        self._names: tuple[str, ...] = ()

    def show(self, state: DesignState, study: StudyProblems, answers: Sequence[SolverAnswers]) -> None:
        """Show the answers of solvers: a table, and charts along the study; nothing for one solver alone."""
        if len(answers) < 2:
            answers = []
        self._table.content = render("design.solvers", answers, SERIES_COLOURS)
        known = {each.solver: each.study for each in answers if each.study is not None}
        names = [module.name for module in state.rig.modules]
        index = names.index(state.selected) if state.selected in names else 0
        lines = {
            "error N": [found.residual for found in known.values()],
            f"tension of {names[index]} N": [found.tensions[:, index] for found in known.values()],
        }
        while self._charts and (tuple(known) != self._names or not known):
            self._charts.pop().remove()
        self._names = tuple(known)
        if not known:
            return
        if not self._charts:
            self._charts = [self._add_chart(self._names, study.along) for _ in lines]
        for chart, (title, values) in zip(self._charts, lines.items(), strict=True):
            chart.title = title
            chart.data = (study.along, *values)

    def _add_chart(self, names: Sequence[str], along: Floats) -> Any:
        series: list[dict[str, Any]] = [{"label": "at"}]
        series += [
            {
                "label": name,
                "stroke": SERIES_COLOURS[i % len(SERIES_COLOURS)],
                "width": 2,
                "points": {"show": False},
            }
            for i, name in enumerate(names)
        ]
        add: Any = self._gui.add_uplot
        with self._tab:
            return add(
                (along, *(np.zeros(len(along)) for _ in names)), tuple(series), title=" ", height=CHART_PIXELS,
                scales={"x": {"time": False}}, legend={"show": False},
            )  # fmt: skip


def _is_compared(name: str) -> Callable[[DesignState], bool]:
    return lambda state: name in state.compared


def _compare(name: str) -> Callable[[DesignState, bool], DesignState]:
    """Return the change that compares a solver, or no longer."""

    def change(state: DesignState, compared: bool) -> DesignState:
        others = tuple(each for each in state.compared if each != name)
        return replace(state, compared=(*others, name) if compared else others)

    return change
