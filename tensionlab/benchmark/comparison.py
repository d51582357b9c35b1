"""Comparison of solvers on a rig: the same wrenches at one position or along a trajectory."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.allocation import Allocation, Allocator
from tensionlab.benchmark.continuity import Continuity, measure_continuity, path_of
from tensionlab.benchmark.entries import guarded
from tensionlab.benchmark.speed import seconds, take_turns
from tensionlab.errors import InputError, ShapeError
from tensionlab.model import directions as direction_sets
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig
from tensionlab.solvers import Selected, Solver, select_solvers
from tensionlab.solvers.base import POLICIES, Policy, Status
from tensionlab.support import provenance
from tensionlab.support.arrays import MAX_MAGNITUDE, Floats, Integers, angles, require_finite
from tensionlab.support.formatting import format_count, format_duration, format_number, format_vector, one_line
from tensionlab.support.table import Column, Table
from tensionlab.trajectory import Trajectory, inverse_dynamics
from tensionlab.workspace.poses import PoseList

if TYPE_CHECKING:
    import pandas

MAX_TIMED_CALLS = 200  # largest number of wrenches that are timed one by one, evenly spread
CALLS_PER_TURN = 10  # calls of one solver before the next solver's turn
MAX_TIMED_S = 0.1  # time after which a slow solver is not timed any further, beyond its first turn
TIMED_BATCHES = 5  # number of timed batches, one a turn; a batch longer than `QUICK_BATCH_S` is timed once
QUICK_BATCH_S = 0.05
NO_PATH = Continuity(np.nan, np.nan, np.nan)
LEGEND = {
    "any": "all wrenches are feasible, so the policy makes no difference",
    "exact": "limits kept, wrench rendered",
    "near": "certified infeasible, the policy's best substitute found",
    "unproven": "the solver stopped early, or promises no substitute",
    "fail": "the solver raised an error",
    "error": "desired minus rendered",
    "angle": "between the desired and the rendered force",
    "t": "tension",
    "t²": "squared tension of a cable",
    "jump": "of a tension on the way, found by halving",
    "beyond": "infeasible wrenches as well",
    "step": "largest change of a tension from one sample to the next without a jump, of feasible wrenches",
    "gap": "largest difference of a tension to the exact optimum (newton's); without a policy, where feasible",
    "call": "one wrench, verification included",
    "batch": "all wrenches in one call, time for each",
}  # what the headings of a comparison mean
PUBLISHED_FORCE_N = 1.5  # magnitude of the forces of the published validation


@dataclass(frozen=True)
class Score:
    """Statistics of the answers of one solver with one policy, with their columns; NaN where there is no value."""

    solver: Annotated[str, Column("solver")]
    policy: Annotated[Policy | None, Column("policy")]
    # Number of wrenches by verified status.
    exact: Annotated[int, Column("exact")]
    nearest_count: Annotated[int, Column("near")]
    unproven: Annotated[int, Column("unproven")]
    failed: Annotated[int, Column("fail", wide=True)]
    # Norm of desired minus rendered wrench, and angle between desired and rendered force.
    residual_mean: Annotated[float, Column("error mean", "N", format_number, wide=True)]
    residual_max: Annotated[float, Column("error max", "N", format_number)]
    angle_mean_deg: Annotated[float, Column("angle mean", "°", format_number, wide=True)]
    angle_max_deg: Annotated[float, Column("angle max", "°", format_number)]
    tension_sq_mean: Annotated[float, Column("mean t²", "N²", format_number, wide=True)]
    tension_max: Annotated[float, Column("t max", "N", format_number, wide=True)]
    # Along a trajectory, as in `Continuity`.
    jump: Annotated[float, Column("jump", "N", format_number)]
    jump_beyond: Annotated[float, Column("jump beyond", "N", format_number)]
    step_max: Annotated[float, Column("step max", "N", format_number)]
    iterations_max: Annotated[float, Column("iter max", wide=True)]
    # Largest difference of a tension to the exact optimum; without a policy, where feasible.
    gap_max: Annotated[float, Column("gap max", "N", format_number, wide=True)]
    # Of an `Allocator` call for one wrench, verification included; and per wrench in one call for all.
    call_median_s: Annotated[float, Column("call median", format=format_duration)]
    call_p99_s: Annotated[float, Column("call p99", format=format_duration, wide=True)]
    batch_s: Annotated[float, Column("batch each", format=format_duration)]


# Columns left out at one position, and along a trajectory.
POSITION_OMITS = ("tension_max", "jump", "jump_beyond", "step_max", "iterations_max")
TRAJECTORY_OMITS = ("angle_mean_deg", "gap_max")


@dataclass(frozen=True)
class Comparison:
    """Answers of every solver with each of its policies to the same K wrenches."""

    rig: Rig  # with body frames at rest
    position: Floats  # where the wrenches act, in m: (d,), or (K, d) for the samples of a trajectory
    structure: Floats  # structure matrix there, (n, m) or (K, n, m)
    wrenches: Floats  # desired, (K, n), in N and N·m
    rows: tuple[Score, ...]  # of each solver and policy
    allocations: tuple[Allocation, ...]  # the K answers behind each row
    missing: dict[str, str]  # reasons by the names of solvers left out
    magnitude: float | None = None  # size of the forces, in N; None where wrenches were given or required
    times: Floats | None = None  # of the samples, (K,), in s; None without a `Trajectory`

    @property
    def along_trajectory(self) -> bool:
        """Whether the wrenches are the samples of a trajectory."""
        return self.position.ndim == 2

    @property
    def own_policies(self) -> dict[str, int]:
        """Which row has each solver with its own policy, which is its first, by the name of the solver."""
        names = [row.solver for row in self.rows]
        return {name: names.index(name) for name in names}

    @property
    def title(self) -> str:
        """Rig, and number and size of the wrenches."""
        rig, count = self.rig, len(self.wrenches)
        name = f"{rig.name}, {format_count(rig.m, 'module')}"
        if self.along_trajectory:
            return f"{name}: {format_count(count, 'sample')} of a trajectory"
        if self.magnitude is None:
            forces = f"{count} required wrenches"
        else:
            added = f" added to {rig.required.describe(rig)}" if rig.required else ""
            word = "force" if rig.has_position else "torque"
            forces = f"{format_count(count, word)} of {self.magnitude:g} {KINDS[rig.kind].force_unit}{added}"
        return f"{name}: {forces} at {format_vector(self.position)} m"

    def __repr__(self) -> str:
        return f"<Comparison of {format_count(len({row.solver for row in self.rows}), 'solver')} on {self.title}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return a row for each solver and policy; notes say why some solvers are left out or failed."""
        omitted = TRAJECTORY_OMITS if self.along_trajectory else POSITION_OMITS
        hints = get_type_hints(Score, include_extras=True)
        columns = {name: hint.__metadata__[0] for name, hint in hints.items() if name not in omitted}
        for name in ("residual_mean", "residual_max"):
            columns[name] = replace(columns[name], unit=KINDS[self.rig.kind].force_unit)
        cells = ([getattr(row, name) for name in columns] for row in merge_policies(self.rows))
        notes = [f"left out: {name}, {reason}" for name, reason in self.missing.items()]
        notes += [f"failed: {name}, {one_line(reason)}" for name, reason in self.failures.items()]
        return Table([*columns.values()], cells, self.title, notes, LEGEND)

    @property
    def failures(self) -> dict[str, str]:
        """Number of failed wrenches and the first reason, by the name of the solver."""
        reasons: dict[str, str] = {}
        for row, allocation in zip(self.rows, self.allocations, strict=True):
            for reason in list(allocation.failures.values())[:1]:
                reasons.setdefault(row.solver, f"at {row.failed} of {len(self.wrenches)}: {reason}")
        return reasons

    def to_pandas(self) -> pandas.DataFrame:
        """Return the long table: a row for each solver, policy, problem and quantity, with its value.

        The quantities are the status, the residual in N, the angle between desired and rendered force in degrees,
        the number of iterations, and the tension of each module in N.
        """
        answers, problems, d = self.allocations, len(self.wrenches), self.rig.dimension
        columns = {
            "solver": np.repeat([row.solver for row in self.rows], problems),
            "policy": np.repeat([row.policy for row in self.rows], problems),
            "problem": np.tile(np.arange(problems), len(answers)),
            "status": np.concatenate([answer.status for answer in answers]),
            "residual": np.concatenate([answer.residual for answer in answers]),
            "angle_deg": np.concatenate(
                [angles(self.wrenches[:, :d], answer.wrench[:, :d]) for answer in answers]
            ),
            "iterations": np.concatenate([answer.iterations for answer in answers]),
        }
        for number, module in enumerate(self.rig.modules):
            columns[f"tension.{module.name}"] = np.concatenate([answer.tensions[:, number] for answer in answers])
        return provenance.data_frame(columns).melt(["solver", "policy", "problem"], var_name="quantity")


