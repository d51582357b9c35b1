"""Comparison of solvers on a rig: how many forces of a set each renders, its errors and its time."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.allocation import Allocation, Allocator
from tensionlab.benchmark.guarded import guarded
from tensionlab.errors import InputError
from tensionlab.model import directions as direction_sets
from tensionlab.model.rig import Rig
from tensionlab.solvers import Solver, select_solvers
from tensionlab.solvers.base import POLICIES, Policy, Status
from tensionlab.support import provenance
from tensionlab.support.arrays import MAX_MAGNITUDE, Floats, Integers, angles
from tensionlab.support.arrays import finite as as_finite
from tensionlab.support.formatting import format_count, format_duration, format_number, format_vector
from tensionlab.support.table import STATUS_MARKS, table

if TYPE_CHECKING:
    import pandas

MAX_TIMED_CALLS = 200
"""Vectors that are timed one by one, evenly spread over the set."""

CALLS_PER_TURN = 10
"""Calls that one solver makes before the next one has its turn."""

MAX_TIMED_S = 2.0
"""A slow solver is timed no longer one by one, beyond its first turn."""

TIMED_BATCHES = 5
"""Batches that are timed, one a turn; one alone where it takes longer than `QUICK_BATCH_S`."""

QUICK_BATCH_S = 0.05

PUBLISHED_FORCE_N = 1.5
"""Magnitude of the forces of the published validation."""


@dataclass(frozen=True)
class Score:
    """Statistics of the answers of one solver with one policy; NaN where there is no value.

    How many vectors ended with which verified status; the norm of desired minus rendered wrench, over all that did
    not fail, in N; the angle between desired and rendered force, where one is rendered; and the mean of the
    squared tensions, over modules and vectors, in N².
    """

    solver: str
    policy: Policy | None
    exact: int
    nearest_count: int
    unproven: int
    failed: int
    residual_mean: float
    residual_max: float
    angle_mean_deg: float
    angle_max_deg: float
    tension_sq_mean: float


@dataclass(frozen=True)
class Row(Score):
    """Score and times of one solver with one policy.

    The gap is the maximum difference of a tension to the exact optimum of the same policy, in N; for a solver
    without a policy, over the feasible vectors only: it promises nothing on the others. Times are of an
    `Allocator` call for one vector, verification included, and of one for all vectors, divided by their number.
    """

    gap_max: float
    call_median_s: float
    call_p99_s: float
    batch_s: float


RowType = TypeVar("RowType", bound=Score)
Column = tuple[str, Callable[[RowType], str], bool]
"""Heading, as in `display.table`; the text of a row; and whether a narrow terminal shows the column, too."""

STATUSES: list[Column[Score]] = [
    ("<solver", lambda row: row.solver, True),
    ("<policy", lambda row: row.policy or "–", True),
    ("exact", lambda row: str(row.exact), True),
    ("near", lambda row: str(row.nearest_count), True),
    ("unproven", lambda row: str(row.unproven), True),
    ("fail", lambda row: str(row.failed), False),
]
"""The columns that each table of solvers begins with."""
COLUMNS: list[Column[Row]] = [
    ("error\nmean N", lambda row: format_number(row.residual_mean), False),
    ("error\nmax N", lambda row: format_number(row.residual_max), True),
    ("angle\nmean °", lambda row: format_number(row.angle_mean_deg), False),
    ("angle\nmax °", lambda row: format_number(row.angle_max_deg), True),
    ("mean t²\nN²", lambda row: format_number(row.tension_sq_mean), False),
    ("gap\nmax N", lambda row: format_number(row.gap_max), False),
    ("call\nmedian", lambda row: format_duration(row.call_median_s), True),
    ("call\np99", lambda row: format_duration(row.call_p99_s), False),
    ("batch\neach", lambda row: format_duration(row.batch_s), True),
]


def merge_policies(rows: Sequence[RowType]) -> list[RowType]:
    """Return the rows with one, of policy "any", for a solver whose answers are all exact under each of several.

    Policies differ in what they do with an infeasible wrench: those rows differ in times alone.
    """
    merged: list[RowType] = []
    for _, group in itertools.groupby(rows, key=lambda row: row.solver):
        same = list(group)
        if len(same) > 1 and all(row.nearest_count + row.unproven + row.failed == 0 for row in same):
            same = [dataclasses.replace(same[0], policy="any")]  # type: ignore[arg-type]  # to be shown
        merged += same
    return merged


def scores_table(
    title: str,
    rows: Sequence[RowType],
    columns: Sequence[Column[RowType]],
    missing: Mapping[str, str],
    failures: Mapping[str, str] | None = None,
) -> str:
    """Return a table of solvers in HTML: their statuses, and then these columns; which are left out, or failed."""
    headings = ["<solver", "<policy", *(mark.text for mark in STATUS_MARKS)]
    shown = [*STATUSES, *columns]
    notes = [f"left out: {name}, {reason}" for name, reason in missing.items()]
    notes += [f"failed: {name}, {reason}" for name, reason in (failures or {}).items()]
    return table(
        title,
        [*headings, *(heading for heading, *_ in columns)],
        ([text(row) for _, text, _ in shown] for row in rows),
        notes,
    )


@dataclass(frozen=True)
class Comparison:
    """Rows of every solver with each of its policies on one rig, with body frames at rest.

    At a position (d,) with a structure matrix (n, m): desired wrenches (K, n), and the K answers of each row.
    ``missing`` has reasons by the names of solvers left out. ``magnitude`` is that of the forces in N; None where
    the wrenches are the required ones.
    """

    rig: Rig
    position: Floats
    structure: Floats
    wrenches: Floats
    rows: tuple[Row, ...]
    allocations: tuple[Allocation, ...]
    missing: dict[str, str]
    magnitude: float | None

    @property
    def title(self) -> str:
        """Rig, and number and size of the forces."""
        rig, count = self.rig, len(self.wrenches)
        if self.magnitude is None:
            forces = f"{count} required wrenches"
        else:
            beside = f" beside {rig.required.describe(rig)}" if rig.required else ""
            forces = f"{format_count(count, 'force')} of {self.magnitude:g} N{beside}"
        return f"{rig.name}, {format_count(rig.m, 'module')}: {forces} at {format_vector(self.position)} m"

    def __repr__(self) -> str:
        return f"<Comparison of {format_count(len({row.solver for row in self.rows}), 'solver')} on {self.title}>"

    def _repr_html_(self) -> str:
        return scores_table(self.title, merge_policies(self.rows), COLUMNS, self.missing, self.failures)

    @property
    def failures(self) -> dict[str, str]:
        """By the names of solvers that failed: at how many of the forces, and the first reason."""
        found: dict[str, str] = {}
        for row, allocation in zip(self.rows, self.allocations, strict=True):
            for reason in list(allocation.failures.values())[:1]:
                found.setdefault(row.solver, f"at {row.failed} of {len(self.wrenches)}: {reason}")
        return found

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each solver and policy, as in `Row`; MissingDependency if pandas is not installed."""
        return provenance.data_frame([vars(row) for row in self.rows])


