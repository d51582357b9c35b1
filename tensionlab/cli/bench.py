"""``tensionlab bench`` and ``problems``: the benchmark of solvers, its leaderboard, and its problem sets."""

from __future__ import annotations

import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.benchmark import experiment, report, submissions
from tensionlab.benchmark.problem_files import find_problem_set, qp_rows
from tensionlab.benchmark.problem_sets import PROBLEM_SETS
from tensionlab.benchmark.results import Results
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, Verbs, flag, option
from tensionlab.errors import InputError
from tensionlab.support import provenance
from tensionlab.support.files.writing import make_folder, write_text

bench = Verbs()


@bench.callback(invoke_without_command=True)
def run(
    context: typer.Context,
    sets: Annotated[
        list[str] | None, option("A,B,...", "Problem sets or files; all if left out.", "--set")
    ] = None,
    solvers: Annotated[
        list[str] | None,
        option("A,B,...", "Solvers and baselines, such as newton,qpsolvers:osqp; all if left out."),
    ] = None,
    count: Annotated[int | None, option("N", "Problems in each set; 1000, or 60 with --quick.", min=1)] = None,
    seed: options.Seed = 0,
    out: Annotated[
        Path | None, options.writes_folder("Folder for the results; left out: a table alone.", parents=True)
    ] = None,
    quick: Annotated[bool, flag("--quick", "Two minutes instead of twenty.")] = False,
    json: Json = False,
) -> None:
    """Benchmark all solvers and baselines.

    Measures accuracy, speed and the worst case on seeded problem sets, on one thread. With --out, it writes
    results.parquet, manifest.json, report.md and figures/ into that folder. Built-in solvers run through
    tensionlab's interface. The baselines solve the plain quadratic program, at their default and at tight
    tolerances: daqp, qpsolvers:BACKEND, cvxpy:plain.
    """
    if context.invoked_subcommand is not None:
        return
    what = experiment.plan(options.parse_names(sets), options.parse_names(solvers), count, seed, quick)
    with output.progress("Measuring") as progress:
        results = experiment.measure(what, out, ["tensionlab", *sys.argv[1:]], progress)
    rest = "nothing is kept" if out is None else f"{out} has the results, but not all figures and the report"
    with output.if_interrupted(rest), output.ResultWriter(quiet=json) as writer:
        if out is not None:
            _write(results, out, writer)
        if json:
            output.print_json(
                folder=out,
                sets=results.sets,
                entries=results.summary().to_dict("records"),
                manifest={key: value for key, value in results.manifest.items() if key != "bench"},
            )
        else:
            output.print_table(results.table())


@bench.command()
def submit(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="A submission: submission.toml, and TRACK.npz for each track; or a folder of them.",
        ),
    ],
    out: Annotated[Path | None, options.writes("Write the leaderboard here, in Markdown.", ".md")] = None,
    json: Json = False,
) -> None:
    """Check submissions to the leaderboard, and rank them.

    Every answer is compared with the proved optimum of its problem. `tensionlab datasets tracks` lists the tracks.
    """
    scores = submissions.read_submissions(folder)
    with output.ResultWriter(quiet=json) as writer:
        if out is not None:
            writer.write_text("leaderboard", out, submissions.to_markdown(scores))
        if json:
            output.print_json(scores=scores.to_dict("records"))
            return
        for table in (submissions.leaderboard(scores), *submissions.times(scores)):
            output.print_table(table)
            output.print_line()


def _write(results: Results, out: Path, writer: output.ResultWriter) -> None:
    from tensionlab import plots

    drawn = []
    make_folder(out / "figures")
    for name in report.FIGURES:
        with suppress(InputError):  # nothing to draw, such as no trajectory
            figure = getattr(plots, f"plot_{name}")(results)
            paths = [out / "figures" / f"{name}.{suffix}" for suffix in ("png", "pdf")]
            if all(writer.write("", path, partial(plots.save_figure, figure)) for path in paths):
                drawn.append(name)
    writer.write("report", out / "report.md", lambda path: write_text(path, report.report(results, drawn)))


def problems(
    name: Annotated[
        str,
        typer.Argument(
            metavar="SET",
            help="Name of a set, as `tensionlab datasets problems` lists them.",
            autocompletion=options.complete(lambda: PROBLEM_SETS),
        ),
    ],
    out: Annotated[Path, options.writes("The Parquet file to write.", ".parquet")],
    count: Annotated[int, option("N", "Approximate number of problems in the set.", min=1)] = 1000,
    seed: options.Seed = 0,
) -> None:
    """Write one of the benchmark's problem sets as quadratic programs.

    The Parquet file is one that qpbenchmark's ParquetTestSet reads.
    """
    problem_set = find_problem_set(name, count, seed)
    rows = qp_rows(problem_set)
    about = {"set": problem_set.name, "title": problem_set.title, "reachable": problem_set.reachable,
             "count": count}  # fmt: skip
    provenance.write_parquet(out, rows, output.manifest(seed) | about)
    output.print_line(f"{problem_set.name}, {len(rows)} problems: {out}")
