"""``tensionlab problems``: the problem sets of the benchmark, shown or written to a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import output

problems = typer.Typer(
    help="List the problem sets of the benchmark, show one, or export it for other benchmarks.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
Count = Annotated[int, typer.Option(min=1, help="About so many problems in the set.")]
Seed = Annotated[int, typer.Option(min=0, help="The same seed gives the same problems.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")]


@problems.command("list")
def list_sets(json: Json = False) -> None:
    """List the sets: which wrenches can be rendered by construction, and what each set tests."""
    from tensionlab.benchmark.problem_sets import PROBLEM_SETS, problem_set

    found = [problem_set(name, 1) for name in PROBLEM_SETS]
    if json:
        output.print_json(
            {"sets": [{"set": each.name, "reachable": each.reachable, "title": each.title} for each in found]}
        )
        return
    grid = output.table()
    for heading in ("set", "in reach", "what it is"):
        grid.add_column(heading, no_wrap=heading == "set")
    for each in found:
        grid.add_row(each.name, each.reachable, each.title)
    output.console().print(grid)


@problems.command()
def show(
    name: Annotated[str, typer.Argument(metavar="SET", help="Name of a set.", show_default=False)],
    count: Count = 1000,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Show the groups of a set: their size and shape, how many are in reach, how near to singular they are."""
    import numpy as np

    from tensionlab.allocation import allocate
    from tensionlab.benchmark.problem_sets import problem_set
    from tensionlab.solvers.base import Status

    found = problem_set(name, count, seed)
    groups = []
    for group in found.groups:
        statuses = allocate(group.structure, group.wrench, (group.lower, group.upper)).counts()
        groups.append(
            {
                "group": group.label,
                "problems": len(group.wrench),
                "components": group.structure.shape[1],
                "cables": group.structure.shape[2],
                "reachable": statuses[Status.EXACT],
                "condition_median": float(np.median(np.linalg.cond(group.structure))),
                "wrench_median": float(np.median(np.linalg.norm(group.wrench, axis=1))),
            }
        )
    if json:
        answer = {"set": found.name, "title": found.title, "reachable": found.reachable, "groups": groups}
        output.print_json(answer)
        return
    grid = output.table()
    grid.add_column("group")
    for heading in ("problems", "components", "cables", "in reach", "condition\nmedian", "wrench\nmedian"):
        grid.add_column(heading, justify="right")
    for row in groups:
        label, *numbers, condition, wrench = row.values()
        grid.add_row(label, *map(str, numbers), output.short(condition), output.short(wrench))
    console = output.console()
    console.print(f"{found.name}: {found.title}\n", soft_wrap=True)
    console.print(grid)


@problems.command()
def export(
    name: Annotated[str, typer.Option("--set", help="Name of a set.", show_default=False)],
    out: Annotated[
        Path,
        typer.Option(
            callback=output.output_file(".parquet"), help="The Parquet file to write.", show_default=False
        ),
    ],
    count: Count = 1000,
    seed: Seed = 0,
) -> None:
    """Write a set as quadratic programs to a Parquet file, as qpbenchmark's ParquetTestSet reads them."""
    from tensionlab import records
    from tensionlab.benchmark.problem_sets import problem_set, qp_rows

    found = problem_set(name, count, seed)
    rows = qp_rows(found)
    manifest = records.manifest(["tensionlab", *sys.argv[1:]], seed)
    description = {"set": found.name, "title": found.title, "reachable": found.reachable, "count": count}
    records.write_parquet(out, rows, manifest | description)
    output.console().print(f"{found.name}, {len(rows)} problems: {out}", soft_wrap=True)
