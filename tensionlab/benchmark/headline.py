"""Each contestant in one line over all problem sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from tensionlab.benchmark.results import Results
from tensionlab.benchmark.rows import Row
from tensionlab.benchmark.statistics import largest


@dataclass(frozen=True)
class Headline:
    """What one contestant did over all sets, each set counting the same; NaN where there is nothing.

    Times, gaps and shares "in reach" are those of the sets that are entirely within reach, where every
    contestant has the same question to answer; where there is no such set, of all sets.

    Attributes
    ----------
    label, note : str
    comparable : bool
        As in `Row`.
    house : bool
        Whether it ran through the interface, its answers proved.
    solved_1e3, solved_1e6, solved_1e9 : float
        Mean share of the problems solved to each accuracy, in reach.
    elsewhere : float
        Mean share solved to 1e-6 N in the other sets, out of reach or partly so.
    gap_max : float
        Largest gap to the optimum, in N.
    sgm_s : float
        Geometric mean over the sets of the shifted geometric means of time.
    p999_s, worst_s : float
        Largest of the sets, of the 99.9 % quantile and of the worst time.
    spread : float
        Largest of the sets of the 99.9 % quantile over the median: how far the slow calls are from the usual.
    batch_s : float
        As `sgm_s`, of the batched time.
    iterations_max : int
        Over all sets.
    jump_max : float
        Largest jump of a tension along a trajectory, in N/mm.
    violation_max : float
        Largest violation of a limit by a raw answer, in N, in reach.
    """

    label: str
    note: str
    comparable: bool
    house: bool
    solved_1e3: float
    solved_1e6: float
    solved_1e9: float
    elsewhere: float
    gap_max: float
    sgm_s: float
    p999_s: float
    worst_s: float
    spread: float
    batch_s: float
    iterations_max: int
    jump_max: float
    violation_max: float


def headlines(results: Results) -> list[Headline]:
    """How did each contestant do over all sets? Those that ran by speed, then those that did not."""
    lines: dict[str, dict[str, Row]] = {}
    for row in results.rows:
        # Of several policies the first: the solver's own.
        lines.setdefault(row.label, {}).setdefault(row.problem_set, row)
    in_reach = {name for name, about in results.sets.items() if about["reachable"] == "all"} or set(results.sets)
    found = [_headline(label, list(rows.values()), in_reach) for label, rows in lines.items()]
    return sorted(found, key=lambda line: (np.isnan(line.sgm_s), line.sgm_s))


def _headline(label: str, rows: list[Row], in_reach: set[str]) -> Headline:
    inside = [row for row in rows if row.problem_set in in_reach]
    outside = [row for row in rows if row.problem_set not in in_reach]
    return Headline(
        label=label,
        note=next((row.note for row in rows if row.note), ""),
        comparable=rows[0].comparable,
        house=rows[0].setting == "proved",
        solved_1e3=_mean(row.solved_1e3 for row in inside),
        solved_1e6=_mean(row.solved_1e6 for row in inside),
        solved_1e9=_mean(row.solved_1e9 for row in inside),
        elsewhere=_mean(row.solved_1e6 for row in outside),
        gap_max=_largest(row.gap_max for row in inside),
        sgm_s=_mean((row.sgm_s for row in inside), geometric),
        p999_s=_largest(row.p999_s for row in inside),
        worst_s=_largest(row.worst_s for row in inside),
        spread=_largest(row.p999_s / row.median_s for row in inside),
        batch_s=_mean((row.batch_s for row in inside), geometric),
        iterations_max=max(row.iterations_max for row in rows),
        jump_max=_largest(row.jump_max for row in rows),
        violation_max=_largest(row.violation_max for row in inside),
    )


def geometric(values: np.ndarray) -> float:
    """Which factor is typical?"""
    return float(np.exp(np.log(values).mean()))


def _mean(values: Iterable[float], mean: Callable[[np.ndarray], float] = np.mean) -> float:
    """Mean of the numbers among the values."""
    array = np.array([value for value in values if np.isfinite(value)])
    return float(mean(array)) if array.size else float("nan")


def _largest(values: Iterable[float]) -> float:
    return largest(np.array(list(values), dtype=np.float64))
