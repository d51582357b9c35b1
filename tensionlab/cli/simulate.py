"""``tensionlab simulate``: modules without hardware, which other programs reach as if they were real."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.hardware.simulation import serve as serving
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tensionlab.hardware.simulation.world import simulated_module
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing

SINGLE_MODULE = "module"  # name of a module that belongs to no rig


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
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only these modules of the rig; also repeated.")
    ] = None,
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

    Serves one module for each cable until Ctrl-C. The end of each cable stays at the rig's home.

    Prints a modules file, and an empty line after it: names and links, for --modules. A module takes one
    client at a time, and refuses others.
    """
    conditions = Conditions(1e-3 * latency_ms, 1e-3 * jitter_ms, 0.01 * drop_pct, 0.01 * corrupt_pct)
    simulated = _modules(None if rig is None else load_rig(rig), seed, config_file)
    chosen, faults = _chosen(only, list(simulated)), _faults(fault or [], list(simulated))
    with ExitStack() as opened:
        served = []
        for index, (name, (module, settings_file)) in enumerate(simulated.items()):
            if name in chosen:
                tcp = serving.TcpPort(listen, port and port + chosen.index(name))
                opened.callback(tcp.close)
                served.append(
                    serving.ServedModule(
                        module,
                        tcp,
                        conditions=conditions,
                        seed=seed + index,
                        faults=faults[name],
                        settings_file=settings_file,
                    )
                )
        text = modules_to_toml({name: each.port.url for name, each in zip(chosen, served, strict=True)})
        if modules is not None:
            writing.write_text(modules, text)
        kept = "the simulated modules have ended; the same command serves new ones"
        with output.until_interrupted(kept) as interrupted:
            typer.echo(text)
            serving.serve(serving.Server(served), interrupted)


def _modules(
    rig: Rig | None, seed: int, config_file: Path | None
) -> dict[str, tuple[SimulatedModule, Path | None]]:
    """Return the modules by their names, each with the file of its parameters.

    Without a rig it is a single one as its maker leaves it: neither set up nor calibrated.
    """
    simulated: dict[str, tuple[SimulatedModule, Path | None]] = {}
    if rig is None:
        settings = None if config_file is None else serving.read_settings(config_file)
        simulated[SINGLE_MODULE] = (SimulatedModule(seed=seed, settings=settings), config_file)
    else:
        lengths = rig.lengths(rig.home, frames=rig.at_rest)
        for index, (each, length) in enumerate(zip(rig.modules, lengths, strict=True)):
            file = config_file and config_file.with_name(f"{config_file.stem}-{index + 1}{config_file.suffix}")
            module = simulated_module(
                each,
                float(length),
                serial_number=index + 1,
                seed=seed + index,
                settings=None if file is None else serving.read_settings(file),
            )
            simulated[each.name] = (module, file)
    for module, file in simulated.values():
        if file is not None and file.exists() and not module.loaded:
            typer.echo(f"{file}: not the settings of a module; it starts with its defaults", err=True)
    return simulated


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
