"""``tensionlab datasets``: what is known by name."""

from __future__ import annotations

from typing import Annotated

import typer

from tensionlab import datasets as stored
from tensionlab.benchmark.problem_sets import problem_set
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json
from tensionlab.errors import DataError
from tensionlab.support.files.named import SUFFIXES
from tensionlab.support.files.reading import read_toml
from tensionlab.support.table import Table

TABLES = {
    "vectors": "directions of the published validation",
    "recordings": "desired, rendered and measured forces of a validation",
    "what-if": "validations of many simulated rigs",
    "benchmarks": "results of the benchmark of solvers",
}  # what the Parquet files of each kind are. Other files say it themselves.
LEGEND = """\
Verbs that take a rig or a space take its name: tensionlab compare ipanema-2. A path ends in .toml or has a "/".
In Python: tl.load_rig("ipanema-2"), tl.datasets.load("vectors/grid18")."""


def datasets(
    kind: Annotated[
        str | None,
        typer.Argument(
            help=f"Only this kind: {', '.join(stored.KINDS)}.",
            autocompletion=options.complete(lambda: stored.KINDS),
        ),
    ] = None,
    json: Json = False,
) -> None:
    """List the rigs and other data sets that are known by name."""
    found = [name.split("/") for name in stored.names(kind)]
    rows = [(each, name, _title(each, name)) for each, name in found]
    if json:
        output.print_json(datasets=[{"kind": each, "name": name, "title": title} for each, name, title in rows])
        return
    kinds = [each if index == 0 or each != rows[index - 1][0] else "" for index, (each, *_) in enumerate(rows)]
    shown = [(each, *row[1:]) for each, row in zip(kinds, rows, strict=True)]
    output.print_table(Table(["kind", "name", "what it is"], shown))
    output.print_prose(f"\n{LEGEND}", "dim")


def _title(kind: str, name: str) -> str:
    """Return what a data set is, in a line or two."""
    if kind == stored.PROBLEMS:
        return problem_set(name, 1).title
    if kind in TABLES:
        return TABLES[kind]
    tables = read_toml(stored.folder() / kind / f"{name}{SUFFIXES[kind]}", "a data set", DataError)
    return str(tables.get("description") or tables["source"])
