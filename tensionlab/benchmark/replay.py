"""Replay of a run: the same wrenches at the same poses by other solvers."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, Allocator
from tensionlab.benchmark.comparison import Comparison, Problems, guarded, score_solvers
from tensionlab.hardware.log.reader import Run
from tensionlab.solvers import Selected, Solver, make, select_solvers
from tensionlab.solvers.base import Policy


def replay(
    run: Run, solvers: Sequence[str | Solver] | None = None, progress: Callable[[float], None] | None = None
) -> Comparison:
    """Allocate the desired wrenches of a run again, by other solvers.

    Each solver gets the wrenches that the run's solver got, at the recorded poses, with the run's limits and the
    modules that took part. How the run would have continued with other answers is not simulated.

    Parameters
    ----------
    run : Run
        From `tensionlab.hardware.read_run`.
    solvers : sequence of str or Solver, optional
        As in `tensionlab.compare`, each with its own policy.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Comparison
        The first row is the run as it was: unproven answers of its solver are replaced by those of the fallback.
        Times are not measured.
    """
    selected, missing = select_solvers(solvers, None, (run.rig.n, run.rig.m))
    own: dict[str, Selected] = {}
    for each in selected:  # a solver's own policy is its first
        own.setdefault(each.name, each)
    kept = np.asarray(np.isfinite(run.desired).all(axis=1))
    rendering = _rendering(run, kept)
    consecutive = (np.diff(run.cycle[kept]) == 1) & (rendering[1:] == rendering[:-1]).all(axis=1)
    arrays: dict[str, Any] = {
        name: values[kept] for name, values in vars(run.allocation).items() if isinstance(values, np.ndarray)
    }
    allocations = [Allocation(**arrays)]
    for done, (_, policy, solver) in enumerate(own.values(), start=1):
        allocations.append(answer_again(run, kept, guarded(solver), policy))
        if progress:
            progress(done / len(own))
    problems = Problems(
        run.structure[kept], run.solver_wrench[kept], _limits(run, kept), run.rig.dimension, consecutive
    )
    recorded = Selected(run.setup.solver, run.setup.policy, make("newton"))
    first, *others = score_solvers(problems, [recorded, *own.values()], allocations)
    first = dataclasses.replace(first, fallback_used=int(run.fallback_used[kept].sum()))
    return Comparison(run.rig, run.position[kept], problems.structure, problems.wrenches, (first, *others),
                      tuple(allocations), missing, consecutive=consecutive, recorded=True)  # fmt: skip


def answer_again(
    run: Run, cycles: NDArray[np.bool_] | int, solver: str | Solver, policy: Policy | None = None
) -> Allocation:
    """Return what a solver answers to the run's wrenches in some cycles, with the run's limits.

    Modules that were lost or rendered an impedance have tension 0. Errors are those of `tensionlab.Allocator`.
    """
    return Allocator(_limits(run, cycles), solver, policy=policy)(run.structure[cycles], run.solver_wrench[cycles])


def _limits(run: Run, cycles: NDArray[np.bool_] | int) -> tuple[Any, Any]:
    rendering = _rendering(run, cycles)
    return np.where(rendering, run.setup.lower, 0.0), np.where(rendering, run.setup.upper, 0.0)


def _rendering(run: Run, cycles: NDArray[np.bool_] | int) -> NDArray[np.bool_]:
    """Return which modules (..., m) were neither lost nor springs in some cycles."""
    return np.asarray(run.active[cycles] & np.isnan(run.impedances[cycles][..., 0]))
