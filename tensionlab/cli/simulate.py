"""``tensionlab simulate``: modules without hardware, which other programs reach as if they were real."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.runs import load_rig_or_scenario
from tensionlab.haptics.bridge.osc import OscTracker
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.hardware.simulation import serve as serving
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tensionlab.hardware.simulation.world import COMPLIANT_STEP_S, simulated_module
from tensionlab.model.rig import Rig
from tensionlab.scenarios import SCENARIOS, Scenario
from tensionlab.scenarios.person import PersonSimulation
from tensionlab.support.files import writing
from tensionlab.validation.error_model import (
    RigErrors,
    draw_errors,
    find_preset,
    require_point,
    true_plants,
    true_rig,
)
from tensionlab.validation.sensors import SensorServer

SINGLE_MODULE = "module"  # name of a module that belongs to no rig
MAX_SPEED = 1000.0
FarEnds = Mapping[str, Callable[[], float]]  # lengths of cables in m as they are now, by the names of modules


def simulate(
    rig: Annotated[str | None, options.rig_argument("; a single module if left out")] = None,
    listen: Annotated[str, typer.Option(metavar="HOST", help="Address to listen at.")] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            metavar="PORT",
            help="TCP port of the first module served, the next ones following; 0 takes free ones.",
            min=0,
            max=65535,
        ),
    ] = 0,
    modules: Annotated[
        Path | None, options.writes("Also write the modules file here.", ".toml", names=["--modules"])
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of all random noise and losses.", min=0)] = 0,
    latency_ms: Annotated[
        float, typer.Option(metavar="MS", help="Delay of bytes, one way.", min=0, max=60_000)
    ] = 0.0,
    jitter_ms: Annotated[
        float, typer.Option(metavar="MS", help="Largest random delay added to it.", min=0, max=60_000)
    ] = 0.0,
    drop_pct: Annotated[
        float, typer.Option(metavar="PCT", help="Per cent of the bytes that are lost.", min=0, max=100)
    ] = 0.0,
    corrupt_pct: Annotated[
        float, typer.Option(metavar="PCT", help="Per cent of the bytes with a flipped bit.", min=0, max=100)
    ] = 0.0,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART@TIME",
            help="A fault, such as encoder@2s in all modules, or floor-1:cable@800ms in one; also repeated.",
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="X", help="How many times faster than real time the modules run.")
    ] = 1.0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only these modules of the rig; also repeated.")
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            autocompletion=options.complete(lambda: SCENARIOS),
            help="Serve the modules of a scenario, whose cables its simulated person holds: a name that "
            "`tensionlab scenario list` shows, or a file. RIG replaces its rig.",
        ),
    ] = None,
    tracker: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="With --scenario: send the positions of hand and bodies there by OSC, 90 times per second, as "
            "/body/NAME x y z.",
        ),
    ] = None,
    sensor_port: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            help="Also simulate a force sensor that holds the point. It sends three forces (N, in its own axes, Z "
            "up) 1000 times per second from this TCP port; 0 takes a free one.",
            min=0,
            max=65535,
        ),
    ] = None,
    preset: Annotated[
        str,
        typer.Option(
            metavar="ideal|paper-like",
            help="With --sensor-port: the errors of the rig; see `tensionlab validate`.",
        ),
    ] = "paper-like",
    config_file: Annotated[
        Path | None,
        options.writes(
            "File of the module's stored parameters, read at the start and written when it saves. In a rig, "
            "-1, -2, ... is put before the suffix.",
            names=["--config-file"],
        ),
    ] = None,
) -> None:
    """Simulate the modules of a rig, with their firmware.

    Serves one module for each cable until Ctrl-C. The end of each cable stays at the rig's home, or is where a
    simulated person holds it (--scenario). The person begins when all modules are armed, and returns to the start
    when all have been stopped; ``tensionlab scenario NAME --modules FILE --osc PORT`` plays with it.

    Prints a modules file, and an empty line after it: names and links, for --modules. A module takes one
    client at a time, and refuses others.
    """
    if not 0.0 < speed <= MAX_SPEED:
        raise typer.BadParameter(f"--speed is above 0 and at most {MAX_SPEED:g}; got {speed:g}")
    if scenario is not None and (only or sensor_port is not None):
        raise typer.BadParameter(
            "--scenario takes all modules of its rig, and a person holds their cables: leave out --only and "
            "--sensor-port"
        )
    if sensor_port is not None and (rig is None or only):
        raise typer.BadParameter("--sensor-port takes a rig with all its modules")
    if tracker is not None and scenario is None:
        raise typer.BadParameter("--tracker sends the positions of a scenario: give --scenario NAME as well")
    conditions = Conditions(1e-3 * latency_ms, 1e-3 * jitter_ms, 0.01 * drop_pct, 0.01 * corrupt_pct)
    loaded, played = load_rig_or_scenario(rig, scenario)
    errors = None if loaded is None or sensor_port is None else _errors(loaded, preset, seed)
    with ExitStack() as opened:
        person = None if played is None else _person(played, tracker, opened)
        far_ends: FarEnds = {} if person is None else person.far_ends
        simulated = _modules(loaded, seed, config_file, far_ends, errors)
        chosen, faults = _chosen(only, list(simulated)), _faults(fault or [], list(simulated))
        served = [
            serving.ServedModule(
                module,
                serving.TcpPort(listen, port and port + chosen.index(name)),
                conditions=conditions,
                seed=seed + index,
                faults=faults[name],
                settings_file=settings_file,
                far_end=far_ends.get(name),
            )
            for index, (name, (module, settings_file)) in enumerate(simulated.items())
            if name in chosen
        ]
        ports = opened.enter_context(ExitStack())
        for each in served:
            ports.callback(each.port.close)
        text = modules_to_toml({name: each.port.url for name, each in zip(chosen, served, strict=True)})
        watchers: list[serving.StepObserver] = [] if person is None else [person.take]
        if loaded is not None and errors is not None and sensor_port is not None:
            sensor = serving.TcpPort(listen, sensor_port)
            opened.callback(sensor.close)
            text += f"# Force sensor: {sensor.url}\n"
            watchers.append(SensorServer(loaded, errors, seed, sensor).take)
        if modules is not None:
            writing.write_text(modules, text)
        ports.pop_all()  # from here on, `serve` closes them
        server = serving.Server(served, speed, watchers, math.inf if person is None else COMPLIANT_STEP_S)
        kept = "the simulated modules have ended; the same command serves new ones"
        with output.until_interrupted(kept) as interrupted:
            typer.echo(text)
            serving.serve(server, interrupted)


def _modules(
    rig: Rig | None, seed: int, config_file: Path | None, far_ends: FarEnds, errors: RigErrors | None
) -> dict[str, tuple[SimulatedModule, Path | None]]:
    """Return the modules by their names, each with the file of its parameters.

    Without a rig it is a single one as its maker leaves it: neither set up nor calibrated.
    """
    simulated: dict[str, tuple[SimulatedModule, Path | None]] = {}
    if rig is None:
        settings = None if config_file is None else serving.read_settings(config_file)
        simulated[SINGLE_MODULE] = (SimulatedModule(seed=seed, settings=settings), config_file)
    else:
        plants = {} if errors is None else true_plants(rig, errors)
        true = rig if errors is None else true_rig(rig, errors)
        lengths = true.lengths(true.home, frames=true.at_rest)
        for index, (each, length) in enumerate(zip(true.modules, lengths, strict=True)):
            file = config_file and config_file.with_name(f"{config_file.stem}-{index + 1}{config_file.suffix}")
            module = simulated_module(
                each,
                far_ends[each.name]() if far_ends else float(length),
                serial_number=index + 1,
                seed=seed + index,
                settings=None if file is None else serving.read_settings(file),
                plant=plants.get(each.name),
            )
            simulated[each.name] = (module, file)
    for module, file in simulated.values():
        if file is not None and file.exists() and not module.loaded:
            typer.echo(f"{file}: not the settings of a module; it starts with its defaults", err=True)
    return simulated


def _person(scenario: Scenario, tracker: str | None, opened: ExitStack) -> PersonSimulation:
    """Return the simulated person that holds the cables, tracked if that is wanted."""
    if tracker is None:
        return PersonSimulation(scenario.person, scenario.rig)
    host, _, port = tracker.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise typer.BadParameter(f"--tracker is HOST:PORT, such as 127.0.0.1:9000; got {tracker!r}")
    return PersonSimulation(scenario.person, scenario.rig, opened.enter_context(OscTracker(host, int(port))).send)


def _errors(rig: Rig, preset: str, seed: int) -> RigErrors:
    """Return the errors of the rig that a force sensor holds."""
    require_point(rig)
    return draw_errors(find_preset(preset), rig.m, seed)


def _chosen(only: list[str] | None, names: list[str]) -> list[str]:
    """Return the modules that are served; all, if none is named."""
    for name in only or []:
        if name not in names:
            raise typer.BadParameter(f"--only {name}: no such module; there are {', '.join(names)}")
    return [name for name in names if not only or name in only]


def _faults(texts: list[str], names: list[str]) -> dict[str, list[serving.PlannedFault]]:
    """Return the faults of each module. Without a name before a colon, a fault is in all."""
    faults: dict[str, list[serving.PlannedFault]] = {name: [] for name in names}
    for text in texts:
        name, colon, rest = text.rpartition(":")
        if colon and name not in faults:
            raise typer.BadParameter(f"--fault {text}: no module {name!r}; there are {', '.join(names)}")
        for each in [name] if colon else names:
            faults[each].append(serving.parse_fault(rest))
    return faults
