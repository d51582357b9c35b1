"""``tensionlab scenario``: haptic scenarios on simulated modules with a simulated person, or on real modules."""

from __future__ import annotations

import sys
from contextlib import ExitStack, closing
from typing import Annotated

import typer

from tensionlab.allocation import Status
from tensionlab.cli.common import options, output
from tensionlab.cli.common.links import links_of_rig
from tensionlab.cli.common.options import Duration, Log, Lsl, Modules, Plot, Solver, View
from tensionlab.cli.common.runs import end_run, lsl_streams, print_required, print_simulated, show_run
from tensionlab.cli.common.verbs import Json
from tensionlab.errors import HardwareError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.source import tracked_pose
from tensionlab.hardware import RealClock, connect
from tensionlab.scenarios import SCENARIOS, Scenario, check_needs, load_scenario
from tensionlab.scenarios.checks import Check, Directions, check_directions, checks_table, loop_delay
from tensionlab.scenarios.expected import EXPECTED, check_scenario
from tensionlab.scenarios.play import ScenarioModules, ScenarioResult, needs_tracker, play, simulate_modules
from tensionlab.support.files.named import list_names
from tensionlab.support.table import Column, Finding, Table, findings_table

LIST = "list"  # in place of a name: lists the scenarios


def scenario(
    name: Annotated[
        str,
        typer.Argument(
            help="Name of a scenario, as `tensionlab scenario list` lists them, or file (TOML).",
            autocompletion=options.complete(lambda: (*SCENARIOS, LIST)),
        ),
    ],
    rig: Annotated[
        str | None,
        typer.Option(
            metavar="RIG",
            autocompletion=options.complete(lambda: list_names("rigs")),
            help="Rig in place of the scenario's own: a name, as `tensionlab datasets rigs` lists them, or a file "
            "(TOML). One with another axis up is turned.",
        ),
    ] = None,
    modules: Modules = None,
    solver: Solver = "newton",
    seconds: Duration = None,
    osc: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            help="With --modules: receive the positions of hand and bodies by OSC at this UDP port, as "
            "/body/NAME x y z.",
            min=1,
            max=65535,
        ),
    ] = None,
    log: Log = None,
    lsl: Lsl = False,
    plot: Plot = None,
    view: View = False,
    json: Json = False,
) -> None:
    """Play a haptic scenario and check its forces.

    Before it plays, it says whether the rig reaches where the hand goes, and can do what is desired there. Then
    it compares the rendered forces with what a person should feel. On simulated modules, a simulated person acts,
    as fast as this computer can, or with --view or --lsl in real time. Exit status 1 where a measured value is
    not as expected, something went wrong with a module, or the rig can do nothing of the scenario.
    """
    if name == LIST:
        _list(json)
        return
    loaded = load_scenario(name, rig)
    options.check_solvers(loaded.rig, [solver], loaded.policy)
    if seconds is not None and seconds > loaded.seconds:
        raise typer.BadParameter(f"--seconds is above 0 and at most {loaded.seconds:g}; got {seconds:g}")
    _require_tracking(loaded, modules, osc)
    needs = check_needs(loaded)
    if not json:
        _print_needs(loaded, needs)
    if all(each.passed is False for each in needs):
        output.print_error(
            f'rig "{loaded.rig.name}" can do nothing of scenario "{loaded.name}"; give another --rig'
        )
        raise typer.Exit(1)
    with ExitStack() as opened, output.progress(loaded.title) as progress:
        if view:
            show_run()
        reached = _reach(loaded, modules, osc, opened, paced=view or lsl)
        call = ["tensionlab", *sys.argv[1:]]
        try:
            streams = lsl_streams(loaded.rig, solver, loaded.rate, wanted=lsl)
            played = play(loaded, reached, solver, seconds, log, call, progress, streams)
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    complete = seconds in (None, loaded.seconds) and not played.statistics.ended.startswith("signal")
    rows = check_scenario(played) if complete and rig is None else ()
    found = check_directions(played.run)
    with output.ResultWriter(quiet=json) as writer:
        writer.draw(plot, "scenario", played)
        if json:
            output.print_json(
                scenario=loaded.name,
                rig=loaded.rig.name,
                turned=loaded.turned or None,
                needs=needs,
                checks=[{**row._asdict(), "met": row.met} for row in rows],
                directions={"cycles": found.cycles, "within": found.within, **found.reasons},
                delay=loop_delay(played),
                run=played.statistics.summary(),
                events=played.run.events,
            )
        else:
            _print(played, rows, found)
            if loaded.name in EXPECTED and not rows:
                where = "when a scenario is played as a whole" if not complete else "on the scenario's own rig"
                typer.echo(f"Expected values are only compared {where}.")
    end_run(played.statistics, streams, log)
    if found.reasons["unexplained"] or not all(row.met for row in rows):
        raise typer.Exit(1)


