"""Solvers side by side: at the desired wrench, around circles of forces and of places, in all directions."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensionlab.allocation import Allocation, Allocator
from tensionlab.errors import TensionlabError
from tensionlab.model import directions
from tensionlab.model.kinematics import in_space
from tensionlab.solvers import make
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import GREEN, ORANGE, PURPLE, RED, Colours, rgb
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.state import State
from tensionlab.viewer.volume import bounds

CIRCLE_COUNT = 180
FORCE_SHARE = 0.25
"""Of the strongest tension: size of the forces where none is desired."""
RADIUS_SHARE = 0.1
"""Of the size of the rig: radius of the circle of the hand."""
TIMED_CALLS, TIMED_S = 20, 0.05
"""Calls that are timed, and how long that takes at most, but for the first."""


@dataclass(frozen=True)
class Problems:
    """Wrenches one after another, at places.

    Attributes
    ----------
    along : (k,) array
        Where each is along the study: an angle in degrees, or its number.
    ordered : bool
        Whether neighbours are near each other, so that jumps of tensions between them count.
    positions : (k, d) array
        Of the hand, in m.
    forces : (k, d) array
        Desired, in N; the torque is the desired one of the state.
    """

    along: Floats
    ordered: bool
    positions: Floats
    forces: Floats


@dataclass(frozen=True)
class Answer:
    """Answers of one solver: at the desired wrench, and to the problems of a study.

    Attributes
    ----------
    solver : str
        Its name.
    now, study : Allocation or None
        None where ``problem`` says why.
    seconds : float
        Of one call, the median of some.
    jump : float
        Largest change of a tension between neighbours of the study, in N; NaN where they are not ordered.
    problem : str
        Why it has no answers, in words.
    """

    solver: str
    now: Allocation | None = None
    study: Allocation | None = None
    seconds: float = float("nan")
    jump: float = float("nan")
    problem: str = ""


def problems(state: State) -> Problems:
    """Return the problems of the study that a state chooses."""
    d = state.rig.dimension
    force = state.wrench[:d]
    size = float(np.linalg.norm(force)) or FORCE_SHARE * float(state.rig.limits.upper.max())
    if state.study == "force in all directions":
        vectors = directions.grid18() if d == 3 else directions.circle()
        count = len(vectors)
        return Problems(np.arange(float(count)), False, np.tile(state.position, (count, 1)), size * vectors)
    angle = np.linspace(0.0, 360.0, CIRCLE_COUNT, endpoint=False)
    ring = _level(state, np.radians(angle))
    if state.study == "force in a circle":
        return Problems(angle, True, np.tile(state.position, (len(ring), 1)), size * ring)
    low, high = bounds(state.rig)
    places = state.position + RADIUS_SHARE * float((high - low).max()) * ring
    return Problems(angle, True, places, np.tile(force, (len(ring), 1)))


def _level(state: State, angle: Floats) -> Floats:
    """Return unit vectors (k, d) at angles around the vertical axis; in the plane, from its first axis."""
    d = state.rig.dimension
    first, second = (0, 1) if d == 2 else [i for i in range(3) if "xyz"[i] != state.rig.vertical]
    axes = np.eye(d)
    return np.asarray(np.outer(np.cos(angle), axes[first]) + np.outer(np.sin(angle), axes[second]))


def answer(state: State, solver: str, asked: Problems) -> Answer:
    """Return what a solver answers, and how long it takes."""
    rig = state.rig
    d = rig.dimension
    try:
        made = make(solver)
        policy = state.policy if state.policy in made.policies else None
        allocator = Allocator(rig.limits, made, policy=policy)
        here = rig.structure_matrix(state.position, state.rotation, rig.at_rest)
        now = allocator(here, state.exerted)
        wrenches = np.tile(state.exerted, (len(asked.forces), 1))
        wrenches[:, :d] += asked.forces - state.wrench[:d]
        structure = rig.structure_matrix(asked.positions, state.rotation, rig.at_rest)
        found = allocator(structure, wrenches)
    except TensionlabError as error:
        return Answer(solver, problem=str(error))
    seconds: list[float] = []
    while not seconds or (len(seconds) < TIMED_CALLS and sum(seconds) < TIMED_S):
        start = time.perf_counter()
        allocator(here, state.exerted)
        seconds.append(time.perf_counter() - start)
    jump = float("nan")
    if asked.ordered:
        around = np.concatenate([found.tensions, found.tensions[:1]])
        jump = float(np.nanmax(np.abs(np.diff(around, axis=0)), initial=0.0))
    return Answer(solver, now, found, float(np.median(seconds)), jump)


STATUS_COLOURS = {
    Status.EXACT: GREEN,
    Status.NEAREST: ORANGE,
    Status.UNPROVEN: RED,
    Status.FAILED: PURPLE,
}
"""Of the problems in the scene, by how the first solver answers them."""


def points(state: State, asked: Problems, found: Answer) -> tuple[Floats, Colours]:
    """Return where the problems are drawn, (k, 3), in m, and colours (k, 3) by the status of an answer."""
    if found.study is None:
        return np.empty((0, 3)), np.empty((0, 3), np.uint8)
    places = in_space(asked.positions)
    if state.study != "hand in a circle":
        places = places + force_scale(state.rig) * in_space(asked.forces)
    colours = [rgb(STATUS_COLOURS[status]) for status in Status]
    return places, np.stack(colours)[found.study.status]


def compare(state: State, wanted: Callable[[], bool]) -> tuple[Problems, list[Answer]] | None:
    """Return the problems of a state, and the answers of its solver and those compared; None if not wanted."""
    asked = problems(state)
    found = []
    for solver in dict.fromkeys([state.solver, *state.compared]):
        if not wanted():
            return None
        found.append(answer(state, solver, asked))
    return asked, found
