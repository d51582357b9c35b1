"""``tensionlab scenario``: haptic scenarios on simulated modules with a simulated person, or on real modules."""

from __future__ import annotations

import sys
from contextlib import ExitStack, closing
from typing import Annotated

import typer

from tensionlab.cli.common import options, output, runs
from tensionlab.cli.common.links import links_of_rig
from tensionlab.cli.common.verbs import Json, option, port_option
from tensionlab.errors import HardwareError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.source import tracked_pose
from tensionlab.hardware import RealClock, connect
from tensionlab.scenarios import SCENARIOS, Scenario, check_needs, load_scenario
from tensionlab.scenarios.fidelity import loop_delay, scenario_fidelity
from tensionlab.scenarios.play import ScenarioModules, ScenarioResult, needs_tracker, play, simulate_modules
from tensionlab.support.files.named import list_names
from tensionlab.support.table import Column, Table, findings_table

LIST = "list"  # in place of a name: lists the scenarios


def scenario(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="Name of a scenario, as `tensionlab scenario list` lists them, or file (TOML).",
            autocompletion=options.complete(lambda: (*SCENARIOS, LIST)),
        ),
    ],
    rig: Annotated[
        str | None,
        option(
            "RIG",
            "Rig in place of the scenario's, to whose axes it is turned: a name or a file (TOML).",
            autocompletion=options.complete(lambda: list_names("rigs")),
        ),
    ] = None,
    at: Annotated[
        str | None, option("X Y Z", "Start of the hand in m, in the rig's axes; with --facing alone, home.")
    ] = None,
    facing: Annotated[
        str | None, option("X Y Z", "Direction of the person, in the rig's axes; with --at alone, the scenario's.")
    ] = None,
    modules: options.Modules = None,
    solver: options.Solver = "newton",
    seconds: options.Duration = None,
    osc: Annotated[
        int | None,
        port_option("With --modules: UDP port of OSC for positions of bodies, /body/NAME x y z.", least=1),
    ] = None,
    log: options.Log = None,
    lsl: options.Lsl = False,
    plot: options.Plot = None,
    view: options.View = False,
    json: Json = False,
) -> None:
    """Play a haptic scenario and judge its forces.

    Before it plays, it says whether the rig reaches where the hand goes, and can do what is desired there. Then
    it compares the rendered forces with what a person should feel. On simulated modules, a simulated person acts,
    as fast as this computer can, or with --view or --lsl in real time. Exit status 1 where a person would notice
    that a feasible force is not as desired, something went wrong with a module, or the rig can do nothing of the
    scenario.

    With --at or --facing the scenario moves to where the hand is, and is scaled to what the rig reaches there.
    """
    if name == LIST:
        _list(json)
        return
    given = {"at": at, "facing": facing}.items()
    numbers = {key: options.parse_numbers(f"--{key}", text) for key, text in given if text is not None}
    loaded = load_scenario(name, rig, **numbers)
    _check(loaded, solver, seconds, modules, osc)
    needs = check_needs(loaded)
    if not json:
        runs.print_required(loaded.rig)
        if loaded.placement:
            output.print_line(loaded.placement)
        output.print_table(findings_table(f'Can {loaded.rig.name} play "{loaded.name}"?', needs))
    if needs[0].passed is False or all(need.passed is False for need in needs):  # the reach is first
        output.print_error(
            f'rig "{loaded.rig.name}" can do nothing of scenario "{loaded.name}"; give another --rig or --at'
        )
        raise typer.Exit(1)
    with ExitStack() as opened, output.progress(loaded.title) as progress:
        if view:
            runs.show_run()
        reached = _reach(loaded, modules, osc, opened, paced=view or lsl)
        try:
            streams = runs.lsl_streams(loaded.rig, solver, loaded.rate, wanted=lsl)
            call = ["tensionlab", *sys.argv[1:]]
            played = play(loaded, reached, solver, seconds, log, call, progress, streams)
        except HardwareError as error:
            output.print_error(str(error))
            raise typer.Exit(1) from None
    fidelity = scenario_fidelity(played)
    with output.ResultWriter(quiet=json) as writer:
        writer.draw(plot, "scenario", played)
        if json:
            output.print_json(
                scenario=loaded.name,
                rig=loaded.rig.name,
                placement=loaded.placement or None,
                needs=needs,
                fidelity={name: effect.summary() for name, effect in fidelity.items()},
                delay=loop_delay(played),
                run=played.statistics.summary(),
                events=played.run.events,
            )
        else:
            output.print_table(_summary(played))
            runs.print_fidelity(fidelity)
    runs.end_run(played.statistics, streams, log)
    if any(effect.passed is False for effect in fidelity.values()):
        raise typer.Exit(1)


