"""Results of a benchmark: one row for each problem set, solver and setting, and the Parquet table on disk."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.benchmark import statistics
from tensionlab.benchmark.entries import Entry
from tensionlab.errors import DataError
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import as_path
from tensionlab.support.files.tables import from_mappings, read_parquet
from tensionlab.support.formatting import format_count, format_duration, format_number, format_share, one_line
from tensionlab.support.table import Column, Table

if TYPE_CHECKING:
    import pandas

FILE = "results.parquet"
# Accuracies in N, times the norm of the wrench where that is above 1 N, as the interface verifies.
ACCURACIES = (1e-3, 1e-6, 1e-9)
NAN = float("nan")


@dataclass(frozen=True)
class EntryResult:
    """Result of one solver with one setting on one problem set; NaN where there is nothing to measure.

    ``policy`` is None for a solver without a policy, whose answers to infeasible wrenches are compared with
    "force". ``comparable`` tells whether the objective is that of the sets; if not, the gap is a difference of
    objectives, not an error. ``note`` says why it did not take part, or which part it refused.

    Of the problems in the set, some were ``tried`` in its share of time, of those some ``refused``, ``failed``
    (without tensions) and ``proved`` (with a verified status, EXACT or NEAREST; 0 for baselines, which have none).
    ``solved_1e3`` and the like are shares of the tried ones with an error above the least possible, and raw
    tensions outside their limits, of no more than the accuracy; ``error_max`` and ``violation_max`` are the
    maximum of either, in N. Gaps are largest differences of a tension to a verified optimum, in N.

    Times in s are of one call, each problem the best of its repeats, so that little of the machine's interruptions
    is left: shifted geometric mean, median, quantiles and worst over the problems. ``jitter_s`` is the slowest
    call of all, interruptions included; ``build_s`` the median time to bring the arrays into the baseline's form,
    such as the identity matrix of its cost; ``prebuilt_s`` is ``sgm_s`` without that; ``setup_s`` and ``solve_s``
    are medians by its own clock; ``batch_s`` is the time of a problem in one large batch, for built-in solvers.
    ``iterations_max`` is 0 where none are reported.

    The lists are the evidence for each problem in order (NaN where not tried, refused or failed), and of one
    trajectory: length of the path so far, tensions of all cables row by row, and whether wrenches are feasible.
    ``scales`` are what errors are accurate to: max(1, norm of the wrench), in N.
    """

    problem_set: str
    solver: str
    setting: str
    policy: str | None
    objective: str
    comparable: bool
    note: str
    problems: int
    tried: int = 0
    refused: int = 0
    failed: int = 0
    proved: int = 0
    solved_1e3: float = NAN
    solved_1e6: float = NAN
    solved_1e9: float = NAN
    error_max: float = NAN
    violation_max: float = NAN
    gap_median: float = NAN
    gap_max: float = NAN
    sgm_s: float = NAN
    prebuilt_s: float = NAN
    median_s: float = NAN
    p99_s: float = NAN
    p999_s: float = NAN
    worst_s: float = NAN
    jitter_s: float = NAN
    build_s: float = NAN
    setup_s: float = NAN
    solve_s: float = NAN
    batch_s: float = NAN
    iterations_max: int = 0
    call_s: list[float] = field(default_factory=list, repr=False)
    errors: list[float] = field(default_factory=list, repr=False)
    violations: list[float] = field(default_factory=list, repr=False)
    gaps: list[float] = field(default_factory=list, repr=False)
    scales: list[float] = field(default_factory=list, repr=False)
    path_mm: list[float] = field(default_factory=list, repr=False)
    path_tensions: list[float] = field(default_factory=list, repr=False)
    path_reachable: list[bool] = field(default_factory=list, repr=False)

    @property
    def label(self) -> str:
        """Name in tables and figures."""
        name = "cvxpy" if self.solver == "cvxpy:plain" else self.solver
        return f"{name}, {self.setting}" if self.setting != "proved" else name


# Columns with the measurements of single problems.
EVIDENCE = ("call_s", "errors", "violations", "gaps", "scales", "path_mm", "path_tensions", "path_reachable")
# Field of a result by the name of the quantity in `Results.problems`.
QUANTITIES = {"call_s": "call_s", "error": "errors", "violation": "violations", "gap": "gaps", "scale": "scales"}


@dataclass(frozen=True)
class BatchRow:
    """Seconds of a problem in a large batch, each the best of the rounds; NaN where DAQP is not installed.

    In one `allocate` call, verification included, on one thread and on ``cores``; set-up and solve by DAQP's own
    clock, without its Python wrapper; and in a Python loop over DAQP's own module, its arrays ready. ``gap_max``
    is the largest difference of the tensions, in N; NaN where wrenches are infeasible, for which DAQP has none.
    """

    components: int
    cables: int
    count: int
    reachable: bool
    one_core_s: float
    all_cores_s: float
    cores: int
    daqp_c_s: float
    daqp_loop_s: float
    gap_max: float

    @property
    def ratio(self) -> float:
        """One core's time over DAQP's in C."""
        return self.one_core_s / self.daqp_c_s


@dataclass(frozen=True)
class CallRow:
    """Seconds of one call for one problem.

    ``median_s`` and ``p999_s`` have the machine's interruptions in them, ``quiet_p999_s`` has few: it is the
    99.9 % quantile of each problem's best time of `tensionlab.benchmark.speed.PASSES`.
    """

    components: int
    cables: int
    caller: str
    median_s: float
    p999_s: float
    quiet_p999_s: float


@dataclass(frozen=True)
class Results:
    """All rows of a benchmark, and its manifest.

    The manifest is `provenance.manifest`'s, and under ``bench`` has what the report needs of the run:
    ``sets`` (by name: title, reachable, groups, problems, verified), ``plan``, ``instruction_set``,
    ``processor_share``, ``batches`` and ``calls``.
    """

    rows: tuple[EntryResult, ...]
    manifest: dict[str, Any]

    def __repr__(self) -> str:
        sets = format_count(len(self.sets), "problem set")
        return f"<Results of {len({row.label for row in self.rows})} entries on {sets}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return a row for each entry, over all sets."""
        columns = {
            "label": Column("solver"),
            "solved_1e6": Column("solved", "1e-6 N", format_share),
            "solved_1e9": Column("solved", "1e-9 N", format_share),
            "elsewhere": Column("other sets", format=format_share),
            "gap_max": Column("gap max", "N", format_number),
            "sgm_s": Column("call", format=format_duration),
            "p999_s": Column("p99.9", format=format_duration),
            "worst_s": Column("worst", format=format_duration, wide=True),
            "batch_s": Column("batch each", format=format_duration),
        }
        found = summaries(self)
        rows = [[getattr(line, name) for name in columns] for line in found if not line.absent]
        for row, line in zip(rows, found, strict=False):
            row[0] += " †" * (not line.comparable)
        notes = [
            "solved: share of the problems of the feasible sets, each set counting the same",
            "other sets: share solved to 1e-6 N where wrenches may be infeasible",
            "gap: largest difference of a tension to the verified optimum; †: another objective",
            "call: typical time of one; verification is included, but not for baselines (default, tight)",
        ]
        notes += [f"{line.label}: {one_line(line.note)}" for line in found if line.note]
        return Table([*columns.values()], rows, f"{len(rows)} entries, {len(self.sets)} problem sets", notes)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each problem set, solver, setting and policy, with the fields of `EntryResult`.

        MissingDependency if pandas is not installed.
        """
        rows = [{key: value for key, value in vars(row).items() if key not in EVIDENCE} for row in self.rows]
        return provenance.data_frame(rows)

    def problems(self) -> pandas.DataFrame:
        """Return the long table: a row for each problem set, solver, setting, policy, problem and quantity.

        The quantities are those of `QUANTITIES`; a value is NaN where it was not measured. Empty for the committed
        results, which have none for single problems. MissingDependency if pandas is not installed.
        """
        rows = [(row, name, getattr(row, key)) for row in self.rows for name, key in QUANTITIES.items()]
        sizes = [len(values) for *_, values in rows]
        table: dict[str, Any] = {
            key: np.repeat(np.array([getattr(row, key) for row, *_ in rows], dtype=object), sizes)
            for key in ("problem_set", "solver", "setting", "policy")
        }
        table["problem"] = [number for size in sizes for number in range(size)]
        table["quantity"] = np.repeat([name for _, name, _ in rows], sizes)
        table["value"] = [value for *_, values in rows for value in values]
        return provenance.data_frame(table)

    @property
    def sets(self) -> dict[str, Any]:
        """The problem sets by name, in the order they ran."""
        return dict(self.manifest["bench"]["sets"])

    @property
    def batches(self) -> list[BatchRow]:
        """Times of large batches."""
        return [BatchRow(**row) for row in self.manifest["bench"]["batches"]]

    @property
    def calls(self) -> list[CallRow]:
        """Times of single calls."""
        return [CallRow(**row) for row in self.manifest["bench"]["calls"]]

    def of_set(self, name: str) -> list[EntryResult]:
        """Return the rows of one problem set."""
        return [row for row in self.rows if row.problem_set == name]


def write(path: str | Path, rows: Sequence[EntryResult], manifest: dict[str, Any], evidence: bool = True) -> None:
    """Write results; without the evidence for each problem they are small enough to commit."""
    table = [dataclasses.asdict(row) for row in rows]
    if not evidence:
        table = [{key: value for key, value in row.items() if key not in EVIDENCE} for row in table]
    provenance.write_parquet(path, table, manifest)


def read(path: str | Path) -> Results:
    """Read the results of a benchmark.

    Parameters
    ----------
    path : path
        The folder of a run, or its file of results.

    Raises
    ------
    DataError
        If it holds none.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.benchmark.results import read
    >>> read(tl.datasets.folder() / "benchmarks" / "results.parquet")
    <Results of 35 entries on 8 problem sets>
    """
    file = as_path(path) / FILE if as_path(path).is_dir() else as_path(path)
    table = read_parquet(file, "results of `tensionlab bench` (*.parquet)", DataError)
    bench = table.manifest.get("bench")
    kinds = {"sets": dict, "batches": list, "calls": list}
    if not isinstance(bench, dict) or not all(isinstance(bench.get(key), kind) for key, kind in kinds.items()):
        raise DataError(f"{file}: its manifest describes no run; give results of `tensionlab bench`")
    from_mappings(bench["batches"], BatchRow, f"{file}: batches", DataError)
    from_mappings(bench["calls"], CallRow, f"{file}: calls", DataError)
    return Results(tuple(table.rows(EntryResult, DataError)), table.manifest)


def summaries(results: Results) -> list[Any]:
    """Return each entry over all sets, each set counting the same: by speed, those that did not run last.

    The fields are ``label``, ``note``, ``comparable``, ``built_in`` and, of the entirely feasible sets, or of all
    if there is none: ``solved_1e3``, ``solved_1e6`` and ``solved_1e9``, means over the sets; ``sgm_s``,
    ``prebuilt_s`` and ``batch_s``, geometric means; ``gap_max``, ``p999_s``, ``worst_s``, ``violation_max`` and
    ``spread``, the 99.9 % quantile of time over the median, the largest. ``elsewhere`` is the mean share solved to
    1e-6 N in the other sets, ``iterations_max`` of all; ``absent`` tells whether it did not take part, and
    ``note`` why.
    NaN where there is nothing.
    """
    table = results.to_pandas().assign(
        label=[row.label for row in results.rows], built_in=lambda rows: rows["setting"] == "proved"
    )
    table = table.drop_duplicates(["label", "problem_set"]).replace([np.inf, -np.inf], np.nan)  # its own policy
    table["spread"] = table["p999_s"] / table["median_s"]
    feasible = {name for name, about in results.sets.items() if about["reachable"] == "all"} or set(results.sets)
    inside = table["problem_set"].isin(feasible)
    entries, measured = table.groupby("label", sort=False), table[inside].groupby("label")
    seconds = ["sgm_s", "prebuilt_s", "batch_s"]
    found = entries.agg(
        note=("note", lambda notes: next(filter(None, notes), "")),
        comparable=("comparable", "first"),
        built_in=("built_in", "first"),
        iterations_max=("iterations_max", "max"),
    ).join(
        [
            measured[["solved_1e3", "solved_1e6", "solved_1e9"]].mean(),
            np.exp(np.log(table.loc[inside, seconds]).groupby(table.loc[inside, "label"]).mean()),
            measured[["gap_max", "p999_s", "worst_s", "violation_max", "spread"]].max(),
            table[~inside].groupby("label")["solved_1e6"].mean().rename("elsewhere"),
        ]
    )
    found["absent"] = (found["note"] != "") & found["sgm_s"].isna()
    found = found.sort_values("sgm_s", kind="stable", na_position="last").reset_index()
    return list(found.itertuples(index=False, name="EntrySummary"))


class SampledTrajectory(NamedTuple):
    """One trajectory: (B,) path so far in mm, (B, m) tensions in N, and (B,) where the wrench is feasible."""

    path_mm: Floats
    tensions: Floats
    reachable: NDArray[np.bool_]


@dataclass
class Evidence:
    """Measurements of one entry on P problems, R times each; NaN where there is none.

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
    batch_s: float = NAN
    tensions: dict[int, Floats] = field(default_factory=dict)
    trajectory: SampledTrajectory | None = None