def compare(
    rig: Rig,
    *,
    position: ArrayLike | None = None,
    directions: ArrayLike | str | None = None,
    magnitude: float | None = None,
    solvers: Sequence[str | Solver] | None = None,
    policy: Policy | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare solvers on the same forces, with the same verification.

    Every answer comes from an `Allocator`. Where a solver of yours raises an exception, the force counts as
    failed, and `Comparison.failures` has the reason. The optimum that ``gap_max`` refers to is newton's answer for
    the same policy. The solvers are timed in turns of a few calls, so that a slow moment of the machine hits all
    of them.

    Parameters
    ----------
    rig : Rig
        Its body frames stay at rest. The forces are beside what it requires, such as to hold its weight; where
        that is a set of wrenches, and no directions are given, its corners are compared.
    position : (d,) array, optional
        Where the forces act, in m; left out: the rig's home.
    directions : (K, d) array or str, optional
        Directions of the forces, or the name of a set: ``"grid18"``, ``"fibonacci:N"``, in the plane
        ``"circle:N"``, or a CSV file; left out: the 182 of `grid18`, or 72 on a circle for a planar rig.
    magnitude : float, optional
        Size of each force, in N; left out: the ball that the rig requires, or 1.5 as in the published validation.
    solvers : sequence of str or Solver, optional
        Names, as ``tensionlab solvers`` lists them or ``"module:Class"``, and instances; left out: all by name.
    policy : {"force", "tension", "direction"}, optional
        Only this policy for infeasible wrenches; left out: each that a solver honours.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Comparison
        Shows itself in a notebook; `Comparison.plot` and `Comparison.to_pandas`.

    Raises
    ------
    InputError, UnknownSolver, MissingDependency, PluginError
        Before any work: a solver that cannot be used or does not serve the rig, a magnitude that is none.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation-0.3m")
    >>> result = tl.compare(rig, solvers=[tl.Dykstra(iteration_limit=50), "newton"], policy="tension")
    >>> [(row.solver, row.exact, row.nearest_count) for row in result.rows]
    [('dykstra(iteration_limit=50)', 2, 27), ('newton', 153, 29)]
    """
    runs, missing = select_solvers(solvers, policy, (rig.n, rig.m))
    place = rig.home if position is None else as_finite("position", position, 1)
    structure = rig.structure_matrix(place, frames=rig.at_rest)
    wrenches = rig.required.at(rig)
    if directions is not None or len(wrenches) == 1:
        magnitude = (rig.required.ball or PUBLISHED_FORCE_N) if magnitude is None else magnitude
        if not (isinstance(magnitude, Real) and 0.0 < magnitude < MAX_MAGNITUDE):
            raise InputError(f"magnitude {magnitude} is no size of a force; give newtons, finite and above 0")
        if directions is None:
            directions = direction_sets.grid18() if rig.dimension == 3 else direction_sets.circle()
        if isinstance(directions, str):
            directions = direction_sets.parse(directions)
        forces = magnitude * as_finite("directions", directions, 2)
        wrenches = rig.required.middle(rig) + direction_sets.forces(forces, rig.n, rig.dimension)
    elif magnitude is not None:
        raise InputError(f"magnitude {magnitude}: the required wrenches are compared; give directions as well")
    allocators = [Allocator(rig.limits, guarded(solver), policy=policy) for _, policy, solver in runs]

    def seconds(allocator: Allocator, wrench: Floats) -> float:
        start = time.perf_counter()
        allocator(structure, wrench)
        return time.perf_counter() - start

    chosen = np.unique(np.linspace(0, len(wrenches) - 1, min(len(wrenches), MAX_TIMED_CALLS)).astype(int))
    steps = len(runs) + len(chosen)
    allocations, batch = [], []
    for done, allocator in enumerate(allocators, start=1):
        # The answers themselves are the warm-up: what is timed is always a repeated call.
        allocations.append(allocator(structure, wrenches))
        batch.append([seconds(allocator, wrenches)])
        if progress:
            progress(done / steps)
    calls = np.full((len(chosen), len(runs)), np.nan)
    for turn, first in enumerate(range(0, len(chosen), CALLS_PER_TURN)):
        for column, allocator in enumerate(allocators):
            if np.nansum(calls[:, column]) > MAX_TIMED_S:
                continue
            if turn < TIMED_BATCHES and batch[column][0] < QUICK_BATCH_S:
                batch[column].append(seconds(allocator, wrenches))
            allocator(structure, wrenches[chosen[first]])  # fills the caches with its own data
            for call in range(first, min(first + CALLS_PER_TURN, len(chosen))):
                calls[call, column] = seconds(allocator, wrenches[chosen[call]])
        if progress:
            progress((len(runs) + min(first + CALLS_PER_TURN, len(chosen))) / steps)

    optima = {
        each: Allocator(rig.limits, "newton", policy=each)(structure, wrenches)
        for each in {run.policy or POLICIES[0] for run in runs}
    }
    rows = []
    for column, ((name, honoured, _), found) in enumerate(zip(runs, allocations, strict=True)):
        optimum = optima[honoured or POLICIES[0]]
        gaps = abs(found.tensions - optimum.tensions)
        row = Row(
            **vars(score(name, honoured, wrenches, found, rig.dimension)),
            gap_max=finite(np.max, gaps[optimum.status == Status.EXACT] if honoured is None else gaps),
            call_median_s=float(np.nanmedian(calls[:, column])),
            call_p99_s=float(np.nanquantile(calls[:, column], 0.99)),
            batch_s=float(np.median(batch[column])) / len(wrenches),
        )
        rows.append(row)
    return Comparison(rig, place, structure, wrenches, tuple(rows), tuple(allocations), missing, magnitude)


def score(solver: str, policy: Policy | None, wrenches: Floats, found: Allocation, dimension: int) -> Score:
    """Return the score of K answers to desired wrenches (K, n), whose first components are the force."""
    angle = angles(wrenches[:, :dimension], found.wrench[:, :dimension])
    counts = found.counts()
    return Score(
        solver=solver,
        policy=policy,
        exact=counts[Status.EXACT],
        nearest_count=counts[Status.NEAREST],
        unproven=counts[Status.UNPROVEN],
        failed=counts[Status.FAILED],
        residual_mean=finite(np.mean, found.residual),
        residual_max=finite(np.max, found.residual),
        angle_mean_deg=finite(np.mean, angle),
        angle_max_deg=finite(np.max, angle),
        tension_sq_mean=finite(np.mean, found.tensions**2),
    )


def finite(statistic: Callable[[Any], Any], values: Floats | Integers) -> float:
    """Return a statistic of the entries that are numbers; NaN where there is none."""
    values = values[np.isfinite(values)]
    return float(statistic(values)) if values.size else np.nan
