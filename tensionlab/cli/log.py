"""``tensionlab log``: show, export, draw, play and replay the log of a run."""

from __future__ import annotations

import dataclasses
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.benchmark import replay as replays
from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import Browser, PagePort, Rows, Solvers
from tensionlab.cli.common.output import if_interrupted, open_page
from tensionlab.cli.common.verbs import Json, Verbs
from tensionlab.cli.compare import STATUS_LEGEND, print_scores
from tensionlab.errors import LogError
from tensionlab.hardware.log import reader
from tensionlab.support import provenance
from tensionlab.support.formatting import format_count

log = Verbs("Show, export, draw, play and replay logs of runs.")
RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="Log of a run (*.mcap).")]
LEGEND = f"""\
{STATUS_LEGEND}   fallback: unproven, so that newton's answer is counted
error: desired minus rendered   angle: between the two forces   t: tensions
step: largest change of a tension from one cycle to the next, before the runner limits its slew rate"""


@log.command()
def info(path: RunFile, json: Json = False) -> None:
    """Show how a run went: answers, timing, limits and events."""
    run = _read(path)
    if json:
        output.print_json(**reader.summarise(run), setup=run.setup, manifest=run.manifest)
        return
    for table in reader.report(run):
        output.print_table(table)
        output.print_line()


@log.command()
def export(
    path: RunFile,
    out: Annotated[
        Path,
        options.writes("Write to this file: NetCDF (.nc), Parquet or CSV.", ".nc", *provenance.TABLE_SUFFIXES),
    ],
) -> None:
    """Write a run as NetCDF, Parquet or CSV.

    NetCDF has names, units and dimensions; a table of Parquet or CSV has a row for each cycle.
    """
    run = _read(path)
    if out.suffix.lower() == ".nc":
        reader.write_netcdf(run, out)
    else:
        provenance.write_table(out, reader.flat_columns(run), run.manifest)
    typer.echo(f"{out}: {len(run)} cycles")


@log.command()
def plot(
    path: RunFile,
    file: Annotated[
        Path, typer.Option("--plot", callback=options.picture_file, help="Draw to this file (png, pdf, svg).")
    ],
) -> None:
    """Draw wrenches, tensions, statuses, limits and timing of a run."""
    with output.ResultWriter() as writer:
        writer.draw(file, "run", _read(path))


@log.command()
def replay(path: RunFile, solvers: Solvers = None, out: Rows = None, json: Json = False) -> None:
    """Compare other solvers on the desired wrenches of a run.

    At its poses and with its modules. The first row is the run as it was. The others show what each solver would
    have chosen, with its own policy for infeasible wrenches. The hand or platform follows the recorded path in
    all of them.
    """
    run = _read(path)
    names = options.parse_names(solvers)
    options.check_solvers(run.rig, names, None)
    with output.progress(f"Replaying {path.name}") as progress:
        found = replays.replay(run, names, progress)
    manifest = {**output.manifest(), "run": run.manifest}
    with output.ResultWriter(quiet=json) as writer:
        if out:
            rows = [dataclasses.asdict(row) for row in found.rows]
            writer.write("rows", out, lambda file: provenance.write_table(file, rows, manifest))
        if json:
            output.print_json(
                rig=run.rig.name,
                cycles=len(found.wrenches),
                rows=found.rows,
                left_out=found.missing,
                manifest=manifest,
            )
            return
        cycles = format_count(len(found.wrenches), "cycle")
        table = found.table()
        table.title = f"{run.rig.name}, {format_count(run.rig.m, 'module')}: {cycles} of {path.name}"
        print_scores(table, LEGEND)


@log.command()
def view(path: RunFile, port: PagePort = 0, browser: Browser = True) -> None:
    """Play a run in the browser.

    The rig as it was at each time, with cables by tension, forces, brakes and modules, and its
    events. Ctrl-C ends it.
    """
    from tensionlab.scenarios.scenery import read_scenery
    from tensionlab.viewer.replay import ReplayPage, require_drawable
    from tensionlab.viewer.server import PageServer

    run = _read(path)
    require_drawable(run, path)
    scenery = read_scenery(run.setup.scenery, run.rig, str(path), LogError)
    page = ReplayPage(run, PageServer(port=port), scenery)
    with if_interrupted("the same command shows the run again"), closing(page):
        open_page(page.server, path.name, browser=browser)
        page.serve(lambda: False)


def _read(path: Path) -> reader.Run:
    with output.progress(f"Reading {path.name}") as progress:
        return reader.read_run(path, progress)