def empty_evidence(scale: Floats, repeats: int) -> Evidence:
    """Return evidence without measurements, for as many problems as there are scales."""
    count = len(scale)
    tried, refused, reachable, proved = np.zeros((4, count), dtype=bool)
    error, violation, gap = np.full((3, count), np.nan)
    iterations, calls = np.zeros(count, dtype=np.int64), np.full((count, repeats, 4), np.nan)
    return Evidence(tried, refused, reachable, proved, scale, error, violation, gap, iterations, calls)


def solved(errors: Floats, violations: Floats, scale: Floats, accuracy: float) -> NDArray[np.bool_]:
    """Return which answers are that accurate; not those that are NaN."""
    return (errors <= accuracy * scale) & (violations <= accuracy * scale)


def summarise(name: str, entry: Entry, evidence: Evidence) -> EntryResult:
    """Return the row of an entry on the problem set of that name."""
    tried = int(evidence.tried.sum())
    # Of each problem the fastest call, (P, 4), with its parts.
    walls = np.where(np.isnan(evidence.calls[:, :, 0]), np.inf, evidence.calls[:, :, 0])
    best = np.take_along_axis(evidence.calls, walls.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    shares = [
        solved(evidence.error, evidence.violation, evidence.scale, accuracy).sum() / tried if tried else np.nan
        for accuracy in ACCURACIES
    ]
    path = evidence.trajectory
    return EntryResult(
        problem_set=name,
        solver=entry.solver,
        setting=entry.setting,
        policy=entry.policy,
        objective=entry.objective,
        comparable=entry.comparable,
        note=evidence.note,
        problems=len(evidence.scale),
        tried=tried,
        refused=int(evidence.refused.sum()),
        failed=int((evidence.tried & ~evidence.refused & np.isnan(evidence.error)).sum()),
        proved=int(evidence.proved.sum()),
        solved_1e3=float(shares[0]),
        solved_1e6=float(shares[1]),
        solved_1e9=float(shares[2]),
        error_max=statistics.maximum(evidence.error),
        violation_max=statistics.maximum(evidence.violation),
        gap_median=statistics.quantile(evidence.gap, 0.5),
        gap_max=statistics.maximum(evidence.gap),
        sgm_s=statistics.shifted_geometric_mean(best[:, 0]),
        prebuilt_s=statistics.shifted_geometric_mean(best[:, 0] - best[:, 1]),
        median_s=statistics.quantile(best[:, 0], 0.5),
        p99_s=statistics.quantile(best[:, 0], 0.99),
        p999_s=statistics.quantile(best[:, 0], 0.999),
        worst_s=statistics.maximum(best[:, 0]),
        jitter_s=statistics.maximum(evidence.calls[:, :, 0]),
        build_s=statistics.quantile(best[:, 1], 0.5),
        setup_s=statistics.quantile(best[:, 2], 0.5),
        solve_s=statistics.quantile(best[:, 3], 0.5),
        batch_s=evidence.batch_s,
        iterations_max=int(evidence.iterations.max(initial=0)),
        call_s=best[:, 0].tolist(),
        errors=evidence.error.tolist(),
        violations=evidence.violation.tolist(),
        gaps=evidence.gap.tolist(),
        scales=evidence.scale.tolist(),
        path_mm=path.path_mm.tolist() if path else [],
        path_tensions=path.tensions.ravel().tolist() if path else [],
        path_reachable=path.reachable.tolist() if path else [],
    )