def _require_tracking(scenario: Scenario, modules: str | None, osc: int | None) -> None:
    """Refuse a tracker of a simulated person, and real modules without the tracker that they need."""
    if modules is None and osc is not None:
        raise typer.BadParameter("--osc is for real modules; of a simulated person it is known where it is")
    if modules is not None and osc is None and needs_tracker(scenario.rig):
        raise typer.BadParameter(
            f"the cables of {scenario.rig.name} cannot tell where everything is: give --osc PORT, and have a "
            f"tracker send /body/{', /body/'.join(['hand', *scenario.rig.frames])}"
        )


def _reach(
    scenario: Scenario, modules: str | None, osc: int | None, opened: ExitStack, *, paced: bool
) -> ScenarioModules:
    """Open the modules, to be closed with the rest, and what tracks hand and bodies.

    The time of simulated ones goes no faster than real time if ``paced``, else as fast as it can.
    """
    if modules is None:
        print_simulated()
        reached = simulate_modules(scenario, paced=paced)
        opened.callback(reached.group.close)
        return reached
    links = links_of_rig(scenario.rig, modules)
    client = tracker = None
    if osc is not None:
        client = ClientState(scenario.rig)
        opened.enter_context(
            OscServer(client, "127.0.0.1", osc, lambda why: typer.echo(f"refused: {why}", err=True))
        )
        tracker = tracked_pose(client)
    group = opened.enter_context(closing(connect(scenario.rig, links)))
    return ScenarioModules(group, RealClock(group.clients), links, tracker, client=client)


def _list(json: bool) -> None:
    """Print the scenarios that come with the package."""
    loaded = [load_scenario(name) for name in SCENARIOS]
    if json:
        output.print_json(
            [
                output.fields(each, "name", "title", "about", "seconds")
                | {"modules": {module.name: module.frame for module in each.rig.modules}}
                for each in loaded
            ]
        )
        return
    rows = []
    for each in loaded:
        worn = sum(module.frame in each.rig.frames for module in each.rig.modules)
        rows.append((each.name, each.about, each.rig.m - worn, worn, each.seconds))
    title = "Layouts and numbers are proposals of this project, after the publication's scenarios."
    columns = ["name", "what", "modules in the room", "modules on a body", Column("duration", "s")]
    output.print_table(Table(columns, rows, title))


def _print_needs(scenario: Scenario, needs: list[Finding]) -> None:
    """Print what a scenario needs of its rig, and whether that has it."""
    print_required(scenario.rig)
    if scenario.turned:
        output.print_line(scenario.turned)
    output.print_table(findings_table(f'Can {scenario.rig.name} play "{scenario.name}"?', needs))
    output.print_line()


def _print(played: ScenarioResult, rows: tuple[Check, ...], found: Directions) -> None:
    """Print measured and expected values, and where forces pointed."""
    if rows:
        output.print_table(checks_table(rows, f"{played.scenario.title}: {played.scenario.about}"))
        output.print_line()
    reasons = [f"{count} {reason}" for reason, count in found.reasons.items() if count]
    elsewhere = f"; elsewhere: {', '.join(reasons)}" if reasons else ""
    output.print_prose(
        f"Forces above 0.5 N in {found.cycles} of {len(played.run)} cycles: "
        f"{found.within} within 45 degrees of the desired ones{elsewhere}."
    )
    output.print_prose(f"Loop latency {1e3 * loop_delay(played):.0f} ms.")
    statistics = played.statistics
    if set(statistics.statuses) - {Status.EXACT}:
        output.print_line(f"Answers: {statistics.explained}.")
    if statistics.missed:
        output.print_prose(
            f"{statistics.missed} of {statistics.missed + statistics.cycles} deadlines missed: forces came late, "
            "or from an older position. Is the computer busy?"
        )
