"""The results of a benchmark on disk: one Parquet table with its manifest, which is all that a report needs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensionlab import records
from tensionlab.benchmark.batches import BatchRow
from tensionlab.benchmark.calls import CallRow
from tensionlab.benchmark.rows import EVIDENCE, Row
from tensionlab.errors import ShapeError
from tensionlab.files.tables import from_mappings, read_parquet

FILE = "results.parquet"


@dataclass(frozen=True)
class Results:
    """What was measured, and how.

    Attributes
    ----------
    rows : tuple of Row
    manifest : dict
        That of `tensionlab.records`, and under ``bench`` what the report tells of the run:
        ``sets`` (by name: title, reachable, groups, problems, verified), ``plan``, ``instruction_set``,
        ``processor_share``, ``batches`` and ``calls``.
    """

    rows: tuple[Row, ...]
    manifest: dict[str, Any]

    @property
    def sets(self) -> dict[str, dict[str, Any]]:
        """The problem sets by name, in the order they ran."""
        found: dict[str, dict[str, Any]] = self.manifest["bench"]["sets"]
        return found

    @property
    def batches(self) -> list[BatchRow]:
        """The batched measurements."""
        return [BatchRow(**row) for row in self.manifest["bench"]["batches"]]

    @property
    def calls(self) -> list[CallRow]:
        """The single calls measured beside them."""
        return [CallRow(**row) for row in self.manifest["bench"]["calls"]]

    def of_set(self, name: str) -> list[Row]:
        """The rows of one problem set."""
        return [row for row in self.rows if row.problem_set == name]


def write(path: str | Path, rows: Sequence[Row], manifest: dict[str, Any], evidence: bool = True) -> None:
    """Write results; without the evidence for each problem they are small enough to commit."""
    table = [dataclasses.asdict(row) for row in rows]
    if not evidence:
        table = [{key: value for key, value in row.items() if key not in EVIDENCE} for row in table]
    records.write_parquet(path, table, manifest)


def read(path: str | Path) -> Results:
    """Which results does a file, or the folder of a run, hold?

    Raises
    ------
    ShapeError
        If it holds none.
    """
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    table = read_parquet(file, "results of `tensionlab bench` (*.parquet)", ShapeError)
    bench = table.manifest.get("bench")
    kinds = {"sets": dict, "batches": list, "calls": list}
    if not isinstance(bench, dict) or not all(isinstance(bench.get(key), kind) for key, kind in kinds.items()):
        raise ShapeError(f"{file}: its manifest tells of no run; give results of `tensionlab bench`")
    from_mappings(bench["batches"], BatchRow, f"{file}: batches", ShapeError)
    from_mappings(bench["calls"], CallRow, f"{file}: calls", ShapeError)
    return Results(tuple(table.rows(Row, ShapeError)), table.manifest)
