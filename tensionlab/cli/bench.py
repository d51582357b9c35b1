"""``tensionlab bench``: every solver and every peer on the problem sets, as a table, a report and figures."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli import output

if TYPE_CHECKING:
    from tensionlab.experiments.bench.results import Results

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
solved: share within reach, that accurate   elsewhere: to 1e-6 N, where the wrench is or may be out of reach
gap: largest difference of a tension to the proved optimum; † has another objective
call: typical time of one; for solvers of the house, in bold, its proof included"""


def bench(
    out: Annotated[
        Path, typer.Option(help="Folder for the results; made if it is not there.", show_default=False)
    ],
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="A,B,...", help="Problem sets, also repeated; all if left out."),
    ] = None,
    solvers: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A,B,...", help="Solvers and peers, such as newton,daqp,qpsolvers:osqp; all if left out."
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option(help="Problems in each set. Left out: 1000, or 60 with --quick.", min=1)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of problems and order.", min=0)] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Two minutes instead of twenty.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Compare every solver with every peer: accuracy, speed and the worst case, on seeded problem sets.

    Writes results.parquet, manifest.json, report.md and figures/ into the folder. Measured in a process of its
    own, on one thread. Solvers of the house run through the interface; peers, at their defaults and tight, on
    the plain program: daqp, qpsolvers:BACKEND, cvxpy:plain.
    """
    from tensionlab.experiments.bench.run import plan, run

    what = plan(output.words(sets), output.words(solvers), count, seed, quick)
    with output.progress("Measuring") as progress:
        results = run(what, out, ["tensionlab", *sys.argv[1:]], progress)
    _write(results, out)
    _print(results, out, json)


def _write(results: Results, out: Path) -> None:
    """Write the report and its figures."""
    from tensionlab import plots
    from tensionlab.experiments.bench.report import report

    figures = {"profile": plots.plot_profile, "accuracy": plots.plot_accuracy, "worst": plots.plot_worst}
    if any(row.path_mm for row in results.rows):
        figures["continuity"] = plots.plot_continuity
    (out / "figures").mkdir(exist_ok=True)
    for name, draw in figures.items():
        for suffix in ("png", "pdf"):
            draw(results, out / "figures" / f"{name}.{suffix}")
    (out / "report.md").write_text(report(results), encoding="utf-8")


def _print(results: Results, out: Path, json: bool) -> None:
    """The line of each contestant, and where the files are."""
    from tensionlab.experiments.bench import text
    from tensionlab.experiments.bench.headline import headlines

    lines = headlines(results)
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
    grid = output.table(f"{len(results.sets)} problem sets, {len(lines)} contestants", gap=1)
    for heading in COLUMNS:
        grid.add_column(heading, justify="left" if heading == "solver" else "right", no_wrap=True)
    for line in lines:
        name = f"[bold]{line.label}[/bold]" if line.house else line.label
        if line.note and line.sgm_s != line.sgm_s:
            grid.add_row(name, line.note, style="dim")
            continue
        grid.add_row(
            name,
            text.percent(line.solved_1e6),
            text.percent(line.solved_1e9),
            text.percent(line.elsewhere),
            text.newton(line.gap_max) + ("" if line.comparable else " †"),
            text.duration(line.sgm_s),
            text.duration(line.p999_s),
            text.duration(line.batch_s),
        )
    console = output.console()
    console.print(grid)
    console.print()
    console.print(LEGEND, style="dim")
    console.print(f"report: {out / 'report.md'}", soft_wrap=True)
