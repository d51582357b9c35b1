"""Comparison of solvers on the design page: their answers to a study, in a table and in charts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.allocation import Allocation, Allocator
from tensionlab.errors import TensionlabError
from tensionlab.model import directions
from tensionlab.solvers import make
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, ORANGE, PURPLE, RED
from tensionlab.support.formatting import format_duration, format_number
from tensionlab.support.table import Column, Mark, Table
from tensionlab.viewer.scene import size
from tensionlab.viewer.state import STUDIES, DesignState

if TYPE_CHECKING:
    import viser

CIRCLE_COUNT = 180  # problems around a circle
FORCE_SHARE = 0.25  # size of the forces where none is desired, as a share of the strongest tension
RADIUS_SHARE = 0.1  # radius of the circle of the hand, as a share of the size of the rig
TIMED_CALLS, TIMED_S = 20, 0.05  # most calls that are timed, and the time after which no further one begins
SERIES_COLOURS = (BLUE, ORANGE, GREEN, RED, "#56B4E9", PURPLE, "#999999")  # of solvers, in their order
CHART: dict[str, Any] = {"height": 190, "scales": {"x": {"time": False}}, "legend": {"show": False}}
COLUMNS = (
    "solver",
    "status",
    Column("error", "N", lambda value: format_number(round(value, 9))),
    Column("max t", "N", format_number),
    Column("time", "", format_duration),
    "exact",
)
Bind = Callable[[Any, Callable[[DesignState], Any], Callable[[DesignState, Any], DesignState]], Any]


class StudyProblems(NamedTuple):
    """Forces at places, one after another; the torque is the desired one of the state."""

    along: Floats  # place of each in the study, (k,): an angle in degrees, or its number
    positions: Floats  # of the hand, (k, d), in m
    forces: Floats  # desired, (k, d), in N


class SolverAnswers(NamedTuple):
    """Answers of one solver at the desired wrench and to a study; none where ``problem`` says why."""

    solver: str
    now: Allocation | None = None
    study: Allocation | None = None
    seconds: float = float("nan")  # median time of a call
    problem: str = ""


def problems(state: DesignState) -> StudyProblems:
    """Return the problems of the study that a state chooses."""
    rig, d, force = state.rig, state.rig.dimension, state.wrench[: state.rig.dimension]
    strength = float(np.linalg.norm(force)) or FORCE_SHARE * float(rig.limits.upper.max())
    if state.study == "force in all directions":
        forces = strength * (directions.grid18() if d == 3 else directions.circle())
        return StudyProblems(np.arange(float(len(forces))), np.tile(state.position, (len(forces), 1)), forces)
    angle = np.linspace(0.0, 360.0, CIRCLE_COUNT, endpoint=False)
    # Around the vertical axis; in the plane, from its first axis.
    level = (0, 1) if d == 2 else tuple(i for i in range(3) if "xyz"[i] != rig.vertical)
    ring = np.zeros((CIRCLE_COUNT, d))
    ring[:, level] = np.column_stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    if state.study == "force in a circle":
        return StudyProblems(angle, np.tile(state.position, (len(ring), 1)), strength * ring)
    places = state.position + RADIUS_SHARE * size(rig) * ring
    return StudyProblems(angle, places, np.tile(force, (len(ring), 1)))


def answer(state: DesignState, solver: str, study: StudyProblems) -> SolverAnswers:
    """Return the answers of a solver, and how long one takes."""
    rig = state.rig
    d = rig.dimension
    try:
        made = make(solver)
        allocator = Allocator(rig.limits, made, policy=state.policy if state.policy in made.policies else None)
        here = rig.structure_matrix(state.position, state.rotation, rig.at_rest)
        now = allocator(here, state.exerted)
        wrenches = np.tile(state.exerted, (len(study.forces), 1))
        wrenches[:, :d] += study.forces - state.wrench[:d]
        structure = rig.structure_matrix(study.positions, state.rotation, rig.at_rest)
        allocation = allocator(structure, wrenches)
    except TensionlabError as error:
        return SolverAnswers(solver, problem=str(error))
    seconds: list[float] = []
    while not seconds or (len(seconds) < TIMED_CALLS and sum(seconds) < TIMED_S):
        start = time.perf_counter()
        allocator(here, state.exerted)
        seconds.append(time.perf_counter() - start)
    return SolverAnswers(solver, now, allocation, float(np.median(seconds)))


def compare(state: DesignState, wanted: Callable[[], bool]) -> tuple[StudyProblems, list[SolverAnswers]] | None:
    """Return the problems of a state, and the answers of its solver and the compared ones; None if not wanted."""
    study = problems(state)
    answers = []
    for solver in dict.fromkeys([state.solver, *state.compared]):
        if not wanted():
            return None
        answers.append(answer(state, solver, study))
    return study, answers


def solver_table(answers: Sequence[SolverAnswers]) -> Table:
    """Return the table of the answers at the desired wrench, and of how many of the study are exact."""
    rows: list[list[Any]] = []
    for answer, colour in zip(answers, cycle(SERIES_COLOURS), strict=False):
        name = Mark("■", colour, answer.solver)
        if answer.now is None or answer.study is None:
            rows.append([name, answer.problem, None, None, None, None])
            continue
        exact = f"{answer.study.counts()[Status.EXACT]}/{answer.study.status.size}"
        residual, highest = float(answer.now.residual), float(answer.now.tensions.max())
        rows.append([name, Status(int(answer.now.status)).name, residual, highest, answer.seconds, exact])
    return Table(COLUMNS, rows, notes=['At the desired force; "exact" counts the problems below.'])


class SolverPanel:
    """Fields, table and charts of the comparison of solvers."""

    def __init__(self, gui: viser.GuiApi, bind: Bind, solvers: Sequence[str], tab: Any) -> None:
        """``bind`` ties a field to the state; charts are added to ``tab`` later."""
        self._gui: Any = gui
        self._tab = tab
        with gui.add_folder("compare with", expand_by_default=False):
            for name in solvers:
                is_compared = partial(lambda name, state: name in state.compared, name)
                bind(gui.add_checkbox(name, False), is_compared, partial(_set_compared, name))
        study = gui.add_dropdown("at", STUDIES)
        bind(study, lambda state: state.study, lambda state, value: replace(state, study=value))
        self._table = gui.add_html("")
        self._charts: list[Any] = []
        self._names: tuple[str, ...] = ()

    def show(self, state: DesignState, study: StudyProblems, answers: Sequence[SolverAnswers]) -> None:
        """Show the answers of solvers: a table, and charts along the study; nothing for one solver alone."""
        if len(answers) < 2:
            answers = []
        table = solver_table(answers)._repr_html_() if answers else "Choose solvers to compare with."
        self._table.content = f'<div style="font-size:11px;margin:.2em .75em">{table}</div>'
        known = {answer.solver: answer.study for answer in answers if answer.study is not None}
        index = state.names.index(state.selected) if state.selected in state.names else 0
        lines = {
            "error N": [allocation.residual for allocation in known.values()],
            f"tension of {state.names[index]} N": [allocation.tensions[:, index] for allocation in known.values()],
        }
        while self._charts and (tuple(known) != self._names or not known):
            self._charts.pop().remove()
        if known and not self._charts:
            series: list[dict[str, Any]] = [{"label": "at"}]
            for name, colour in zip(known, cycle(SERIES_COLOURS), strict=False):
                series.append({"label": name, "stroke": colour, "width": 2, "points": {"show": False}})
            with self._tab:
                self._charts = [
                    self._gui.add_uplot((study.along, *values), tuple(series), title=title, **CHART)
                    for title, values in lines.items()
                ]
        self._names = tuple(known)
        for chart, (title, values) in zip(self._charts, lines.items(), strict=False):
            chart.title = title
            chart.data = (study.along, *values)


def _set_compared(name: str, state: DesignState, compared: bool) -> DesignState:
    others = tuple(other for other in state.compared if other != name)
    return replace(state, compared=(*others, name) if compared else others)
