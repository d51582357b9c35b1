"""``tensionlab characterise``: a rig measured as a haptic device, on simulated modules or real ones."""

from __future__ import annotations

from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated

import typer

from tensionlab import datasets
from tensionlab.cli.common import options, output
from tensionlab.cli.common.links import links_of_rig
from tensionlab.cli.common.runs import print_simulated
from tensionlab.cli.common.verbs import Json, option
from tensionlab.cli.validate import write_report
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.runner.settings import Clock, RealClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.files import load_rig
from tensionlab.support.files import writing
from tensionlab.support.provenance import write_parquet
from tensionlab.validation import characterisation_report as reports
from tensionlab.validation.characterisation import CharacterisationPlan, feasible_axes
from tensionlab.validation.characterisation import characterise as measure
from tensionlab.validation.sensors import ForceSensor, open_sensor
from tensionlab.validation.simulated_hand import HandRequest


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
            result = measure(plan, bench, progress)
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    manifest = output.manifest(plan.seed if result.simulated else None)
    report = reports.as_json(result, devices, manifest)
    name = "measurements-simulated.parquet" if result.simulated else "measurements.parquet"
    with output.ResultWriter(quiet=json) as writer:
        if json:
            output.print_json(report)
        else:
            output.print_table(reports.table(result))
            output.print_line()
            output.print_table(reports.devices_table(result, devices))
        write_report(writer, out, report, reports.as_markdown(result, devices))
        writer.write("measurements", out / name, lambda path: write_parquet(path, reports.rows(result), manifest))
        writer.draw(out / "characterisation.png", "characterisation", result)
