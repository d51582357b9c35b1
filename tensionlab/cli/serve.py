"""``tensionlab serve``: the bridge, through which game engines drive a rig."""

from __future__ import annotations

import os
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.runs import end_run, open_sinks, reach_modules, show_run
from tensionlab.cli.common.verbs import option, port_option
from tensionlab.cli.run import print_summary
from tensionlab.errors import InputError, TensionlabError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.command import LimitedReport
from tensionlab.haptics.bridge.events import RunEvents
from tensionlab.haptics.bridge.messages import HAND, Welcome
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.schema import schema_text
from tensionlab.haptics.bridge.server import PAGE_PATH, SCHEMA_PATH, Admission, Bridge
from tensionlab.haptics.bridge.source import BridgedDemand, FreeEffects, Inner, tracked_pose
from tensionlab.haptics.rendering.renderer import FADE_DELAY_S, FADE_S
from tensionlab.hardware import Runner, RunSettings
from tensionlab.hardware.client.group import temporary_slew
from tensionlab.hardware.protocol.codes import BrakeState, Limit
from tensionlab.hardware.sharing import SharedRun
from tensionlab.hardware.simulation.world import GuidedHand
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.scenarios import SCENARIOS, Scenario, ScenarioDemand, load_scenario
from tensionlab.scenarios.play import module_limits, needs_tracker
from tensionlab.scenarios.scenery import as_mapping
from tensionlab.support.files.reading import read_text

TOKEN_VARIABLE = "TENSIONLAB_BRIDGE_TOKEN"  # environment variable that may hold the token of clients
# How fast tensions may change: the most that modules take. At their default of 60 N/s, a hand that is pressed
# against a wall of 300 N/m shakes, even where the module renders it.
MAX_SLEW_RATE_N_PER_S = 300.0


def serve(
    rig: Annotated[str | None, options.rig_argument("; the scenario's own if left out")] = None,
    scenario: Annotated[
        str | None,
        option(
            "NAME",
            "Repeat a scenario, with the client's bodies, and its effects in place of those with the same names.",
            autocompletion=options.complete(lambda: SCENARIOS),
        ),
    ] = None,
    modules: options.Modules = None,
    solver: options.Solver = "newton",
    rate: Annotated[
        float | None,
        option("HZ", "Cycles per second.  [default: 50, or the scenario's]", callback=options.require_positive),
    ] = None,
    seconds: options.Duration = None,
    host: Annotated[
        str,
        option("HOST", f"Address to listen at. Other computers need a token: --token-file or {TOKEN_VARIABLE}."),
    ] = "127.0.0.1",
    port: Annotated[int, port_option("Port of the WebSocket; 0 takes a free one.")] = 8765,
    osc: Annotated[int | None, port_option("Also listen for OSC at this UDP port.")] = None,
    osc_host: Annotated[
        str, option("HOST", "Address to listen at for OSC, which has no token: anyone who reaches it sets forces.")
    ] = "127.0.0.1",
    token_file: Annotated[
        Path | None,
        option("FILE", "File with the token of clients: others on this computer can read command lines."),
    ] = None,
    page: Annotated[list[str] | None, option("ORIGIN", "A web page that may connect; may be repeated.")] = None,
    log: options.Log = None,
    lsl: options.Lsl = False,
    view: options.View = False,
) -> None:
    """Let a game engine drive a rig over a WebSocket.

    The engine sends poses and effects, and receives the state; the site's page on the bridge describes the
    messages. Without --modules, the simulated hand is where the client says it is. Ctrl-C stops all modules and
    ends it.
    """
    loaded, played, settings = _load(rig, scenario, rate)
    options.check_solvers(loaded, [solver], settings.policy)
    client = ClientState(loaded)
    follow = tracked_pose(client)
    limits, brakes = ({int(member): member.name for member in kind} for kind in (Limit, BrakeState))
    events = RunEvents(loaded, limits, brakes, lambda: client.count)

    def report(kind: str, line: str) -> None:
        output.print_message(f"{kind}: {line}")
        events.note(kind, line)

    def note(kind: str, text: str) -> None:
        events.note(kind, text)
        runner.note(kind, text)

    clients = LimitedReport(partial(report, "client"), client.clock)
    admission = Admission(_token(token_file), tuple(page or ()), schema_text(loaded))
    bridge = Bridge(client, _welcome(loaded, played, settings), events.state, host, port, admission, clients)
    events.send = bridge.broadcast
    inner: Inner = FreeEffects(client) if played is None else ScenarioDemand(played, note, repeat=True)
    scenery = {} if played is None else as_mapping(played, repeat=True)
    failure: TensionlabError | None = None
    with ExitStack() as stack:
        with output.if_interrupted("before the run began; no module pulls"):
            stack.enter_context(bridge)
            web = bridge.url.replace("ws:", "http:")
            typer.echo(f"{bridge.url}/command takes frames, {bridge.url}/events tells what happens")
            typer.echo(f"{web}{PAGE_PATH} shows the state, {web}{SCHEMA_PATH} has the messages' schema")
            if osc is not None:
                door = stack.enter_context(OscServer(client, osc_host, osc, partial(report, "refused")))
                typer.echo(f"OSC at UDP port {door.port}")
            if view:
                show_run()
            group, clock, links = reach_modules(loaded, modules, GuidedHand(follow))
            stack.callback(group.close)
            stack.enter_context(temporary_slew(group, MAX_SLEW_RATE_N_PER_S if played is None else played.slew))
            inner.renderer.limits = module_limits(loaded, group)
            demand = BridgedDemand(client, inner, events)
            tracker = follow if played is not None or needs_tracker(loaded) else None
            sinks = open_sinks(log, loaded, solver, settings, links, lsl, scenery)
            sinks.append(SharedRun(loaded, solver, settings, group.clients, scenery))
            runner = Runner(loaded, group, solver, demand, settings, sinks=sinks, clock=clock, tracker=tracker)
        try:
            runner.run(seconds)
        except TensionlabError as error:  # also of an effect that the scenario's author wrote
            failure = error
        events.note("ended", runner.statistics.ended)
    print_summary(runner)
    end_run(runner.statistics, runner.sinks, log, failure)


def _load(name: str | None, scenario: str | None, rate: float | None) -> tuple[Rig, Scenario | None, RunSettings]:
    if scenario is None and name is None:
        raise typer.BadParameter("give a rig, or --scenario NAME, which has a rig of its own")
    if scenario is None:
        return load_rig(str(name)), None, RunSettings(rate or RunSettings().rate)
    played = load_scenario(scenario, name)
    if played.placement:
        output.print_message(played.placement)
    return played.rig, played, RunSettings(rate or played.rate, policy=played.policy)


def _welcome(rig: Rig, played: Scenario | None, settings: RunSettings) -> Welcome:
    return Welcome(
        rig=rig.name,
        up=rig.up,
        modules=[module.name for module in rig.modules],
        upper=rig.limits.upper.tolist(),
        scenario=None if played is None else played.name,
        bodies=[HAND, *rig.frames],
        rate=settings.rate,
        timeout=FADE_DELAY_S + FADE_S,
    )


def _token(file: Path | None) -> str | None:
    """Return the token of clients: from a file or, without one, from the environment."""
    if file is None:
        return os.environ.get(TOKEN_VARIABLE) or None
    token = read_text(file, "a file with the token of clients", InputError).strip()
    if not token:
        raise typer.BadParameter(f"--token-file {file} is empty; put the token of clients into it")
    return token
