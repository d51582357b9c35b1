"""``tensionlab validate``: the published technical validation, on simulated modules or real ones."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.modules import module_links, print_simulated
from tensionlab.cli.common.options import Modules, Solver
from tensionlab.cli.common.output import INTERRUPTED

if TYPE_CHECKING:
    from contextlib import ExitStack

    from tensionlab.hardware.client.group import ModuleGroup
    from tensionlab.validation.results import Result
    from tensionlab.validation.sensor import ForceSensor
    from tensionlab.validation.session import Plan

SIMULATED = "sim:"


def validate(
    rig: Annotated[
        Path | None,
        typer.Argument(
            help="Rig file (TOML) of a point in space; the published one if left out.", show_default=False
        ),
    ] = None,
    modules: Modules = None,
    sensor: Annotated[
        str,
        typer.Option(
            metavar="FILE|URL|sim:",
            help="Force sensor: a table that its program goes on writing (ATI's CSV), socket://HOST:PORT that "
            "sends lines of numbers, or a simulated one that simulated modules pull on.",
        ),
    ] = SIMULATED,
    solver: Solver = "newton",
    preset: Annotated[
        str | None,
        typer.Option(
            help="What is wrong with the simulated rig: ideal (nothing) or paper-like.  [default: paper-like]"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the simulated rig's errors and noise.", min=0)] = 0,
    hold: Annotated[
        float, typer.Option(help="How long each force is held, in s; the first 0.3 s are not averaged.")
    ] = 1.0,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            callback=options.output_folder(),
            help="Folder for measurements and report.",
            show_default=False,
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Hold 182 forces one after another, measure them, and compare with the published validation.

    An interrupted validation goes on with the same command. Exit status 1 where it is not complete, or something
    went wrong with a module or the sensor.
    """
    from contextlib import ExitStack

    from tensionlab.errors import HardwareError, LogError
    from tensionlab.validation.results import result_of
    from tensionlab.validation.session import validate as measure

    if out is None:
        raise typer.BadParameter("--out is missing; name a folder for measurements and report")
    plan = _plan(rig, modules, sensor, solver, preset, seed, hold)
    total = len(plan.protocol.forces)
    if modules is None:
        print_simulated()
    with ExitStack() as opened, output.progress(f"{total} forces") as progress:
        reached = None if modules is None else _reached(plan, modules, sensor, opened)
        try:
            setup, measurements = measure(plan, out, reached, progress)
        except LogError:
            raise  # the folder is not the right one
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    if len(measurements) < total:
        output.print_error(
            f"interrupted: {len(measurements)} of {total} forces are measured; the same command goes on with the "
            "others"
        )
        raise typer.Exit(INTERRUPTED)
    result = result_of(setup, measurements)
    with output.Keeper(quiet=True) as keeper:
        report = _written(result, plan, sensor, out, keeper)
        if json:
            output.print_json(report)
        else:
            _show(result, plan)


def _show(result: Result, plan: Plan) -> None:
    """Print measured beside published values."""
    from tensionlab.validation.report import HEADINGS, remarks, rows

    headings = [heading or "<" for heading in HEADINGS]
    output.print_table(f"{plan.rig.name}, {plan.solver}, {len(result.desired)} forces", headings, rows(result))
    console = output.console()
    console.print()
    for remark in remarks(result):
        console.print(remark)


def _plan(
    rig: Path | None,
    modules: str | None,
    sensor: str,
    solver: str,
    preset: str | None,
    seed: int,
    hold: float,
) -> Plan:
    """What is asked for? Refuses what does not go together."""
    from tensionlab.model.files import load_rig
    from tensionlab.model.layouts import ring_plus_top
    from tensionlab.validation.error_model import PRESETS, require_point
    from tensionlab.validation.protocol import Protocol
    from tensionlab.validation.session import Plan

    if modules is not None and sensor == SIMULATED:
        raise typer.BadParameter(
            "--modules needs --sensor: what do they pull on? `tensionlab simulate --sensor-port` has one as well"
        )
    if modules is None and sensor != SIMULATED:
        raise typer.BadParameter(
            "--sensor is of no use without --modules: simulated ones pull on a simulated sensor"
        )
    if modules is not None and preset is not None:
        raise typer.BadParameter("--preset is for modules of this process; those of --modules are as they are")
    if preset is not None and preset not in PRESETS:
        raise typer.BadParameter(f"no preset {preset!r}; there are {', '.join(PRESETS)}")
    loaded = ring_plus_top(1.0) if rig is None else load_rig(rig)
    require_point(loaded)
    options.check_solvers(loaded, [solver], None)
    chosen = (preset or "paper-like") if modules is None else None
    return Plan(loaded, solver, Protocol(hold=hold), chosen, seed)


def _reached(plan: Plan, modules: str, sensor: str, opened: ExitStack) -> tuple[ModuleGroup, ForceSensor]:
    """Open the links to modules and sensor, to be closed with the others."""
    from contextlib import closing

    from tensionlab.hardware.client.group import connect
    from tensionlab.validation.external_sensor import open_sensor

    links = module_links(plan.rig, modules)
    felt = opened.enter_context(closing(open_sensor(sensor)))
    return opened.enter_context(closing(connect(plan.rig, links))), felt


def _written(result: Result, plan: Plan, sensor: str, out: Path, keeper: output.Keeper) -> dict[str, object]:
    """Write report, table and recording, and return what the report says."""
    import json

    from tensionlab.records import manifest
    from tensionlab.validation.recordings import write
    from tensionlab.validation.report import as_json, as_latex, as_markdown
    from tensionlab.validation.results import recording_of

    origin = manifest(["tensionlab", *sys.argv[1:]], plan.seed if plan.preset else None)
    report = as_json(result, origin)
    keeper.write_text("report", out / "report.json", json.dumps(output.plain(report), indent=2) + "\n")
    keeper.write_text("report", out / "report.md", as_markdown(result))
    keeper.write_text("table", out / "table.tex", as_latex(result))
    name = "forces-simulated.parquet" if result.setup["simulated"] else "forces.parquet"
    keeper.write("recording", out / name, lambda path: write(path, recording_of(result, plan.rig, sensor, origin)))
    return report
