"""``tensionlab module monitor``: a live table of what modules say."""

from __future__ import annotations

import math
import sys
import time
from contextlib import ExitStack, nullcontext
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.module_targets import Json, ModulesFile, Words, complain, targets, until_interrupted

if TYPE_CHECKING:
    from rich.console import RenderableType

    from tensionlab.errors import HardwareError
    from tensionlab.hardware.client.module import ModuleClient

PERIOD = 0.05
"""Of the telemetry, in s."""
REFRESH = 0.2
"""Of the table, in s."""


def monitor(
    words: Words = None,
    modules: ModulesFile = None,
    seconds: Annotated[float, typer.Option(help="How long; until Ctrl-C if left out.", min=0.1)] = math.inf,
    json: Json = False,
) -> None:
    """Show how modules are, in a table that is kept up to date. Nothing is changed, nothing pulls.

    In a file or a pipe only the last table is printed. Exit status 1 where a link broke, or none came about.
    """
    from rich.live import Live

    links = targets(words, modules)
    with ExitStack() as stack:
        clients, failed = _reach(links, stack)
        end = time.monotonic() + seconds
        shown = sys.stdout.isatty() and not json
        live = Live(_picture(clients, failed), console=output.console(), auto_refresh=False)
        with until_interrupted() as interrupted, live if shown else nullcontext():
            while clients.keys() - failed.keys() and not interrupted() and time.monotonic() < end:
                time.sleep(REFRESH)
                for name, client in clients.items():
                    client.listen(REFRESH)
                    _check(name, client, failed)
                live.update(_picture(clients, failed), refresh=shown)
        if json:
            output.print_json([_plain(name, client) for name, client in clients.items()])
        elif not shown:
            output.console().print(_picture(clients, failed))
    complain(failed)


def _reach(links: dict[str, str], stack: ExitStack) -> tuple[dict[str, ModuleClient], dict[str, HardwareError]]:
    """Open all and have them report; they are closed with the stack."""
    from concurrent.futures import ThreadPoolExecutor

    from tensionlab.errors import HardwareError
    from tensionlab.hardware.client.module import ModuleClient

    failed: dict[str, HardwareError] = {}

    def reach(name: str) -> ModuleClient | None:
        client = None
        try:
            client = ModuleClient(name, links[name])
            client.telemetry_every(round(1e3 * PERIOD))
        except HardwareError as error:
            failed[name] = error
        return client

    with ThreadPoolExecutor(len(links)) as threads:
        reached = dict(zip(links, threads.map(reach, links), strict=True))
    clients = {name: client for name, client in reached.items() if client is not None}
    for client in clients.values():
        stack.callback(client.close)
    return clients, failed


def _check(name: str, client: ModuleClient, failed: dict[str, HardwareError]) -> None:
    """Take note of a link that broke; whether the module has let go is in the table."""
    from tensionlab.errors import LinkError, ModuleFault

    try:
        client.check()
    except LinkError as error:
        failed[name] = error
    except ModuleFault:
        pass


def _picture(clients: dict[str, ModuleClient], failed: dict[str, HardwareError]) -> RenderableType:
    """The table, and below it what the limits and faults in it mean."""
    from rich.console import Group
    from rich.text import Text

    from tensionlab.hardware.protocol.codes import DESCRIPTIONS, Fault, Limit

    grid = output.table(gap=1)
    grid.add_column("module", overflow="fold")
    grid.add_column("state")
    for heading in ("pull\nN", "current\nA", "length\nm", "speed\nm/s"):
        grid.add_column(heading, justify="right", no_wrap=True)
    grid.add_column("limit")
    grid.add_column("faults")
    for heading in ("heat\n%", "supply\nV", "age\nms", "bad/\nlost"):
        grid.add_column(heading, justify="right", no_wrap=True)
    faults = Fault(0)
    shown: set[Limit] = set()
    for name, client in clients.items():
        heard = client.telemetry
        if name in failed:
            grid.add_row(name, "lost")
        elif heard is None:
            grid.add_row(name, "silent")
        else:
            said = heard.message
            shown.add(said.limit)
            faults |= said.faults
            grid.add_row(
                name,
                said.state.name.lower(),
                f"{said.tension:.2f}",
                f"{said.current:.2f}",
                f"{said.length:.3f}",
                f"{said.speed:+.2f}",
                "" if said.limit is Limit.NONE else said.limit.name.lower(),
                ", ".join(fault.name.lower() for fault in said.faults if fault.name),
                f"{100 * said.thermal:.0f}",
                f"{said.supply:.1f}",
                f"{1e3 * (client.link.clock() - heard.time):.0f}",
                f"{client.bad_frames + said.bad_frames}/{said.lost_frames}",
            )
    lines = [f"{limit.name.lower()}: {DESCRIPTIONS[Limit][limit.name]}" for limit in sorted(shown - {Limit.NONE})]
    lines += [f"{fault.name.lower()}: {DESCRIPTIONS[Fault][fault.name]}" for fault in faults if fault.name]
    return Group(grid, Text("\n".join(lines).replace("`", ""), style="dim"))


def _plain(name: str, client: ModuleClient) -> dict[str, Any]:
    """As JSON: what the module said last, codes by their names."""
    from dataclasses import asdict

    heard = client.telemetry
    said: dict[str, Any] = {}
    if heard is not None:
        message = heard.message
        said = asdict(message) | {
            "state": message.state.name,
            "faults": [fault.name for fault in message.faults],
            "limit": message.limit.name,
            "brake": message.brake.name,
        }
    age = None if heard is None else client.link.clock() - heard.time
    return {
        "module": name,
        "url": client.link.url,
        "age": age,
        "bad_frames_here": client.bad_frames,
        "telemetry": said or None,
    }
