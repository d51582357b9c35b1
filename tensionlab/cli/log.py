"""``tensionlab log``: show, export, draw and play the log of a run."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.output import if_interrupted, open_page
from tensionlab.cli.common.verbs import Json, Verbs, option
from tensionlab.errors import LogError
from tensionlab.hardware.log import reader
from tensionlab.support import provenance

log = Verbs("Show, export, draw and play logs of runs.")


@log.command()
def info(path: options.RunFile, json: Json = False) -> None:
    """Show how a run went: answers, timing, limits, events, and the fidelity of its effects."""
    from tensionlab.haptics.rendering.effect_fidelity import fidelity_table
    from tensionlab.scenarios.fidelity import run_fidelity

    run = _read(path)
    fidelities = run_fidelity(run)
    if json:
        fidelity = {name: effect.summary() for name, effect in fidelities.items()}
        output.print_json(**reader.summarise(run), fidelity=fidelity, setup=run.setup, manifest=run.manifest)
        return
    for table in (*reader.report(run), *([fidelity_table(fidelities)] if fidelities else [])):
        output.print_table(table)
        output.print_line()


@log.command()
def export(
    path: options.RunFile,
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
    path: options.RunFile,
    file: Annotated[
        Path, option("FILE", "Draw to this png, pdf or svg.", "--plot", callback=options.picture_file)
    ],
) -> None:
    """Draw wrenches, tensions, statuses, limits and timing of a run."""
    with output.ResultWriter() as writer:
        writer.draw(file, "run", _read(path))


@log.command()
def view(path: options.RunFile, port: options.PagePort = 0, browser: options.Browser = True) -> None:
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
