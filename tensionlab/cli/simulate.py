"""``tensionlab simulate``: modules without hardware, which other programs reach as if they were real."""

from __future__ import annotations

from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import option, port_option
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.hardware.simulation import serve as serving
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.validation.error_model import require_point
from tensionlab.validation.simulated_hand import ServedSensor

SINGLE_MODULE = "module"  # name of a module that belongs to no rig


def simulate(
    rig: Annotated[str | None, options.rig_argument("; a single module if left out")] = None,
    listen: Annotated[str, option("HOST", "Address to listen at.")] = "127.0.0.1",
    port: Annotated[int, port_option("TCP port of the rig's first module, and so on; 0: free ones.")] = 0,
    modules: Annotated[
        Path | None, options.writes("Also write that file here.", ".toml", names=["--modules"])
    ] = None,
    seed: options.Seed = 0,
    latency_ms: Annotated[float, option("MS", "Delay of bytes, one way.", min=0, max=60_000)] = 0.0,
    jitter_ms: Annotated[float, option("MS", "Largest random delay added to it.", min=0, max=60_000)] = 0.0,
    drop_pct: Annotated[float, option("PCT", "Per cent of the bytes that are lost.", min=0, max=100)] = 0.0,
    corrupt_pct: Annotated[float, option("PCT", "Per cent of bytes with a flipped bit.", min=0, max=100)] = 0.0,
    fault: Annotated[
        list[str] | None, option("PART@TIME", "Fault of all modules, encoder@2s, or of one, floor-1:cable@800ms.")
    ] = None,
    sensor: Annotated[
        int | None, port_option("Also serve a force sensor at this TCP port, in a hand that `characterise` moves.")
    ] = None,
    only: Annotated[list[str] | None, option("NAME", "Only these modules of the rig; may be repeated.")] = None,
) -> None:
    """Simulate the modules of a rig, with their firmware.

    Serves one module for each cable until Ctrl-C. The end of each cable stays at the rig's home, or is where
    `tensionlab characterise --sensor` wants it.

    Prints a modules file, and an empty line after it: names and links, for --modules. A module takes one
    client at a time, and refuses others.
    """
    conditions = Conditions(1e-3 * latency_ms, 1e-3 * jitter_ms, 0.01 * drop_pct, 0.01 * corrupt_pct)
    loaded = None if rig is None else load_rig(rig)
    with ExitStack() as opened:
        served: list[serving.Served] = []
        if sensor is not None:
            if loaded is None:
                raise typer.BadParameter("--sensor needs a rig: what would its cables hold?")
            require_point(loaded)
            held = ServedSensor(loaded, opened.enter_context(closing(serving.TcpPort(listen, sensor))), seed)
            served.append(held)
            output.print_message(f"force sensor at {held.port.url}")
            simulated = _named(loaded, held.world)
        elif loaded is not None:
            simulated = _named(loaded, World(loaded, seed=seed))
        else:  # a single one as its maker leaves it: neither set up nor calibrated
            simulated = {SINGLE_MODULE: SimulatedModule(seed=seed)}
        faults = _faults(fault or [], list(simulated))
        if unknown := set(only or ()) - simulated.keys():
            raise typer.BadParameter(f"--only {min(unknown)}: no such module; there are {', '.join(simulated)}")
        links = {}
        for index, (name, module) in enumerate(simulated.items()):
            if only and name not in only:
                continue
            tcp = serving.TcpPort(listen, port and port + index)  # that of a module is the same with --only
            opened.callback(tcp.close)
            links[name] = tcp.url
            served.append(
                serving.ServedModule(
                    module,
                    tcp,
                    conditions=conditions,
                    seed=seed + index,
                    faults=faults[name],
                    in_world=sensor is not None,
                )
            )
        text = modules_to_toml(links)
        if modules is not None:
            writing.write_text(modules, text)
        kept = "the simulated modules have ended; the same command serves new ones"
        with output.until_interrupted(kept) as interrupted:
            typer.echo(text)
            serving.serve(serving.Server(served), interrupted)


def _named(rig: Rig, world: World) -> dict[str, SimulatedModule]:
    return dict(zip((module.name for module in rig.modules), world.modules, strict=True))


def _faults(texts: list[str], names: list[str]) -> dict[str, list[serving.PlannedFault]]:
    """Return the faults of each module. Without a name before a colon, a fault is in all."""
    faults: dict[str, list[serving.PlannedFault]] = {name: [] for name in names}
    for text in texts:
        name, colon, rest = text.rpartition(":")
        if colon and name not in faults:
            raise typer.BadParameter(f"--fault {text}: no module {name!r}; there are {', '.join(names)}")
        for module in [name] if colon else names:
            faults[module].append(serving.parse_fault(rest))
    return faults