def merge_policies(rows: Sequence[Score]) -> list[Score]:
    """Return the rows with one, of policy "any", for a solver whose answers are all exact under each policy."""
    merged: list[Score] = []
    for _, group in itertools.groupby(rows, key=lambda row: row.solver):
        same = list(group)
        if len(same) > 1 and all(row.nearest_count + row.unproven + row.failed == 0 for row in same):
            same = [replace(same[0], policy="any")]  # type: ignore[arg-type]  # to be shown
        merged += same
    return merged


def compare(
    rig: Rig,
    wrenches: ArrayLike | None = None,
    *,
    poses: Trajectory | PoseList | ArrayLike | None = None,
    position: ArrayLike | None = None,
    directions: ArrayLike | str | None = None,
    magnitude: float | None = None,
    solvers: Sequence[str | Solver] | None = None,
    policy: Policy | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare solvers on the same wrenches, with the same verification.

    With wrenches or poses, these are the samples of a trajectory, one after another. Otherwise forces of one
    magnitude in many directions are compared at one position. Both are added to what the rig requires, such as
    the weight of its platform; a set of required wrenches is compared at its corners unless directions are given.

    If your own solver raises an exception, the wrench counts as failed, and `Comparison.failures` has the reason.
    Solvers are timed in turns of a few calls, so that a slow moment of the machine affects all of them.

    Parameters
    ----------
    rig : Rig
        Its body frames stay at rest.
    wrenches : (K, n), (K, d), (n,) or (d,) array, optional
        Wrench at each sample, in N and N·m; d components are a force, one wrench is for all poses. Left out: that
        of the poses, or zero.
    poses : Trajectory, PoseList or (K, d) array, optional
        Pose at each sample, or positions in m; left out: ``position`` throughout. The wrenches along a
        `tensionlab.Trajectory` are its `tensionlab.inverse_dynamics`, or those given and nothing else.
    position : (d,) array, optional
        Position of all wrenches, in m; left out: the rig's home.
    directions : (K, d) array or str, optional
        Directions of the forces, or the name of a set: ``"grid18"``, ``"fibonacci:N"``, in the plane
        ``"circle:N"``, or a CSV file; left out: the 182 of `grid18`, or 72 on a circle for a planar rig.
    magnitude : float, optional
        Size of each force, in N; left out: the ball that the rig requires, the weight of its platform, or 1.5 as
        in the published validation.
    solvers : sequence of str or Solver, optional
        Names, as ``tensionlab solvers`` lists them or ``"module:Class"``, and instances; left out: all by name.
    policy : {"force", "tension", "direction"}, optional
        Only this policy for infeasible wrenches; left out: each that a solver supports.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Comparison
        `tensionlab.plot` draws it, `Comparison.to_pandas` has all answers.

    Raises
    ------
    InputError, ShapeError, UnknownSolver, MissingDependency, PluginError
        Before any work: a solver that cannot be used or does not support the rig; wrenches, poses or a magnitude
        that do not fit.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation-0.3m")
    >>> result = tl.compare(rig, solvers=[tl.solvers.Dykstra(iteration_limit=50), "newton"], policy="tension")
    >>> [(row.solver, row.exact, row.nearest_count) for row in result.rows]
    [('dykstra(iteration_limit=50)', 2, 27), ('newton', 153, 29)]
    """
    runs, missing = select_solvers(solvers, policy, (rig.n, rig.m))
    if wrenches is not None or poses is not None:
        if directions is not None or magnitude is not None:
            raise InputError("wrenches or poses are a trajectory; leave out directions and magnitude")
        place, rotation, desired = _along(rig, wrenches, poses, position)
        path = path_of(rig, place, rotation, desired)
        structure = path(np.arange(float(len(place))))[0]
    else:
        path = None
        place = rig.home if position is None else require_finite("position", position, 1)
        structure = rig.structure_matrix(place, frames=rig.at_rest)
        desired, magnitude = _directed(rig, directions, magnitude)
    answers: list[Answers] = []
    of_run: list[Answers] = []
    for run in runs:
        same = answers and of_run[-1].name == run.name and (of_run[-1].allocation.status == Status.EXACT).all()
        if not same:  # what is feasible has the same answers under each policy
            answers.append(_answer(run, rig, structure, desired))
        of_run.append(answers[-1])
    _time_calls(answers, structure, desired, progress or (lambda _: None))
    optima = {
        policy: Allocator(rig.limits, "newton", policy=policy)(structure, desired)
        for policy in {run.policy or POLICIES[0] for run in runs}
    }
    if path is not None:
        for answer in answers:
            answer.continuity = measure_continuity(answer.allocator, path, answer.allocation)
    scored = zip(runs, of_run, strict=True)
    rows = [_score(place, run, desired, answer, optima[run.policy or POLICIES[0]]) for run, answer in scored]
    at = poses.times if isinstance(poses, Trajectory) else None
    allocations = tuple(answer.allocation for answer in of_run)
    return Comparison(rig, place, structure, desired, tuple(rows), allocations, missing, magnitude, at)


@dataclass
class Answers:
    """Answers of a solver; times in s of whole batches and of single calls, NaN where not timed."""

    name: str
    allocator: Allocator
    allocation: Allocation
    batches: list[float]
    calls: Floats
    continuity: Continuity = NO_PATH


def _answer(run: Selected, rig: Rig, structure: Floats, wrenches: Floats) -> Answers:
    """Return the answers of a solver to all wrenches, and how long they took after a first call."""
    allocator = Allocator(rig.limits, guarded(run.solver), policy=run.policy)
    allocator(structure[:1] if structure.ndim == 3 else structure, wrenches[:1])
    began = time.perf_counter()
    allocation = allocator(structure, wrenches)
    calls = np.full(min(len(wrenches), MAX_TIMED_CALLS), np.nan)
    return Answers(run.name, allocator, allocation, [time.perf_counter() - began], calls)


def _along(
    rig: Rig,
    wrenches: ArrayLike | None,
    poses: Trajectory | PoseList | ArrayLike | None,
    position: ArrayLike | None,
) -> tuple[Floats, Floats | None, Floats]:
    """Return positions, rotations and desired wrenches of the samples of a trajectory."""
    if isinstance(poses, Trajectory):
        desired = inverse_dynamics(rig, poses) if wrenches is None else require_finite("wrenches", wrenches, 1)
        if desired.shape != (len(poses.times), rig.n) or position is not None:
            raise ShapeError(f"give ({len(poses.times)}, {rig.n}) wrenches along the trajectory, and no position")
        return poses.position, poses.rotation, desired
    if wrenches is None and isinstance(poses, PoseList):
        wrenches = poses.wrench
    given = require_finite("wrenches", np.zeros(rig.n) if wrenches is None else wrenches, 1)
    if given.ndim > 2 or given.shape[-1] not in (rig.n, rig.dimension):
        raise ShapeError(f"wrenches have shape {given.shape}; give (K, {rig.n}) or (K, {rig.dimension})")
    if given.shape[-1] < rig.n:
        given = direction_sets.forces(given.reshape(-1, rig.dimension), rig.n, rig.dimension)
    given = given.reshape(-1, rig.n)
    if poses is None:
        place = np.tile(rig.home if position is None else require_finite("position", position, 1), (len(given), 1))
        rotation = None
    elif position is not None:
        raise InputError("poses and position are both given; leave one out")
    else:
        listed = poses if isinstance(poses, PoseList) else PoseList(require_finite("poses", poses, 2))
        place, rotation = listed.arrays()
    if len(given) not in (1, len(place)):
        raise ShapeError(f"{len(given)} wrenches for {len(place)} poses; give as many, or one")
    desired = np.broadcast_to(given + rig.required.middle(rig, rotation), (len(place), rig.n)).copy()
    return place, rotation, desired


def _directed(
    rig: Rig, directions: ArrayLike | str | None, magnitude: float | None
) -> tuple[Floats, float | None]:
    """Return the desired wrenches at one position, and the size of their forces."""
    wrenches = rig.required.at(rig)
    if directions is None and len(wrenches) > 1:
        if magnitude is not None:
            raise InputError(f"magnitude {magnitude}: required wrenches are compared; give directions as well")
        return wrenches, None
    if magnitude is None:
        own_weight = 0.0 if rig.weight is None else float(np.linalg.norm(rig.weight[: rig.dimension]))
        magnitude = rig.required.ball or own_weight or PUBLISHED_FORCE_N
    if not (isinstance(magnitude, Real) and 0.0 < magnitude < MAX_MAGNITUDE):
        raise InputError(f"magnitude {magnitude} is no size of a force; give newtons, finite and above 0")
    if directions is None:
        directions = direction_sets.grid18() if rig.dimension == 3 else direction_sets.circle()
    if isinstance(directions, str):
        directions = direction_sets.parse(directions)
    forces = magnitude * require_finite("directions", directions, 2)
    return rig.required.middle(rig) + direction_sets.forces(forces, rig.n, rig.dimension), magnitude


def _time_calls(
    answers: Sequence[Answers], structure: Floats, wrenches: Floats, progress: Callable[[float], None]
) -> None:
    """Time calls of each solver for single wrenches, evenly spread, and more batches of quick ones."""
    count = len(answers[0].calls)
    structures = np.broadcast_to(structure, (len(wrenches), *structure.shape[-2:]))
    chosen = np.linspace(0, len(wrenches) - 1, count).astype(int)

    def time_call(solver: int, call: int) -> float:
        return seconds(answers[solver].allocator, structures[chosen[call]], wrenches[chosen[call]])

    def turns() -> Iterator[tuple[range, dict[int, Callable[[int], float]]]]:
        for turn, first in enumerate(range(0, count, CALLS_PER_TURN)):
            timed = [index for index, answer in enumerate(answers) if np.nansum(answer.calls) <= MAX_TIMED_S]
            for answer in answers if turn < TIMED_BATCHES else ():
                if answer.batches[0] < QUICK_BATCH_S:
                    answer.batches.append(seconds(answer.allocator, structure, wrenches))
            last = min(first + CALLS_PER_TURN, count)
            yield range(first, last), {index: partial(time_call, index) for index in timed}
            progress(last / count)

    for solver, call, spent in take_turns(turns(), np.random.default_rng(0)):
        answers[solver].calls[call] = spent


def _score(place: Floats, run: Selected, desired: Floats, answers: Answers, best: Allocation) -> Score:
    """Return the statistics of the answers of one solver at one position, or along a trajectory."""
    allocation, continuity = answers.allocation, answers.continuity
    d, counts = place.shape[-1], allocation.counts()
    angle, gaps = angles(desired[:, :d], allocation.wrench[:, :d]), abs(allocation.tensions - best.tensions)
    return Score(
        solver=run.name,
        policy=run.policy,
        exact=counts[Status.EXACT],
        nearest_count=counts[Status.NEAREST],
        unproven=counts[Status.UNPROVEN],
        failed=counts[Status.FAILED],
        residual_mean=_finite(np.mean, allocation.residual),
        residual_max=_finite(np.max, allocation.residual),
        angle_mean_deg=_finite(np.mean, angle),
        angle_max_deg=_finite(np.max, angle),
        tension_sq_mean=_finite(np.mean, allocation.tensions**2),
        tension_max=_finite(np.max, allocation.tensions),
        jump=continuity.jump,
        jump_beyond=continuity.beyond,
        step_max=continuity.step,
        iterations_max=_finite(np.max, allocation.iterations),
        gap_max=_finite(np.max, gaps[best.status == Status.EXACT] if run.policy is None else gaps),
        call_median_s=float(np.nanmedian(answers.calls)),
        call_p99_s=float(np.nanquantile(answers.calls, 0.99)),
        batch_s=float(np.median(answers.batches)) / len(desired),
    )


def _finite(statistic: Callable[[Any], Any], values: Floats | Integers) -> float:
    """Return a statistic of the finite entries; NaN where there is none."""
    values = values[np.isfinite(values)]
    return float(statistic(values)) if values.size else np.nan
