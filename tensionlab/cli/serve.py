"""``tensionlab serve``: a door to a rig for game engines."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli import output
from tensionlab.cli.rig_modules import Modules, Solver, check_solver, log_of, reach_modules

if TYPE_CHECKING:
    from tensionlab.hardware import Runner


def serve(
    rig: Annotated[Path, typer.Argument(help="Rig file (TOML).", show_default=False)],
    modules: Modules = None,
    solver: Solver = "newton",
    rate: Annotated[float, typer.Option(help="Cycles a second.")] = 50.0,
    seconds: Annotated[float | None, typer.Option(help="How long; until Ctrl-C if left out.")] = None,
    host: Annotated[
        str, typer.Option(help="Where to listen; beyond this machine with --token only.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Of the WebSocket; 0 takes a free one.", min=0, max=65535)] = 8765,
    osc: Annotated[
        int | None, typer.Option(metavar="PORT", help="Listen for OSC there as well.", min=0, max=65535)
    ] = None,
    token: Annotated[str | None, typer.Option(help="What clients must know.")] = None,
    page: Annotated[
        list[str] | None, typer.Option(metavar="ORIGIN", help="A web page that may connect; also repeated.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", callback=output.output_file, help="Keep every cycle there.")
    ] = None,
) -> None:
    """Let a program drive a rig over a WebSocket: poses and effects in, the state out. BRIDGE.md has the messages.

    Without --modules, the simulated hand is where the client says it is. Ctrl-C ends it, and all modules stop.
    """
    from tensionlab.cli.run_table import summary_table
    from tensionlab.haptics.bridge.mailbox import Mailbox
    from tensionlab.haptics.bridge.messages import Welcome
    from tensionlab.haptics.bridge.news import News
    from tensionlab.haptics.bridge.osc import OscDoor
    from tensionlab.haptics.bridge.server import Bridge
    from tensionlab.haptics.bridge.source import FADE, PATIENCE, BridgedDemand, tracked_pose
    from tensionlab.hardware import Runner, RunSettings
    from tensionlab.hardware.codes import Limit
    from tensionlab.hardware.simulation.guided_hand import GuidedHand
    from tensionlab.model.files import load_rig

    loaded = load_rig(rig)
    check_solver(loaded, solver, None)
    settings, mailbox = RunSettings(rate=rate), Mailbox()
    follow = tracked_pose(loaded, mailbox)
    welcome = Welcome(
        rig=loaded.name,
        modules=[module.name for module in loaded.modules],
        rate=rate,
        timeout=PATIENCE + FADE,
    )
    limits = {int(each): each.name for each in Limit}
    news = News(loaded, limits)
    bridge = Bridge(mailbox, welcome, news.state, host, port, token, tuple(page or ()))
    news.tell = bridge.tell
    with ExitStack() as stack:
        stack.enter_context(bridge)
        typer.echo(f"{bridge.url}/command takes frames, {bridge.url}/events tells what happens")
        if osc is not None:
            door = stack.enter_context(OscDoor(mailbox, host, osc, lambda why: typer.echo(why, err=True)))
            typer.echo(f"OSC at UDP port {door.port}")
        group, clock, links = reach_modules(loaded, modules, GuidedHand(follow))
        stack.callback(group.close)
        demand = BridgedDemand(loaded, mailbox, news.take)
        tracker = follow if loaded.frames or loaded.m < loaded.n else None
        runner = Runner(loaded, group, solver, demand, settings, clock=clock, tracker=tracker)
        if log is not None:
            runner.log = log_of(log, loaded, solver, settings, links)
        failed = _run(runner, seconds)
    output.console().print(summary_table(runner))
    if failed or runner.statistics.unconfirmed or runner.statistics.emergency:
        raise typer.Exit(1)


def _run(runner: Runner, seconds: float | None) -> bool:
    """Run until it ends; whether something went wrong, which is said."""
    from tensionlab.errors import HardwareError

    try:
        runner.run(seconds)
    except HardwareError as error:
        typer.echo(f"tensionlab: {error}", err=True)
        return True
    return False
