"""Replay of a run: the same demands at the same poses by other solvers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, Allocator
from tensionlab.benchmark.comparison import Column, Score, finite, score, scores_table
from tensionlab.benchmark.guarded import guarded
from tensionlab.hardware.log.reader import Run
from tensionlab.solvers import Selected, Solver, select_solvers
from tensionlab.solvers.base import Policy
from tensionlab.support import provenance
from tensionlab.support.formatting import format_count, format_number

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class ReplayRow(Score):
    """Score of one solver on the demands of a run.

    ``fallback_used`` counts unproven answers of the run's solver; in the run's own row those of the fallback are
    in their place, and are scored as its own. Magnitudes are differences of the norms of rendered and desired
    force, in N. The jump is the maximum change of a tension from one cycle to the next, in N, before the runner
    limits it, where the same modules take part in both.
    """

    fallback_used: int
    magnitude_mean: float
    magnitude_max: float
    tension_max: float
    jump_max: float
    iterations_mean: float
    iterations_max: float


COLUMNS: list[Column[ReplayRow]] = [
    ("fall-\nback", lambda row: str(row.fallback_used), False),
    ("error\nmean N", lambda row: format_number(row.residual_mean), False),
    ("error\nmax N", lambda row: format_number(row.residual_max), True),
    ("angle\nmax °", lambda row: format_number(row.angle_max_deg), True),
    ("size\nmax N", lambda row: format_number(row.magnitude_max), False),
    ("mean t²\nN²", lambda row: format_number(row.tension_sq_mean), True),
    ("t max\nN", lambda row: format_number(row.tension_max), False),
    ("jump\nmax N", lambda row: format_number(row.jump_max), True),
    ("iter\nmean", lambda row: format_number(row.iterations_mean), False),
    ("iter\nmax", lambda row: format_number(row.iterations_max), False),
]
"""Of a replay, those after the statuses."""


@dataclass(frozen=True)
class Replay:
    """Rows of solvers on the demands of a run: its own first, as it was, then each solver with its own policy.

    ``cycles`` counts those with a desired wrench; ``missing`` has reasons by the names of solvers left out.
    """

    cycles: int
    rows: tuple[ReplayRow, ...]
    missing: dict[str, str]

    def __repr__(self) -> str:
        return f"<Replay of {self.cycles} cycles by {format_count(len(self.rows) - 1, 'solver')}>"

    def _repr_html_(self) -> str:
        own = replace(self.rows[0], solver=f"the run: {self.rows[0].solver}")
        return scores_table(f"{self.cycles} cycles of a run", [own, *self.rows[1:]], COLUMNS, self.missing)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each solver, as in `ReplayRow`; MissingDependency if pandas is not installed."""
        return provenance.data_frame([vars(row) for row in self.rows])


def replay(
    run: Run, solvers: Sequence[str | Solver] | None = None, progress: Callable[[float], None] | None = None
) -> Replay:
    """Allocate the demands of a run again, by other solvers.

    Each gets the wrenches that the run's solver got, at the poses where the run was, with the run's limits and the
    modules that took part. Where the run would have gone with other answers is not simulated. Solvers are as in
    `select_solvers`; ``progress`` is called with the share that is done.
    """
    runs, missing = select_solvers(solvers, None, (run.rig.n, run.rig.m))
    own: dict[str, Selected] = {}
    for each in runs:  # a solver's own policy is its first
        own.setdefault(each.name, each)
    kept = np.asarray(np.isfinite(run.desired).all(axis=1))
    wrenches = run.solver_wrench[kept]
    rendering = _rendering(run, kept)
    consecutive = (np.diff(run.cycle[kept]) == 1) & (rendering[1:] == rendering[:-1]).all(axis=1)
    dimension = run.rig.dimension

    def row(solver: str, policy: Policy | None, found: Allocation, fallback_used: int) -> ReplayRow:
        norms = [np.linalg.norm(each[:, :dimension], axis=1) for each in (found.wrench, wrenches)]
        return ReplayRow(
            **vars(score(solver, policy, wrenches, found, dimension)),
            fallback_used=fallback_used,
            magnitude_mean=finite(np.mean, abs(norms[0] - norms[1])),
            magnitude_max=finite(np.max, abs(norms[0] - norms[1])),
            tension_max=finite(np.max, found.tensions),
            jump_max=finite(np.max, abs(np.diff(found.tensions, axis=0))[consecutive]),
            iterations_mean=finite(np.mean, found.iterations),
            iterations_max=finite(np.max, found.iterations),
        )

    arrays: dict[str, Any] = {
        name: values[kept] for name, values in vars(run.allocation).items() if isinstance(values, np.ndarray)
    }
    rows = [row(run.setup.solver, run.setup.policy, Allocation(**arrays), int(run.fallback_used[kept].sum()))]
    for done, (name, policy, solver) in enumerate(own.values(), start=1):
        found = answer_again(run, kept, guarded(solver), policy)
        rows.append(row(name, policy, found, 0))
        if progress:
            progress(done / len(own))
    return Replay(int(kept.sum()), tuple(rows), missing)


def answer_again(
    run: Run, cycles: NDArray[np.bool_] | int, solver: str | Solver, policy: Policy | None = None
) -> Allocation:
    """Return what a solver answers to the wrenches that the run's had in some cycles, with its limits.

    Modules that were lost or rendered an impedance have tension 0. Errors as those of `tensionlab.Allocator`.
    """
    rendering = _rendering(run, cycles)
    limits = np.where(rendering, run.setup.lower, 0.0), np.where(rendering, run.setup.upper, 0.0)
    return Allocator(limits, solver, policy=policy)(run.structure[cycles], run.solver_wrench[cycles])


def _rendering(run: Run, cycles: NDArray[np.bool_] | int) -> NDArray[np.bool_]:
    """Return which modules (..., m) were neither lost nor springs in some cycles."""
    return np.asarray(run.active[cycles] & np.isnan(run.impedances[cycles][..., 0]))
