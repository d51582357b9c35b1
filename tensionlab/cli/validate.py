"""``tensionlab validate``: the published technical validation, on simulated modules or real ones."""

from __future__ import annotations

import json as json_text
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.links import links_of_rig
from tensionlab.cli.common.runs import print_simulated
from tensionlab.cli.common.verbs import Json, option
from tensionlab.errors import HardwareError, LogError
from tensionlab.hardware.client.group import connect
from tensionlab.model.files import load_rig
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation import report as reports
from tensionlab.validation.data_tables import write_recording
from tensionlab.validation.error_model import find_preset, require_point
from tensionlab.validation.protocol import Protocol, ValidationPlan
from tensionlab.validation.protocol import validate as measure
from tensionlab.validation.sensors import open_sensor

SIMULATED = "sim:"


@output.if_interrupted("measured forces are kept in the folder, and the same command continues with them")
def validate(
    out: Annotated[Path, options.writes_folder("Folder for measurements and report.")],
    rig: Annotated[str | None, options.rig_argument("; the published one if left out")] = None,
    modules: options.Modules = None,
    sensor: Annotated[
        str,
        option(
            "FILE|URL|sim:",
            "Force sensor: a table to which its program keeps writing (ATI's CSV), socket://HOST:PORT that "
            "sends lines of numbers, or a simulated one that simulated modules pull on.",
        ),
    ] = SIMULATED,
    solver: options.Solver = "newton",
    preset: Annotated[
        str | None,
        option(
            "ideal|paper-like",
            "Errors of the simulated rig: none, or such as the paper may have had.  [default: paper-like]",
        ),
    ] = None,
    seed: Annotated[int, option("N", "Seed of the simulated rig's errors and noise.", min=0)] = 0,
    hold: Annotated[float, option("S", "Time for which each force is held; the first 0.3 s do not count.")] = 1.0,
    plot: options.Plot = None,
    json: Json = False,
) -> None:
    """Repeat the published validation and compare with it.

    Renders 182 forces one after another, and measures them. The same command continues a validation that was
    interrupted. Exit status 1 where it is not complete, or something went wrong with a module or the sensor.
    """
    plan = _plan(rig, modules, sensor, solver, preset, seed, hold)
    total = len(plan.protocol.forces)
    if modules is None:
        print_simulated()
    with ExitStack() as opened, output.progress(f"{total} forces") as progress:
        reached = None
        if modules is not None:
            links = links_of_rig(plan.rig, modules)
            force_sensor = opened.enter_context(closing(open_sensor(sensor)))
            reached = opened.enter_context(closing(connect(plan.rig, links))), force_sensor
        try:
            setup, measurements = measure(plan, out, reached, progress)
        except LogError:
            raise  # the folder is not the right one
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    if len(measurements) < total:
        raise KeyboardInterrupt(f"{len(measurements)} of {total} forces are measured")
    result = reports.evaluate(setup, measurements)
    manifest = output.manifest(plan.seed if plan.preset else None)
    report = reports.as_json(result, manifest)
    with output.ResultWriter(quiet=True) as writer:
        write_report(writer, out, report, reports.as_markdown(result))
        recording = reports.make_recording(result, plan.rig, sensor, manifest)
        name = "forces-simulated.parquet" if setup["simulated"] else "forces.parquet"
        writer.write("recording", out / name, lambda path: write_recording(path, recording))
        writer.draw(plot, "forces", recording)
        if json:
            output.print_json(report)
        else:
            table = result.table()
            table.title = f"{plan.rig.name}: {table.title}"
            output.print_table(table)


def write_report(writer: output.ResultWriter, folder: Path, report: object, text: str) -> None:
    """Write a report into a folder, for programs and as text."""
    writer.write_text("report", folder / "report.json", json_text.dumps(output.plain(report), indent=2) + "\n")
    writer.write_text("report", folder / "report.md", text)


def _plan(
    rig: str | None, modules: str | None, sensor: str, solver: str, preset: str | None, seed: int, hold: float
) -> ValidationPlan:
    """Return the plan of the measurements; refuse options that exclude each other."""
    if modules is not None and sensor == SIMULATED:
        raise typer.BadParameter("--modules needs --sensor: what do they pull on?")
    if modules is None and sensor != SIMULATED:
        raise typer.BadParameter("--sensor is of no use without --modules: simulated ones have a simulated sensor")
    if modules is not None and preset is not None:
        raise typer.BadParameter("--preset is for modules of this process; those of --modules are as they are")
    if preset is not None:
        find_preset(preset)
    loaded = ring_plus_top(1.0) if rig is None else load_rig(rig)
    require_point(loaded)
    options.check_solvers(loaded, [solver], None)
    chosen = (preset or "paper-like") if modules is None else None
    return ValidationPlan(loaded, solver, Protocol(hold=hold), chosen, seed)
