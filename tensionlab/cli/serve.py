"""``tensionlab serve``: a door to a rig for game engines."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.modules import begin_log, reach_modules
from tensionlab.cli.common.options import Modules, Solver

if TYPE_CHECKING:
    from tensionlab.hardware import Runner, RunSettings
    from tensionlab.model.rig import Rig
    from tensionlab.scenarios import Scenario

TOKEN = "TENSIONLAB_BRIDGE_TOKEN"
"""Variable of the environment that may hold what clients must know."""
QUICK = 300.0
"""How fast tensions may change, in N/s: the most that modules take. At the 60 N/s with which they come, a hand
that is pressed against a wall of 300 N/m shakes, even where the module renders it."""


def serve(
    rig: Annotated[
        Path | None,
        typer.Argument(help="Rig file (TOML); the scenario's own if left out.", show_default=False),
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Play a scenario, over and over: hand and bodies are where the client says, and its effects take "
            "the place of the scenario's that have their names.",
        ),
    ] = None,
    modules: Modules = None,
    solver: Solver = "newton",
    rate: Annotated[
        float | None,
        typer.Option(
            callback=options.require_positive,
            help="Cycles a second.  [default: 50, or the scenario's]",
            show_default=False,
        ),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(callback=options.require_positive, help="How long; until Ctrl-C if left out.")
    ] = None,
    host: Annotated[
        str, typer.Option(help=f"Where to listen; beyond this machine with a token only: {TOKEN} or --token-file.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Of the WebSocket; 0 takes a free one.", min=0, max=65535)] = 8765,
    osc: Annotated[
        int | None, typer.Option(metavar="PORT", help="Listen for OSC there as well.", min=0, max=65535)
    ] = None,
    osc_host: Annotated[
        str,
        typer.Option(
            help="Where to listen for OSC, whatever --host is. OSC knows no token: whoever reaches it sets forces."
        ),
    ] = "127.0.0.1",
    token_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=f"What clients must know is in this file, or in the environment as {TOKEN}: not in the command "
            "line, which others on this machine can read.",
        ),
    ] = None,
    page: Annotated[
        list[str] | None, typer.Option(metavar="ORIGIN", help="A web page that may connect; also repeated.")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", callback=options.output_file(".mcap"), help="Keep every cycle there."),
    ] = None,
) -> None:
    """Let a program drive a rig over a WebSocket: poses and effects in, the state out. BRIDGE.md has the messages.

    Without --modules, the simulated hand is where the client says it is. Ctrl-C ends it, and all modules stop.
    """
    from tensionlab.cli.run import summary_table
    from tensionlab.haptics.bridge.client_state import HAND, ClientState
    from tensionlab.haptics.bridge.events import RunEvents
    from tensionlab.haptics.bridge.messages import Welcome
    from tensionlab.haptics.bridge.osc import OscServer
    from tensionlab.haptics.bridge.server import Bridge
    from tensionlab.haptics.bridge.source import BridgedDemand, FreeEffects, Inner, tracked_pose
    from tensionlab.haptics.rendering.filtering import FADE_DELAY_S, FADE_S
    from tensionlab.hardware import Runner
    from tensionlab.hardware.protocol.codes import BrakeState, Limit
    from tensionlab.hardware.simulation.guided_hand import GuidedHand
    from tensionlab.scenarios import ScenarioDemand
    from tensionlab.scenarios.play import module_limits, needs_tracker, temporary_slew

    loaded, played_one = _loaded(rig, scenario)
    settings, client = _settings(played_one, rate), ClientState(loaded)
    options.check_solvers(loaded, [solver], settings.nearest)
    follow = tracked_pose(client)
    welcome = Welcome(
        rig=loaded.name,
        modules=[module.name for module in loaded.modules],
        scenario=None if played_one is None else played_one.name,
        bodies=[HAND, *loaded.frames],
        rate=settings.rate,
        timeout=FADE_DELAY_S + FADE_S,
    )
    limits, brakes = ({int(each): each.name for each in kind} for kind in (Limit, BrakeState))
    events = RunEvents(loaded, limits, brakes, lambda: client.count)
    bridge = Bridge(client, welcome, events.state, host, port, _token(token_file), tuple(page or ()))
    events.send = bridge.broadcast
    inner: Inner = (
        FreeEffects(client) if played_one is None else ScenarioDemand(played_one, events.note, repeat=True)
    )
    with ExitStack() as stack:
        stack.enter_context(bridge)
        typer.echo(f"{bridge.url}/command takes frames, {bridge.url}/events tells what happens")
        if osc is not None:

            def ignored(why: str) -> None:
                typer.echo(why, err=True)
                events.note("ignored", why)

            door = stack.enter_context(OscServer(client, osc_host, osc, ignored))
            typer.echo(f"OSC at UDP port {door.port}")
        group, clock, links = reach_modules(loaded, modules, GuidedHand(follow))
        stack.callback(group.close)
        stack.enter_context(temporary_slew(group, QUICK if played_one is None else played_one.slew))
        inner.renderer.limits = module_limits(loaded, group)
        demand = BridgedDemand(client, inner, events.take, events.note)
        tracker = follow if played_one is not None or needs_tracker(loaded) else None
        runner = Runner(loaded, group, solver, demand, settings, clock=clock, tracker=tracker)
        if log is not None:
            runner.log = begin_log(log, loaded, solver, settings, links)
        failed = _run(runner, seconds)
        events.note("ended", runner.statistics.ended)
    output.console().print(summary_table(runner))
    if failed or runner.statistics.unconfirmed or runner.statistics.emergency:
        raise typer.Exit(1)


def _loaded(rig: Path | None, scenario: str | None) -> tuple[Rig, Scenario | None]:
    """Read the rig, and the scenario if one is to be played."""
    from tensionlab.model.files import load_rig
    from tensionlab.scenarios import load_scenario

    if scenario is not None:
        played_one = load_scenario(scenario, rig)
        return played_one.rig, played_one
    if rig is None:
        raise typer.BadParameter("give a rig file, or --scenario NAME, which has a rig of its own")
    return load_rig(rig), None


def _token(file: Path | None) -> str | None:
    """Return what clients must know: from a file or, without one, from the environment."""
    if file is None:
        return os.environ.get(TOKEN) or None
    try:
        token = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise typer.BadParameter(f"--token-file {file} cannot be read: {error}") from None
    if not token:
        raise typer.BadParameter(f"--token-file {file} is empty; put into it what clients must know")
    return token


def _settings(played_one: Scenario | None, rate: float | None) -> RunSettings:
    from tensionlab.hardware import RunSettings

    if played_one is None:
        return RunSettings() if rate is None else RunSettings(rate=rate)
    return RunSettings(rate=played_one.rate if rate is None else rate, nearest=played_one.nearest)


def _run(runner: Runner, seconds: float | None) -> bool:
    """Run until it ends; whether something went wrong, which is said."""
    from tensionlab.errors import TensionlabError

    try:
        runner.run(seconds)
    except TensionlabError as error:  # also an effect of a scenario's own that fails
        typer.echo(f"tensionlab: {error}", err=True)
        return True
    return False
