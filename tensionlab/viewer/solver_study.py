"""Solvers side by side: at the desired wrench, around circles of forces and of places, in all directions."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensionlab.allocation import Allocation, Allocator
from tensionlab.errors import TensionlabError
from tensionlab.model import directions
from tensionlab.solvers import make
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.viewer.scene import size
from tensionlab.viewer.state import DesignState

CIRCLE_COUNT = 180
FORCE_SHARE = 0.25  # size of the forces where none is desired, as a share of the strongest tension
RADIUS_SHARE = 0.1  # radius of the circle of the hand, as a share of the size of the rig
TIMED_CALLS, TIMED_S = 20, 0.05  # most calls that are timed, and the time after which no further one begins


@dataclass(frozen=True)
class StudyProblems:
    """Forces at places, one after another.

    Attributes
    ----------
    along : (k,) array
        Position of each in the study: an angle in degrees, or its number.
    positions : (k, d) array
        Places of the hand, in m.
    forces : (k, d) array
        Desired forces, in N; the torque is the desired one of the state.
    """

    along: Floats
    positions: Floats
    forces: Floats


@dataclass(frozen=True)
class SolverAnswers:
    """Answers of one solver: at the desired wrench, and to the problems of a study.

    Attributes
    ----------
    solver : str
        Its name.
    now, study : Allocation or None
        None where ``problem`` says why.
    seconds : float
        Median time of one call.
    problem : str
        Why it has no answers.
    """

    solver: str
    now: Allocation | None = None
    study: Allocation | None = None
    seconds: float = float("nan")
    problem: str = ""

    @property
    def status(self) -> str:
        """Name of the status at the desired wrench."""
        return "" if self.now is None else Status(int(self.now.status)).name

    @property
    def exact(self) -> int:
        """Number of problems of the study that are answered exactly."""
        return 0 if self.study is None else self.study.counts()[Status.EXACT]


def problems(state: DesignState) -> StudyProblems:
    """Return the problems of the study that a state chooses."""
    d = state.rig.dimension
    force = state.wrench[:d]
    strength = float(np.linalg.norm(force)) or FORCE_SHARE * float(state.rig.limits.upper.max())
    if state.study == "force in all directions":
        vectors = directions.grid18() if d == 3 else directions.circle()
        return StudyProblems(
            np.arange(float(len(vectors))), np.tile(state.position, (len(vectors), 1)), strength * vectors
        )
    angle = np.linspace(0.0, 360.0, CIRCLE_COUNT, endpoint=False)
    ring = _level(state, np.radians(angle))
    if state.study == "force in a circle":
        return StudyProblems(angle, np.tile(state.position, (len(ring), 1)), strength * ring)
    places = state.position + RADIUS_SHARE * size(state.rig) * ring
    return StudyProblems(angle, places, np.tile(force, (len(ring), 1)))


def _level(state: DesignState, angle: Floats) -> Floats:
    """Return unit vectors (k, d) at angles around the vertical axis; in the plane, from its first axis."""
    d = state.rig.dimension
    first, second = (0, 1) if d == 2 else [i for i in range(3) if "xyz"[i] != state.rig.vertical]
    axes = np.eye(d)
    return np.asarray(np.outer(np.cos(angle), axes[first]) + np.outer(np.sin(angle), axes[second]))


def answer(state: DesignState, solver: str, study: StudyProblems) -> SolverAnswers:
    """Return the answers of a solver, and how long one takes."""
    rig = state.rig
    d = rig.dimension
    try:
        made = make(solver)
        policy = state.policy if state.policy in made.policies else None
        allocator = Allocator(rig.limits, made, policy=policy)
        here = rig.structure_matrix(state.position, state.rotation, rig.at_rest)
        now = allocator(here, state.exerted)
        wrenches = np.tile(state.exerted, (len(study.forces), 1))
        wrenches[:, :d] += study.forces - state.wrench[:d]
        structure = rig.structure_matrix(study.positions, state.rotation, rig.at_rest)
        found = allocator(structure, wrenches)
    except TensionlabError as error:
        return SolverAnswers(solver, problem=str(error))
    seconds: list[float] = []
    while not seconds or (len(seconds) < TIMED_CALLS and sum(seconds) < TIMED_S):
        start = time.perf_counter()
        allocator(here, state.exerted)
        seconds.append(time.perf_counter() - start)
    return SolverAnswers(solver, now, found, float(np.median(seconds)))


def compare(state: DesignState, wanted: Callable[[], bool]) -> tuple[StudyProblems, list[SolverAnswers]] | None:
    """Return the problems of a state, and the answers of its solver and those compared; None if not wanted."""
    study = problems(state)
    found = []
    for solver in dict.fromkeys([state.solver, *state.compared]):
        if not wanted():
            return None
        found.append(answer(state, solver, study))
    return study, found
