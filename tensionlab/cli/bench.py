"""``tensionlab bench``: every solver and every baseline on the problem sets, as a table, a report and figures."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.errors import ShapeError, WriteError
from tensionlab.files.writing import make_folder, write_text

if TYPE_CHECKING:
    from tensionlab.benchmark.results import Results

COLUMNS = (
    "solver",
    "solved\n1e-6 N",
    "solved\n1e-9 N",
    "else-\nwhere",
    "gap\nmax N",
    "call",
    "p99.9",
    "batch\neach",
)
LEGEND = """\
solved: share of feasible wrenches, that accurate   elsewhere: to 1e-6 N, where wrenches are or may be infeasible
gap: largest difference of a tension to the verified optimum; † has another objective
call: typical time of one; for built-in solvers, in bold, verification included"""


def bench(
    out: Annotated[
        Path,
        typer.Option(
            callback=output.output_folder(parents=True),
            help="Folder for the results; made if it is not there.",
            show_default=False,
        ),
    ],
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="A,B,...", help="Problem sets, also repeated; all if left out."),
    ] = None,
    solvers: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A,B,...", help="Solvers and baselines, such as newton,daqp,qpsolvers:osqp; all if left out."
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option(help="Problems in each set. Left out: 1000, or 60 with --quick.", min=1)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of problems and order.", min=0)] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Two minutes instead of twenty.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Compare every solver with every baseline: accuracy, speed and the worst case, on seeded problem sets.

    Writes results.parquet, manifest.json, report.md and figures/ into the folder. Runs in a process of its
    own, on one thread. Built-in solvers run through the interface; baselines, at their defaults and tight, on
    the plain program: daqp, qpsolvers:BACKEND, cvxpy:plain.
    """
    from tensionlab.benchmark.results import read
    from tensionlab.benchmark.run import measure, plan

    what = plan(output.words(sets), output.words(solvers), count, seed, quick)
    with output.progress("Measuring") as progress:
        kept = measure(what, out, ["tensionlab", *sys.argv[1:]], progress)
    results = read(kept)
    with output.Keeper(quiet=json) as keeper:
        _write(results, out, keeper)
        _print(results, out, json)
    if kept != out:
        raise WriteError(f"{out}: cannot be written; the results are in {kept}")


def _write(results: Results, out: Path, keeper: output.Keeper) -> None:
    """Write the figures for which there is something to draw, and the report."""
    from tensionlab import plots
    from tensionlab.benchmark.report import report

    figures = {
        "profile": plots.plot_profile,
        "accuracy": plots.plot_accuracy,
        "worst": plots.plot_worst,
        "continuity": plots.plot_continuity,
    }
    drawn = []
    for name, draw in figures.items():
        paths = [out / "figures" / f"{name}.{suffix}" for suffix in ("png", "pdf")]
        with suppress(ShapeError):  # nothing to draw, such as no trajectory
            if all(keeper.write("", path, partial(_draw, draw, results)) for path in paths):
                drawn.append(name)
    keeper.write("report", out / "report.md", lambda path: write_text(path, report(results, drawn)))


def _draw(draw: Callable[[Results, Path], None], results: Results, path: Path) -> None:
    make_folder(path.parent)
    draw(results, path)


def _print(results: Results, out: Path, json: bool) -> None:
    """Print the line of each entry, or JSON."""
    from tensionlab.benchmark import report

    lines = report.summaries(results)
    if json:
        output.print_json(
            {
                "folder": str(out),
                "sets": results.sets,
                "lines": [dataclasses.asdict(line) for line in lines],
                "manifest": {key: value for key, value in results.manifest.items() if key != "bench"},
            }
        )
        return
    from rich.text import Text

    grid = output.table(f"{len(results.sets)} problem sets, {len(lines)} entries", gap=1)
    for heading in COLUMNS:
        grid.add_column(heading, justify="left" if heading == "solver" else "right", no_wrap=True)
    for line in lines:
        name = Text(line.label, "bold" if line.built_in else "")
        if line.absent:
            grid.add_row(name, line.note, style="dim")
            continue
        grid.add_row(
            name,
            report.percent(line.solved_1e6),
            report.percent(line.solved_1e9),
            report.percent(line.elsewhere),
            report.newton(line.gap_max) + ("" if line.comparable else " †"),
            report.duration(line.sgm_s),
            report.duration(line.p999_s),
            report.duration(line.batch_s),
        )
    console = output.console()
    console.print(grid)
    console.print()
    console.print(LEGEND, style="dim")
