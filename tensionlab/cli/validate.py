"""``tensionlab validate`` and ``characterise``: a rig by the published protocol, and as a haptic device."""

from __future__ import annotations

import json as json_text
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated

import typer

from tensionlab import datasets
from tensionlab.cli.common import options, output
from tensionlab.cli.common.links import links_of_rig
from tensionlab.cli.common.runs import print_simulated
from tensionlab.cli.common.verbs import Json, option
from tensionlab.errors import HardwareError, LogError
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.runner.settings import Clock, RealClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.files import load_rig
from tensionlab.model.layouts import ring_plus_top
from tensionlab.support.files import writing
from tensionlab.support.provenance import write_parquet
from tensionlab.validation import characterisation_report as device_report
from tensionlab.validation import report as reports
from tensionlab.validation.characterisation import CharacterisationPlan, feasible_axes
from tensionlab.validation.characterisation import characterise as measure_device
from tensionlab.validation.data_tables import write_recording
from tensionlab.validation.error_model import find_preset, require_point
from tensionlab.validation.protocol import Protocol, ValidationPlan
from tensionlab.validation.protocol import validate as measure
from tensionlab.validation.sensors import ForceSensor, open_sensor
from tensionlab.validation.simulated_hand import HandRequest

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


@output.if_interrupted("nothing is kept: a characterisation is measured in one go")
def characterise(
    rig: options.RigArgument,
    out: Annotated[Path, options.writes_folder("Folder for report, measurements and figure.")],
    modules: options.Modules = None,
    sensor: Annotated[str | None, option("FILE|URL", "Force sensor of --modules, as for `validate`.")] = None,
    latency_ms: Annotated[float, option("MS", "Delay of simulated links, one way.", min=0, max=100)] = 10.0,
    json: Json = False,
) -> None:
    """Measure a rig as a haptic device, and compare it with published ones.

    Static forces and positions, steps, bandwidth, vibrations, what a hand feels in free motion, the stiffness of
    stable walls, and latency. With --modules it asks before each part to hold the force sensor in some way.
    """
    if (modules is None) != (sensor is None):
        raise typer.BadParameter("--modules and --sensor go together: real modules pull on a real sensor")
    plan = CharacterisationPlan(load_rig(rig), conditions=Conditions(1e-3 * latency_ms))
    feasible_axes(plan)
    devices = datasets.load("published/haptic-devices")
    writing.make_folder(out)
    with ExitStack() as opened, output.progress("characterisation") as progress:
        bench = None
        if modules is None or sensor is None:
            print_simulated()
        else:
            force_sensor = opened.enter_context(closing(open_sensor(sensor)))
            group = opened.enter_context(closing(connect(plan.rig, links_of_rig(plan.rig, modules))))

            def bench(request: HandRequest) -> tuple[ModuleGroup, Clock, ForceSensor]:
                if force_sensor.simulated:
                    force_sensor.send(request.line().encode())
                else:
                    output.wait_for_enter(str(request))
                return group, RealClock(group.clients), force_sensor

        try:
            result = measure_device(plan, bench, progress)
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    manifest = output.manifest(plan.seed if result.simulated else None)
    report = device_report.as_json(result, devices, manifest)
    name = "measurements-simulated.parquet" if result.simulated else "measurements.parquet"
    with output.ResultWriter(quiet=json) as writer:
        if json:
            output.print_json(report)
        else:
            output.print_table(device_report.table(result))
            output.print_line()
            output.print_table(device_report.devices_table(result, devices))
        write_report(writer, out, report, device_report.as_markdown(result, devices))
        writer.write(
            "measurements", out / name, lambda path: write_parquet(path, device_report.rows(result), manifest)
        )
        writer.draw(out / "characterisation.png", "characterisation", result)
