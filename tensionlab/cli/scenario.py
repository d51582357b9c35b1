"""``tensionlab scenario``: something to feel, on simulated modules with a simulated person, or on real ones."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.modules import module_links, print_simulated
from tensionlab.cli.common.options import Modules, Solver
from tensionlab.cli.common.output import INTERRUPTED
from tensionlab.files import writing

if TYPE_CHECKING:
    from tensionlab.scenarios import Scenario
    from tensionlab.scenarios.direction import Directions
    from tensionlab.scenarios.expected_values import Check
    from tensionlab.scenarios.play import ScenarioModules, ScenarioResult

LIST = "list"


def scenario(
    name: Annotated[
        str,
        typer.Argument(help="A name that `tensionlab scenario list` shows, or a file (TOML).", show_default=False),
    ],
    modules: Modules = None,
    solver: Solver = "newton",
    seconds: Annotated[
        float | None, typer.Option(callback=options.require_positive, help="How much of it; all if left out.")
    ] = None,
    osc: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            help="With --modules: where hand and bodies are comes by OSC to this UDP port: /body/NAME x y z.",
            min=1,
            max=65535,
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", callback=options.output_file(".mcap"), help="Keep every cycle there."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", callback=options.picture_file, help="The picture.  [default: scenario-NAME.png]"
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was felt as JSON.")] = False,
) -> None:
    """Play a scenario, compare what was felt with what should be, and draw it.

    On simulated modules, a simulated person acts, as fast as this machine can. Exit status 1 where something felt
    otherwise than it should, or went wrong with a module.
    """
    from tensionlab.errors import HardwareError
    from tensionlab.plots import plot_scenario
    from tensionlab.scenarios import load_scenario
    from tensionlab.scenarios.direction import check_directions
    from tensionlab.scenarios.expected import check_scenario
    from tensionlab.scenarios.play import play

    if name == LIST:
        _list(json)
        return
    played_one = load_scenario(name)
    options.check_solvers(played_one.rig, [solver], played_one.nearest)
    if seconds is not None and not 0.0 < seconds <= played_one.seconds:
        raise typer.BadParameter(f"--seconds is above 0 and at most {played_one.seconds:g}; got {seconds:g}")
    picture = plot or Path(f"scenario-{played_one.name}.png")
    writing.require_writable(picture)
    with ExitStack() as opened, output.progress(played_one.title) as progress:
        reached = _reached(played_one, modules, osc, opened)
        try:
            call = ["tensionlab", *sys.argv[1:]]
            played = play(played_one, reached, solver, seconds, log, call, progress)
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    interrupted = played.statistics.ended.startswith("signal") and not played.statistics.emergency
    whole = seconds in (None, played_one.seconds) and not interrupted
    rows = check_scenario(played) if whole else ()
    found = check_directions(played.run)
    with output.Keeper(quiet=json) as keeper:
        keeper.write("Picture", picture, lambda path: plot_scenario(played, rows, path))
        if json:
            output.print_json(_as_json(played, rows, found, picture))
        else:
            _show(played, rows, found)
            if not whole:
                typer.echo("What it should feel like is judged when it is played as a whole.")
    if interrupted:
        output.print_error(f"interrupted after {len(played.run)} cycles; its modules have been stopped")
        raise typer.Exit(INTERRUPTED)
    wrong = not all(row.met for row in rows) or found.reasons["unexplained"] > 0
    if wrong or played.statistics.unconfirmed or played.statistics.lost or played.statistics.emergency:
        raise typer.Exit(1)


def _reached(scenario: Scenario, modules: str | None, osc: int | None, opened: ExitStack) -> ScenarioModules:
    """Open the modules, to be closed with the rest, and find out who tells where everything is."""
    from contextlib import closing

    from tensionlab.haptics.bridge.client_state import ClientState
    from tensionlab.haptics.bridge.osc import OscServer
    from tensionlab.haptics.bridge.source import tracked_pose
    from tensionlab.hardware import RealClock, connect
    from tensionlab.scenarios.play import ScenarioModules, needs_tracker, simulate_modules

    if modules is None:
        if osc is not None:
            raise typer.BadParameter("--osc is for real modules; of a simulated person it is known where it is")
        print_simulated()
        reached = simulate_modules(scenario)
        opened.callback(reached.group.close)
        return reached
    if osc is None and needs_tracker(scenario.rig):
        raise typer.BadParameter(
            f"the cables of {scenario.rig.name} cannot tell where everything is: give --osc PORT, and have a "
            f"tracker send /body/{', /body/'.join(['hand', *scenario.rig.frames])}"
        )
    links = module_links(scenario.rig, modules)
    client = tracker = None
    if osc is not None:
        client = ClientState(scenario.rig)
        opened.enter_context(OscServer(client, "127.0.0.1", osc, lambda why: typer.echo(why, err=True)))
        tracker = tracked_pose(client)
    group = opened.enter_context(closing(connect(scenario.rig, links)))
    return ScenarioModules(group, RealClock(), links, tracker, client=client)


def _list(json: bool) -> None:
    """Show what there is."""
    from tensionlab.scenarios import SCENARIOS, load_scenario

    loaded = [load_scenario(name) for name in SCENARIOS]
    if json:
        output.print_json([
            {
                "name": each.name,
                "title": each.title,
                "about": each.about,
                "seconds": each.seconds,
                "modules": {module.name: module.frame for module in each.rig.modules},
            }
            for each in loaded
        ])  # fmt: skip
        return
    title = "Layouts and numbers are proposals of this project, after the publication's scenarios."
    table = output.table(title, ("<name", "<what", "room", "body", "s"))
    for each in loaded:
        worn = sum(module.frame in each.rig.frames for module in each.rig.modules)
        table.add_row(each.name, each.about, str(each.rig.m - worn), str(worn), f"{each.seconds:g}")
    output.console().print(table)


def _show(played: ScenarioResult, rows: tuple[Check, ...], found: Directions) -> None:
    """Print what was felt, and where forces pointed."""
    console = output.console()
    title = f"{played.scenario.title}: {played.scenario.about}"
    table = output.table(title, ("<", "measured", "expected", "<", "<"))
    for row in rows:
        unit = "" if row.unit == "1" else row.unit
        bounds = f"{output.short(row.low)} to {output.short(row.high)}"
        table.add_row(row.name, output.short(row.measured), bounds, unit, "" if row.met else "not met")
    if rows:
        console.print(table)
        console.print()
    reasons = [f"{count} {reason}" for reason, count in found.reasons.items() if count]
    elsewhere = f"; elsewhere: {', '.join(reasons)}" if reasons else ""
    console.print(
        f"Forces above 0.5 N in {found.cycles} of {len(played.run)} cycles: "
        f"{found.within} within 45 degrees of the intended ones{elsewhere}."
    )
    console.print(f"The loop was {1e3 * _delay(played):.0f} ms late.")


def _delay(played: ScenarioResult) -> float:
    from tensionlab.scenarios.expected_values import loop_delay

    return loop_delay(played)


def _as_json(
    played: ScenarioResult, rows: tuple[Check, ...], found: Directions, picture: Path
) -> dict[str, object]:
    return {
        "scenario": played.scenario.name,
        "checks": [{**row._asdict(), "met": row.met} for row in rows],
        "directions": {"cycles": found.cycles, "within": found.within, **found.reasons},
        "delay": _delay(played),
        "run": played.statistics.summary(),
        "events": [vars(event) for event in played.run.events],
        "picture": str(picture),
    }
