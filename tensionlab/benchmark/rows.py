"""The table of a benchmark: one row for each problem set, solver and setting, with the evidence behind it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.benchmark import statistics
from tensionlab.benchmark.entries import Contestant

ACCURACIES = (1e-3, 1e-6, 1e-9)
"""Accuracies in N, times the norm of the wrench where that is above 1 N, as the interface judges."""


@dataclass(frozen=True)
class Row:
    """What one solver with one setting did on one problem set; NaN where there is nothing to measure.

    Attributes
    ----------
    problem_set, solver, setting, nearest, objective : str
        `nearest` is None for a solver without a policy; its answers out of reach are then judged by "force".
    comparable : bool
        Whether the objective is that of the sets. If not, the gap is a difference of taste, not an error.
    note : str
        Why it did not take part, or which part it refused.
    problems, tried, refused, failed, proved : int
        Problems in the set; of these tried in its share of time; of those refused, without tensions, and with
        a status that is proved (EXACT or NEAREST; 0 for peers, whose answers are measured but not judged).
    solved_1e3, solved_1e6, solved_1e9 : float
        Share of the tried ones with an error above the least possible, and raw tensions outside their limits,
        of no more than the accuracy.
    error_max, violation_max : float
        Largest of either, in N.
    gap_median, gap_max : float
        Largest difference of a tension to the optimum, in N, where the optimum is verified.
    sgm_s, median_s, p99_s, p999_s, worst_s : float
        Time of one call, each problem the best of its repeats: what is left is the solver's, not the
        machine's. Shifted geometric mean, median, quantiles and worst over the problems.
    jitter_s : float
        The slowest call of all, the machine's hiccups included.
    build_s, setup_s, solve_s : float
        Medians: bringing the arrays into the peer's form; set-up and solve by its own clock.
    batch_s : float
        Time a problem in one large batch, for solvers of the house.
    iterations_max : int
        Worst iterations; 0 where it does not tell.
    jump_max : float
        Largest change of a tension along a trajectory, in N/mm.
    call_s, errors, violations, gaps : lists of float
        The evidence, for each problem of the set in order; NaN where not tried, refused or failed.
    path_mm, path_tensions, path_reachable : lists
        Along one trajectory of the set: way so far, the tensions of all cables, row by row, and whether the
        wrench is within reach.
    """

    problem_set: str
    solver: str
    setting: str
    nearest: str | None
    objective: str
    comparable: bool
    note: str
    problems: int
    tried: int = 0
    refused: int = 0
    failed: int = 0
    proved: int = 0
    solved_1e3: float = float("nan")
    solved_1e6: float = float("nan")
    solved_1e9: float = float("nan")
    error_max: float = float("nan")
    violation_max: float = float("nan")
    gap_median: float = float("nan")
    gap_max: float = float("nan")
    sgm_s: float = float("nan")
    median_s: float = float("nan")
    p99_s: float = float("nan")
    p999_s: float = float("nan")
    worst_s: float = float("nan")
    jitter_s: float = float("nan")
    build_s: float = float("nan")
    setup_s: float = float("nan")
    solve_s: float = float("nan")
    batch_s: float = float("nan")
    iterations_max: int = 0
    jump_max: float = float("nan")
    call_s: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    violations: list[float] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)
    path_mm: list[float] = field(default_factory=list)
    path_tensions: list[float] = field(default_factory=list)
    path_reachable: list[bool] = field(default_factory=list)

    @property
    def label(self) -> str:
        """How tables and figures call it."""
        name = "cvxpy" if self.solver == "cvxpy:plain" else self.solver
        return f"{name}, {self.setting}" if self.setting != "proved" else name


EVIDENCE = ("call_s", "errors", "violations", "gaps", "path_mm", "path_tensions", "path_reachable")
"""The columns that a summary can do without."""


@dataclass(frozen=True)
class Path:
    """One trajectory: (B,) way so far in mm, (B, m) tensions in N, and (B,) where the wrench is within reach."""

    way_mm: Floats
    tensions: Floats
    reachable: NDArray[np.bool_]


@dataclass
class Evidence:
    """What was measured of one contestant on P problems, R times each; NaN where nothing was.

    ``scale`` is max(1, norm of the wrench); ``calls`` is the last axis of (P, R, 4): call, build, setup, solve.
    """

    tried: NDArray[np.bool_]
    refused: NDArray[np.bool_]
    reachable: NDArray[np.bool_]
    proved: NDArray[np.bool_]
    scale: Floats
    error: Floats
    violation: Floats
    gap: Floats
    iterations: NDArray[np.int64]
    calls: Floats
    note: str = ""
    batch_s: float = float("nan")
    tensions: dict[int, Floats] = field(default_factory=dict)
    jumps: list[Floats] = field(default_factory=list)
    path: Path | None = None


def empty_evidence(scale: Floats, repeats: int) -> Evidence:
    """Nothing measured yet, for as many problems as there are scales."""
    count = len(scale)

    def no() -> NDArray[np.bool_]:
        return np.zeros(count, dtype=bool)

    def nan() -> Floats:
        return np.full(count, np.nan)

    zeros = np.zeros(count, dtype=np.int64)
    return Evidence(
        no(), no(), no(), no(), scale, nan(), nan(), nan(), zeros, np.full((count, repeats, 4), np.nan)
    )


def solved(errors: Floats, violations: Floats, scale: Floats, accuracy: float) -> NDArray[np.bool_]:
    """Which answers are that accurate? Not those that are NaN."""
    return (errors <= accuracy * scale) & (violations <= accuracy * scale)


def summarise(name: str, contestant: Contestant, evidence: Evidence) -> Row:
    """What does the evidence amount to?"""
    tried = int(evidence.tried.sum())
    best = _best_calls(evidence.calls)
    shares = [
        solved(evidence.error, evidence.violation, evidence.scale, accuracy).sum() / tried if tried else np.nan
        for accuracy in ACCURACIES
    ]
    return Row(
        problem_set=name,
        solver=contestant.solver,
        setting=contestant.setting,
        nearest=contestant.nearest,
        objective=contestant.objective,
        comparable=contestant.comparable,
        note=evidence.note,
        problems=len(evidence.scale),
        tried=tried,
        refused=int(evidence.refused.sum()),
        failed=int((evidence.tried & ~evidence.refused & np.isnan(evidence.error)).sum()),
        proved=int(evidence.proved.sum()),
        solved_1e3=float(shares[0]),
        solved_1e6=float(shares[1]),
        solved_1e9=float(shares[2]),
        error_max=statistics.largest(evidence.error),
        violation_max=statistics.largest(evidence.violation),
        gap_median=statistics.quantile(evidence.gap, 0.5),
        gap_max=statistics.largest(evidence.gap),
        sgm_s=statistics.shifted_geometric_mean(best[:, 0]),
        median_s=statistics.quantile(best[:, 0], 0.5),
        p99_s=statistics.quantile(best[:, 0], 0.99),
        p999_s=statistics.quantile(best[:, 0], 0.999),
        worst_s=statistics.largest(best[:, 0]),
        jitter_s=statistics.largest(evidence.calls[:, :, 0]),
        build_s=statistics.quantile(best[:, 1], 0.5),
        setup_s=statistics.quantile(best[:, 2], 0.5),
        solve_s=statistics.quantile(best[:, 3], 0.5),
        batch_s=evidence.batch_s,
        iterations_max=int(evidence.iterations.max(initial=0)),
        jump_max=statistics.largest(np.concatenate([np.zeros(0), *evidence.jumps])),
        call_s=best[:, 0].tolist(),
        errors=evidence.error.tolist(),
        violations=evidence.violation.tolist(),
        gaps=evidence.gap.tolist(),
        path_mm=evidence.path.way_mm.tolist() if evidence.path else [],
        path_tensions=evidence.path.tensions.ravel().tolist() if evidence.path else [],
        path_reachable=evidence.path.reachable.tolist() if evidence.path else [],
    )


def _best_calls(calls: Floats) -> Floats:
    """Of each problem the fastest call, (P, 4), with its parts."""
    walls = np.where(np.isnan(calls[:, :, 0]), np.inf, calls[:, :, 0])
    chosen = walls.argmin(axis=1)
    return np.asarray(np.take_along_axis(calls, chosen[:, None, None], axis=1)[:, 0])
