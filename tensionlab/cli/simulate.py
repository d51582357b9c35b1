"""``tensionlab simulate``: modules without hardware, to talk to as if they were real."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import options
from tensionlab.files import writing

if TYPE_CHECKING:
    from tensionlab.hardware.simulation.serve import PlannedFault
    from tensionlab.model.rig import Rig
    from tensionlab.scenarios import Scenario
    from tensionlab.scenarios.person import PersonSimulation
    from tensionlab.validation.error_model import Errors


def simulate(
    rig: Annotated[
        Path | None, typer.Argument(help="Rig file (TOML); one module by itself if left out.", show_default=False)
    ] = None,
    listen: Annotated[
        str, typer.Option(metavar="HOST", help="Address of this machine to listen at; others reach it there.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(help="TCP port of the first module; 0 takes free ones.", min=0, max=65535)
    ] = 0,
    pty: Annotated[bool, typer.Option("--pty", help="Pseudo-terminals instead of TCP.")] = False,
    modules: Annotated[
        Path | None,
        typer.Option(callback=options.output_file(".toml"), help="Write the modules file there as well."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all noise and accidents.", min=0)] = 0,
    latency_ms: Annotated[float, typer.Option(help="Time that bytes take, one way.")] = 0.0,
    jitter_ms: Annotated[float, typer.Option(help="They take up to so much longer.")] = 0.0,
    drop_pct: Annotated[float, typer.Option(help="Per cent of the bytes that are lost.")] = 0.0,
    corrupt_pct: Annotated[float, typer.Option(help="Per cent of the bytes with a flipped bit.")] = 0.0,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="WHAT@WHEN", help="Such as encoder@2s, or floor-1:cable@800ms; also repeated."),
    ] = None,
    speed: Annotated[float, typer.Option(help="How fast time passes; all times are the modules' own.")] = 1.0,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only these modules of the rig; also repeated.")
    ] = None,
    orbit: Annotated[
        str | None,
        typer.Option(
            metavar="RADIUS PERIOD",
            help="The point goes round its home in so many s, m away from it; in step with other such processes.",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            callback=options.output_file(".csv"), help="Write there (CSV) what the cables really pull with."
        ),
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The modules of a scenario, and its simulated person, who holds their cables: a name that "
            "`tensionlab scenario list` shows, or a file. RIG takes the place of its rig.",
        ),
    ] = None,
    tracker: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="With --scenario, send where hand and bodies are by OSC, 90 times a second: /body/NAME x y z.",
        ),
    ] = None,
    sensor_port: Annotated[
        int | None,
        typer.Option(
            help="A force sensor holds the point, and sends its three forces (N, its own axes, Z up) 1000 times a "
            "second from this TCP port; 0 takes a free one.",
            min=0,
            max=65535,
        ),
    ] = None,
    preset: Annotated[
        str,
        typer.Option(help="With --sensor-port, what is wrong with the rig: ideal or paper-like; see validate."),
    ] = "paper-like",
    config_file: Annotated[
        Path | None,
        typer.Option(
            callback=options.output_file(),
            help="Settings, read at the start and written when the module saves. In a rig, -1, -2, ... is put "
            "before the suffix.",
        ),
    ] = None,
) -> None:
    """Simulate one module for each cable of a rig, with its own firmware, until Ctrl-C.

    The cable's far end stays where the rig's home puts it, goes round it (--orbit), or is where a simulated
    person holds it (--scenario). The person begins when all modules are armed, and goes back to the start once all
    have been stopped; `tensionlab scenario NAME --modules FILE --osc PORT` plays with it.

    Prints a modules file, and an empty line after it: names, and links that pyserial opens. A module has one
    client at a time; a second one is refused, and one that goes away is a link that closed.
    """
    from tensionlab.cli.common.simulated_modules import one_module, rig_modules
    from tensionlab.hardware.client.group import modules_to_toml
    from tensionlab.hardware.simulation.channel import Conditions
    from tensionlab.hardware.simulation.ports import PtyPort, TcpPort
    from tensionlab.hardware.simulation.recording import Recording
    from tensionlab.hardware.simulation.serve import ServedModule, serve
    from tensionlab.hardware.simulation.world import COMPLIANT_STEP_S
    from tensionlab.validation.sensor_server import ServedSensor

    if not 0.0 < speed <= 1000.0:
        raise typer.BadParameter(f"--speed is above 0 and at most 1000; got {speed:g}")
    conditions = Conditions(1e-3 * latency_ms, 1e-3 * jitter_ms, 0.01 * drop_pct, 0.01 * corrupt_pct)
    if scenario is not None and (only or orbit is not None or sensor_port is not None):
        raise typer.BadParameter(
            "--scenario takes all modules of its rig, and a person holds their cables: leave out --only, --orbit "
            "and --sensor-port"
        )
    if sensor_port is not None and (rig is None or only or orbit is not None):
        raise typer.BadParameter("--sensor-port takes a rig with all its modules, and a point that stays")
    if tracker is not None and scenario is None:
        raise typer.BadParameter("--tracker sends where the person of a scenario is: give --scenario NAME as well")
    played = None if scenario is None else _scenario(scenario, rig)
    loaded = _loaded(rig) if played is None else played.rig
    errors = None if loaded is None or sensor_port is None else _errors(loaded, preset, seed)
    with ExitStack() as opened:
        person = None if played is None else _person(played, tracker, opened)
        far_ends = {} if person is None else person.far_ends
        if orbit is not None:
            far_ends = _orbit(loaded, options.parse_numbers(orbit))
        simulated = (
            one_module(seed, config_file)
            if loaded is None
            else rig_modules(loaded, seed, config_file, far_ends, errors)
        )
        chosen = _only(only, list(simulated))
        faults = _faults(fault or [], list(simulated))
        served = [
            ServedModule(
                module,
                PtyPort() if pty else TcpPort(listen, port and port + index),
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
        for opening in served:
            ports.callback(opening.port.close)
        text = modules_to_toml({name: each.port.url for name, each in zip(chosen, served, strict=True)})
        watchers = [] if person is None else [person.take]
        if loaded is not None and errors is not None and sensor_port is not None:
            sensor = opened.enter_context(ServedSensor(loaded, errors, seed, TcpPort(listen, sensor_port)))
            text += f"# Force sensor: {sensor.url}\n"
            watchers.append(sensor.take)
        if record is not None:
            watchers.append(opened.enter_context(Recording(record, chosen)).take)
        if modules is not None:
            writing.write_text(modules, text)
        ports.pop_all()  # from here on, they are closed by serve
        ended = []
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, lambda number, _: ended.append(number))
        typer.echo(text)
        serve(served, speed, lambda: bool(ended), watchers, math.inf if person is None else COMPLIANT_STEP_S)


def _scenario(name: str, rig: Path | None) -> Scenario:
    from tensionlab.scenarios import load_scenario

    return load_scenario(name, rig)


def _loaded(path: Path | None) -> Rig | None:
    from tensionlab.model.files import load_rig

    return None if path is None else load_rig(path)


def _person(scenario: Scenario, tracker: str | None, opened: ExitStack) -> PersonSimulation:
    """Who holds the cables, and is tracked, if that is wanted?"""
    from tensionlab.haptics.bridge.osc import OscTracker
    from tensionlab.scenarios.person import PersonSimulation

    if tracker is None:
        return PersonSimulation(scenario.person, scenario.rig)
    host, _, port = tracker.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise typer.BadParameter(f"--tracker is HOST:PORT, such as 127.0.0.1:9000; got {tracker!r}")
    track = opened.enter_context(OscTracker(host, int(port))).send
    return PersonSimulation(scenario.person, scenario.rig, track)


def _errors(rig: Rig, preset: str, seed: int) -> Errors:
    """What is wrong with the rig that a force sensor holds?"""
    from tensionlab.validation.error_model import PRESETS, draw, require_point

    if preset not in PRESETS:
        raise typer.BadParameter(f"no preset {preset!r}; there are {', '.join(PRESETS)}")
    require_point(rig)
    return draw(PRESETS[preset], rig.m, seed)


def _only(only: list[str] | None, names: list[str]) -> list[str]:
    """Which modules are served? All, if none is named."""
    for name in only or []:
        if name not in names:
            raise typer.BadParameter(f"--only {name}: no such module; there are {', '.join(names)}")
    return [name for name in names if not only or name in only]


def _orbit(rig: Rig | None, numbers: list[float]) -> dict[str, Callable[[], float]]:
    """How long is each cable now, if the point goes round its home? By the time of day, which processes share."""
    from tensionlab.hardware.simulation.orbit import cable_lengths

    if rig is None or len(numbers) != 2:
        raise typer.BadParameter("--orbit takes a rig, and two numbers: a radius in m and a period in s")
    return cable_lengths(rig, *numbers)


def _faults(texts: list[str], names: list[str]) -> dict[str, list[PlannedFault]]:
    """What breaks in which module? Without a name before a colon, it breaks in all."""
    from tensionlab.hardware.simulation.serve import parse_fault

    faults: dict[str, list[PlannedFault]] = {name: [] for name in names}
    for text in texts:
        name, colon, rest = text.rpartition(":")
        if colon and name not in faults:
            raise typer.BadParameter(f"--fault {text}: no module {name!r}; there are {', '.join(names)}")
        for each in [name] if colon else names:
            faults[each].append(parse_fault(rest))
    return faults
