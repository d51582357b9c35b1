"""What the verbs share that render forces: a solver that serves the rig, its modules, and the log of the run."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from tensionlab.cli.common import output

if TYPE_CHECKING:
    from tensionlab.hardware.client.group import ModuleGroup
    from tensionlab.hardware.log.writer import RunLog
    from tensionlab.hardware.runner.settings import Clock, RunSettings
    from tensionlab.hardware.simulation.world import Motion
    from tensionlab.model.rig import Rig

Modules = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|URL,...",
        help="Modules file, or links in the rig's order. Simulated modules in this process if left out.",
    ),
]
Solver = Annotated[str, typer.Option(help="A name that `tensionlab solvers` lists.")]


def positive(value: float | None) -> float | None:
    """Refuse what is no finite number above 0, as a callback of an option.

    Raises
    ------
    BadParameter
        Before anything is done.
    """
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"give a finite number above 0; got {value:g}")
    return value


class Reached(NamedTuple):
    """All modules of a rig, open: their clients, the clock that they go by, and where each was reached."""

    group: ModuleGroup
    clock: Clock
    links: dict[str, str]


def reach_modules(rig: Rig, modules: str | None, motion: Motion | None) -> Reached:
    """Reach all modules of a rig, or simulate them in this process, which is said.

    Parameters
    ----------
    rig : Rig
    modules : str or None
        What ``--modules`` says; simulated ones if it is left out.
    motion : callable or None
        Where the platform is, at a time in s, that simulated ones hold; at the rig's home if None.

    Raises
    ------
    BadParameter
        For a number of links that is not that of the modules.
    HardwareError
        As `load_modules` and `connect` do.
    """
    from tensionlab.hardware.client.group import connect
    from tensionlab.hardware.runner.settings import RealClock, WorldClock
    from tensionlab.hardware.simulation.world import World

    if modules is None:
        note_simulated()
        world = World(rig, motion)
        links = dict.fromkeys((module.name for module in rig.modules), "sim:")
        return Reached(world.group(), WorldClock(world, paced=True), links)
    links = module_links(rig, modules)
    return Reached(connect(rig, links), RealClock(), links)


def note_simulated() -> None:
    """Say that the modules are simulated, so that nobody waits for real ones to pull."""
    typer.echo("no --modules: these are simulated, in this process", err=True)


def module_links(rig: Rig, modules: str) -> dict[str, str]:
    """Where is each module reached?"""
    from tensionlab.hardware.client.modules_file import load_modules

    if modules.endswith(".toml"):
        return load_modules(modules)
    urls = [url.strip() for url in modules.split(",") if url.strip()]
    if len(urls) != rig.m:
        names = ", ".join(module.name for module in rig.modules)
        raise typer.BadParameter(
            f"--modules has {len(urls)} links, {rig.name} has {rig.m} modules ({names}); give a link for each, "
            "or a file that ends in .toml"
        )
    return {module.name: url for module, url in zip(rig.modules, urls, strict=True)}


def check_solver(rig: Rig, solver: str, nearest: str | None) -> None:
    """Refuse a solver that does not serve this rig."""
    output.check_solvers(rig, [solver], nearest)


def log_of(path: Path, rig: Rig, solver: str, settings: RunSettings, links: dict[str, str]) -> RunLog:
    """Begin the log of a run."""
    from tensionlab.hardware.log.writer import RunLog
    from tensionlab.records import manifest

    return RunLog(path, rig, manifest(["tensionlab", *sys.argv[1:]]), solver, settings, links)
