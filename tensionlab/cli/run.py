"""``tensionlab run``: render forces on the modules of a rig."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.rig_modules import Modules, Solver, check_solver, log_of, positive, reach_modules

if TYPE_CHECKING:
    from tensionlab.demand import DemandSource
    from tensionlab.hardware.runner.runner import Tracker
    from tensionlab.model.rig import Rig

REFRESH = 5.0
"""How often a second the live table is drawn anew."""


def run(
    rig: Annotated[Path, typer.Argument(help="Rig file (TOML).", show_default=False)],
    modules: Modules = None,
    solver: Solver = "newton",
    nearest: Annotated[
        str | None, typer.Option(help="Out of reach: force, tension or direction; the solver's own if left out.")
    ] = None,
    force: Annotated[
        str | None, typer.Option(metavar="X Y Z", help="Force in N; torques in N·m after it, else none.")
    ] = None,
    program: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Program (TOML): wrenches one after another.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(metavar="X Y Z", help="Where the point is, in m; told by the lengths if left out."),
    ] = None,
    rate: Annotated[float, typer.Option(callback=positive, help="Cycles a second.")] = 50.0,
    ttl: Annotated[
        float,
        typer.Option(
            callback=positive, help="How long a set-point lives in a module, in s; so long may one be silent."
        ),
    ] = 0.25,
    seconds: Annotated[
        float | None,
        typer.Option(callback=positive, help="How long; until the program's end or Ctrl-C if left out."),
    ] = None,
    on_loss: Annotated[
        str, typer.Option(help="When a module drops out: stop all, or continue with the others.")
    ] = "stop",
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", callback=output.output_file(".mcap"), help="Keep every cycle there."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print how it went as JSON; no live table.")] = False,
) -> None:
    """Render forces on the modules of a rig. Without a force or a program, the cables are held taut.

    Ctrl-C ends the run; all modules are stopped then, and whatever else ends it. Exit status 1 where something
    went wrong with a module, a module did not confirm that it has stopped, or an emergency stop ended the run.
    """
    from tensionlab.cli.common.run_table import Screen, summary_table
    from tensionlab.errors import HardwareError
    from tensionlab.hardware.runner.runner import Runner
    from tensionlab.hardware.runner.settings import RunSettings
    from tensionlab.model.files import load_rig

    loaded = load_rig(rig)
    demand = _demand(loaded, force, program)
    settings = RunSettings(rate=rate, ttl=ttl, on_loss=on_loss, nearest=nearest)  # type: ignore[arg-type]  # it checks them
    check_solver(loaded, solver, nearest)
    place = _place(loaded, at)
    group, clock, links = reach_modules(loaded, modules, place)
    failure: HardwareError | None = None
    try:
        runner = Runner(loaded, group, solver, demand, settings, clock=clock, tracker=place)
        if log is not None:
            runner.log = log_of(log, loaded, solver, settings, links)
        shown = sys.stdout.isatty() and not json
        with Screen(runner, REFRESH) if shown else nullcontext():
            try:
                runner.run(seconds)
            except HardwareError as error:
                failure = error
    finally:
        group.close()
    statistics = runner.statistics
    if json:
        output.print_json(statistics.summary())
    else:
        output.console().print(summary_table(runner))
    if failure is not None:
        typer.echo(f"tensionlab: {failure}", err=True)
    for name, why in statistics.unconfirmed.items():
        typer.echo(f'tensionlab: module "{name}" did not confirm that it has stopped: {why}', err=True)
    if failure is not None or statistics.emergency or statistics.unconfirmed or statistics.lost:
        raise typer.Exit(1)


def _demand(rig: Rig, force: str | None, program: Path | None) -> DemandSource:
    """What is to be rendered?"""
    import numpy as np

    from tensionlab.demand import Demand
    from tensionlab.hardware.runner.program import load_program

    if force is not None and program is not None:
        raise typer.BadParameter("--force and --program are both given; give one of them")
    if program is not None:
        return load_program(program, rig)
    if force is None:
        return lambda state: Demand()
    wrench = np.array(output.numbers(force))
    if not np.isfinite(wrench).all():
        raise typer.BadParameter(f"--force is {force}; give finite numbers, in N and N·m")
    if wrench.size not in (rig.dimension, rig.n):
        names = ", ".join(output.components(rig))
        raise typer.BadParameter(f"--force has {wrench.size} components; {rig.name} needs {rig.n}: {names}")
    constant = Demand(np.pad(wrench, (0, rig.n - wrench.size)))
    return lambda state: constant


def _place(rig: Rig, at: str | None) -> Tracker | None:
    """Where is the point at each time? None if the cable lengths are to tell."""
    import numpy as np

    from tensionlab.demand import Pose

    if at is None:
        return None
    position = np.array(output.numbers(at))
    rig.lengths(position, frames=rig.at_rest)  # refuses what is no place
    pose = Pose(position, frames=rig.at_rest)
    return lambda time: pose