def _list(json: bool) -> None:
    loaded = [load_scenario(name) for name in SCENARIOS]
    if json:
        output.print_json([output.fields(scenario, "name", "title", "about", "seconds") for scenario in loaded])
        return
    rows = [
        (scenario.name, scenario.about, scenario.rig.m, scenario.frame,
         ", ".join(scenario.person.bodies) or None, scenario.seconds)
        for scenario in loaded
    ]  # fmt: skip
    title = "Layouts and numbers are proposals of this project, after the publication's scenarios."
    columns = ["name", "description", "modules", "frame needed", "frames that move", Column("duration", "s")]
    notes = [
        "A rig has modules on the frame that is needed; others may have modules on those that move, or on none."
    ]
    output.print_table(Table(columns, rows, title, notes))


def _check(scenario: Scenario, solver: str, seconds: float | None, modules: str | None, osc: int | None) -> None:
    """Refuse a solver or a duration that does not suit, and a tracker that is missing or of no use."""
    options.check_solvers(scenario.rig, [solver], scenario.policy)
    if seconds is not None and seconds > scenario.seconds:
        raise typer.BadParameter(f"--seconds is above 0 and at most {scenario.seconds:g}; got {seconds:g}")
    if modules is None and osc is not None:
        raise typer.BadParameter("--osc is for real modules; the position of a simulated person is known")
    if modules is not None and osc is None and needs_tracker(scenario.rig):
        tracked = ", ".join(f"/body/{body}" for body in ("hand", *scenario.rig.frames))
        unknown = f"the cables of {scenario.rig.name} cannot tell where everything is"
        raise typer.BadParameter(f"{unknown}: give --osc PORT, and have a tracker send {tracked}")


def _reach(
    scenario: Scenario, modules: str | None, osc: int | None, opened: ExitStack, *, paced: bool
) -> ScenarioModules:
    """Open the modules and what tracks hand and bodies; simulated time passes no faster than real if ``paced``."""
    if modules is None:
        runs.print_simulated()
        reached = simulate_modules(scenario, paced=paced)
        opened.callback(reached.group.close)
        return reached
    links = links_of_rig(scenario.rig, modules)
    client = tracker = None
    if osc is not None:
        client = ClientState(scenario.rig)
        opened.enter_context(
            OscServer(client, "127.0.0.1", osc, lambda why: output.print_message(f"refused: {why}"))
        )
        tracker = tracked_pose(client)
    group = opened.enter_context(closing(connect(scenario.rig, links)))
    return ScenarioModules(group, RealClock(group.clients), links, tracker, client=client)


def _summary(played: ScenarioResult) -> Table:
    statistics = played.statistics
    notes = [f"Loop latency {1e3 * loop_delay(played):.0f} ms.", f"Answers: {statistics.explained}."]
    if statistics.missed:
        notes.append(
            f"{statistics.missed} of {statistics.missed + statistics.cycles} deadlines missed: forces came late, "
            "or from an older position. Is the computer busy?"
        )
    return Table([], [], notes=notes)
