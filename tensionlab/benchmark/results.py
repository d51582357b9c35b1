"""Results of a benchmark: a row for each problem set and entry, measurements of each problem, and files."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import DataError, InputError, WriteError
from tensionlab.support import provenance
from tensionlab.support.files import writing
from tensionlab.support.files.reading import as_path
from tensionlab.support.files.tables import check_columns, read_parquet
from tensionlab.support.formatting import format_count, format_duration, format_number, format_share, one_line
from tensionlab.support.table import Column, Table

if TYPE_CHECKING:
    import pandas

FILE, MEASUREMENTS_FILE = "results.parquet", "measurements.parquet"
KIND = "results of `tensionlab bench` (*.parquet)"
# Accuracies in N, times the norm of the wrench where that is above 1 N, as the interface verifies.
ACCURACIES = (1e-3, 1e-6, 1e-9)
KEY = ["problem_set", "solver", "setting", "policy"]  # columns that identify an entry; policy "": none
ID = [*KEY, "problem"]
# Measurements of a problem: time of the fastest call, its part that builds the program, and what the backend's own
# clock says of it, in s; whether it was tried, refused and proved, and is feasible; error, violation of limits and
# gap in N; scale of accuracies, max(1, norm of the wrench).
QUANTITIES = ("call_s", "build_s", "own_s", "tried", "refused", "proved", "reachable", "error", "violation", "gap",
              "scale", "iterations")  # fmt: skip

COUNTS = {
    "problems": Column("problems"),
    "tried": Column("tried"),
    "refused": Column("refused"),
    "failed": Column("failed"),
    "proved": Column("proved"),
    "iterations_max": Column("iterations"),
}
NUMBERS = {
    "solved_1e3": Column("solved", "1e-3 N", format_share),
    "solved_1e6": Column("solved", "1e-6 N", format_share),
    "solved_1e9": Column("solved", "1e-9 N", format_share),
    "error_max": Column("error", "N", format_number),
    "violation_max": Column("limits", "N", format_number),
    "gap_median": Column("gap median", "N", format_number),
    "gap_max": Column("gap max", "N", format_number),
    "sgm_s": Column("call", format=format_duration),
    "prebuilt_s": Column("prebuilt", format=format_duration),
    "own_s": Column("own clock", format=format_duration),
    "median_s": Column("median", format=format_duration),
    "p99_s": Column("p99", format=format_duration),
    "p999_s": Column("p99.9", format=format_duration),
    "worst_s": Column("worst", format=format_duration, wide=True),
    "build_s": Column("build", format=format_duration),
    "batch_s": Column("batch each", format=format_duration),
}
# Types of the columns of `Results.rows`.
TYPES = dict.fromkeys((*KEY, "objective", "note"), "str") | {"comparable": "bool"}
TYPES |= dict.fromkeys(COUNTS, "int") | dict.fromkeys(NUMBERS, "float")
ELSEWHERE = Column("other sets", format=format_share)
SUMMARY_COLUMNS = {"solver": Column("solver"), **COUNTS, **NUMBERS, "elsewhere": ELSEWHERE}  # over all sets
TIMES = ("batch_s", "own_s", "prebuilt_s", "sgm_s", "p999_s")  # from the solver alone to a call as users make it
SHOWN = (*TIMES, "worst_s", "solved_1e6", "solved_1e9", "elsewhere", "gap_max")


@dataclass(frozen=True, eq=False)
class Results:
    """Rows of a benchmark, the measurements of each problem, and the manifest.

    ``rows`` has a row for each problem set, solver, setting and policy, with the columns that
    ``datasets/benchmarks/README.md`` describes and ``label``, the name in tables and figures. NaN where nothing
    was measured. ``policy`` is "" for a solver without one, which is compared with "force".

    The manifest is that of `provenance.manifest`; under ``bench`` it has what the report says of the run: ``sets``
    (by name: title, reachable, groups, problems, verified), ``plan``, ``instruction_set``, ``processor_share``.
    """

    rows: pandas.DataFrame
    manifest: dict[str, Any]
    measurements: pandas.DataFrame | None = None  # by `ID`, ``label`` and `QUANTITIES`; None if committed

    def __post_init__(self) -> None:
        for name in ("rows", "measurements"):
            if (table := getattr(self, name)) is not None:
                solver = table["solver"].replace("cvxpy:plain", "cvxpy")
                setting = (", " + table["setting"]).where(table["setting"] != "proved", "")
                object.__setattr__(self, name, table.assign(label=solver + setting))

    def __repr__(self) -> str:
        sets = format_count(len(self.sets), "problem set")
        return f"<Results of {self.rows['label'].nunique()} entries on {sets}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return a row for each entry, over all sets."""
        summary = self.summary()
        notes = [
            "solved: share of the problems of the feasible sets, each set counting the same",
            "other sets: share solved to 1e-6 N where wrenches may be infeasible",
            "gap: largest difference of a tension to the verified optimum; †: another objective",
            "batch each: of a problem in a batch; own clock: of one call, by a baseline's own compiled code; "
            "prebuilt: its call with matrices made beforehand; call: as users make it",
            "solvers verify in every time, baselines (default, tight) do not",
            *(f"{line.label}: {one_line(line.note)}" for line in summary[summary["note"] != ""].itertuples()),
        ]
        table = summary_table(summary, SHOWN)
        title = f"{len(table.rows)} entries, {format_count(len(self.sets), 'problem set')}"
        return Table(table.columns, table.rows, title, notes)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the long table: a row for each problem set, solver, setting, policy, problem and quantity.

        Quantities that were not measured are left out. InputError for the committed results.
        """
        long = self.each_problem().drop(columns="label").melt(ID, var_name="quantity")
        return long.dropna(subset="value", ignore_index=True)

    def each_problem(self) -> pandas.DataFrame:
        """Return the measurements; InputError where there are none, as in the committed results."""
        if self.measurements is None:
            kept = "use `rows`, or read the folder of a run"
            raise InputError(f"these results have no measurements of single problems: {kept}")
        return self.measurements

    def summary(self) -> pandas.DataFrame:
        """Return each entry over all sets, each set counting the same: by speed, those that did not run last.

        The settings of a solver stay together, in the order they ran, where its fastest belongs.

        The columns are those of `rows`, of the feasible sets: means of shares, geometric means of ``batch_s``,
        ``own_s``, ``prebuilt_s`` and ``sgm_s``, largest values of the others. ``elsewhere`` is the mean share
        solved to 1e-6 N in the other sets; ``absent`` tells whether it did not take part.
        """
        rows = self.rows.drop_duplicates(["label", "problem_set"])  # a solver's own policy is its first
        rows = rows.replace([np.inf, -np.inf], np.nan)
        inside = rows["problem_set"].isin(self.feasible_sets)
        shares = ["solved_1e3", "solved_1e6", "solved_1e9"]
        largest = ["gap_max", "p999_s", "worst_s", "violation_max"]
        times = ["batch_s", "own_s", "prebuilt_s", "sgm_s"]
        by_label, feasible = rows.groupby("label", sort=False), rows[inside].groupby("label")
        parts = [
            feasible[shares].mean(),
            np.exp(np.log(rows[inside].set_index("label")[times]).groupby("label").mean()),
            feasible[largest].max(),
            rows[~inside].groupby("label")["solved_1e6"].mean().rename("elsewhere"),
        ]
        summary = by_label[["solver", "setting", "comparable"]].first().join(parts)
        summary["note"] = by_label["note"].agg(lambda notes: next(filter(None, notes), ""))
        summary["iterations_max"] = by_label["iterations_max"].max()
        summary["absent"] = (summary["note"] != "") & summary["sgm_s"].isna()
        fastest = summary.groupby("solver")["sgm_s"].transform("min")
        return summary.iloc[np.lexsort((summary["solver"], fastest))].reset_index()

    @property
    def sets(self) -> dict[str, Any]:
        """The problem sets by name, in the order they ran."""
        return dict(self.manifest["bench"]["sets"])

    @property
    def feasible_sets(self) -> list[str]:
        """Names of the sets whose wrenches are all feasible; all sets if there is none."""
        return [name for name, about in self.sets.items() if about["reachable"] == "all"] or list(self.sets)


def entry_names(rows: pandas.DataFrame, bold: bool = False) -> list[str]:
    """Return the labels of entries, marked where one has another objective; built-in ones may be in bold."""
    labels = rows["label"]
    if bold:
        labels = labels.mask(rows["setting"] == "proved", "**" + labels + "**")
    return list(labels.where(rows["comparable"], labels + " †"))


def summary_table(summary: pandas.DataFrame, columns: Sequence[str], bold: bool = False) -> Table:
    """Return some columns of `Results.summary`; the notes say which entries did not take part, and why."""
    present = summary[~summary["absent"]]
    rows = zip(entry_names(present, bold), *(present[name] for name in columns), strict=True)
    notes = [f"- {line.label}: {line.note}" for line in summary[summary["absent"]].itertuples()]
    return Table([SUMMARY_COLUMNS[name] for name in ("solver", *columns)], rows, notes=notes)


def write(folder: str | Path, results: Results) -> None:
    """Write results, measurements and manifest into a folder; if refused, a temporary one that the error names."""
    try:
        _write(as_path(folder), results)
    except WriteError as error:
        kept = Path(tempfile.mkdtemp(prefix="tensionlab-bench-"))
        _write(kept, results)
        raise WriteError(f"{error}; the results are kept in {kept}") from None


def _write(place: Path, results: Results) -> None:
    for name, table in ((FILE, results.rows), (MEASUREMENTS_FILE, results.measurements)):
        if table is not None:
            provenance.write_parquet(place / name, dict(table.drop(columns="label").items()), results.manifest)
    writing.write_text(place / "manifest.json", json.dumps(results.manifest, indent=2) + "\n")


def read(path: str | Path) -> Results:
    """Read the results of a benchmark; DataError if there are none.

    The path is the folder of a run, or its file `FILE`, without the measurements of each problem.
    """
    place = as_path(path)
    file = place / FILE if place.is_dir() else place
    manifest, rows = _read_table(file, TYPES)
    bench = manifest.get("bench")
    if not isinstance(bench, dict) or not {"sets", "plan"} <= bench.keys():
        raise DataError(f"{file}: its manifest describes no run; give {KIND}")
    measurements = place / MEASUREMENTS_FILE
    if not (place.is_dir() and measurements.exists()):
        return Results(rows, manifest)
    types = dict.fromkeys(KEY, "str") | {"problem": "int"} | dict.fromkeys(QUANTITIES, "float")
    return Results(rows, manifest, _read_table(measurements, types)[1])


def _read_table(file: Path, types: dict[str, str]) -> tuple[dict[str, Any], Any]:
    """Return the manifest and these columns of a file; DataError if they are not of these types."""
    table = read_parquet(file, KIND, DataError)
    names = table.columns.column_names
    check_columns(names, [*types], names, table.source, DataError)
    frame = table.columns.to_pandas()[[*types]]
    try:
        return table.manifest, frame.assign(policy=frame["policy"].fillna("")).astype(types)
    except (TypeError, ValueError) as problem:
        raise DataError(f"{file}: {one_line(str(problem))}; give {KIND}") from None
