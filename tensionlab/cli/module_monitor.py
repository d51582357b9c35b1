"""``tensionlab module monitor`` and ``module ping``: telemetry of modules, and the latency of their links."""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, nullcontext
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.modules import call_all, exit_if_failed, find_links, until_interrupted
from tensionlab.cli.common.options import Json, Links, ModulesFile
from tensionlab.errors import HardwareError, LinkError, ModuleFault
from tensionlab.hardware.client.latency import RoundTrips, is_bluetooth, measure, safe_rates
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import DESCRIPTIONS, Fault, Limit
from tensionlab.hardware.runner.settings import RealClock

if TYPE_CHECKING:
    from rich.console import RenderableType


TELEMETRY_PERIOD_MS = 50
REFRESH_PERIOD_S = 0.2
"""Of the table."""
TELEMETRY = ("<module", "<state", "tension\nN", "current\nA", "length\nm", "speed\nm/s", "<limit", "<faults",
             "heat\n%", "supply\nV", "age\nms", "bad/\nlost")  # fmt: skip
"""Columns of `monitor`."""
TRIPS = ("<module", "pings", "lost", "p50\nms", "p95\nms", "p99\nms", "max\nms", "TTL\nms", "safe rate\nHz",
         "clock\ns")  # fmt: skip
"""Columns of `ping`."""
PERCENTILES = (50.0, 95.0, 99.0, 100.0)


def monitor(
    links: Links = None,
    modules: ModulesFile = None,
    seconds: Annotated[float, typer.Option(help="How long; until Ctrl-C if left out.", min=0.1)] = math.inf,
    json: Json = False,
) -> None:
    """Show the telemetry of modules in a live table.

    Nothing is changed, nothing pulls. In a file or a pipe only the last table is printed. Exit status 1 where a
    link broke or could not be opened.
    """
    from rich.live import Live

    urls = find_links(links, modules)
    with ExitStack() as stack:
        clients, failed = _connect(urls, stack)
        clock = RealClock(clients.values())
        end = clock.now() + seconds
        shown = sys.stdout.isatty() and not json
        live = Live(_telemetry_table(clients, failed), console=output.console(), auto_refresh=False)
        with until_interrupted() as interrupted, live if shown else nullcontext():
            while clients.keys() - failed.keys() and not interrupted() and clock.now() < end:
                clock.wait_until(clock.now() + REFRESH_PERIOD_S)
                for name, client in clients.items():
                    _check(name, client, failed)
                live.update(_telemetry_table(clients, failed), refresh=shown)
        if json:
            output.print_json([_telemetry_json(name, client) for name, client in clients.items()])
        elif not shown:
            output.console().print(_telemetry_table(clients, failed))
    exit_if_failed(failed)


def _connect(links: dict[str, str], stack: ExitStack) -> tuple[dict[str, ModuleClient], dict[str, HardwareError]]:
    """Open all modules and have them report; they are closed with the stack."""
    failed: dict[str, HardwareError] = {}

    def connect(name: str) -> ModuleClient | None:
        client = None
        try:
            client = ModuleClient(name, links[name])
            client.telemetry_every(TELEMETRY_PERIOD_MS)
        except HardwareError as error:
            failed[name] = error
        return client

    with ThreadPoolExecutor(len(links)) as threads:
        reached = dict(zip(links, threads.map(connect, links), strict=True))
    clients = {name: client for name, client in reached.items() if client is not None}
    for client in clients.values():
        stack.callback(client.close)
    return clients, failed


def _check(name: str, client: ModuleClient, failed: dict[str, HardwareError]) -> None:
    """Take note of a link that broke; whether the module has released its cable is in the table."""
    try:
        client.check()
    except LinkError as error:
        failed[name] = error
    except ModuleFault:
        pass


def _telemetry_table(clients: dict[str, ModuleClient], failed: dict[str, HardwareError]) -> RenderableType:
    """Return the table, and below it what the limits and faults in it mean."""
    from rich.console import Group
    from rich.text import Text

    grid = output.table(TELEMETRY, gap=1)
    faults = Fault(0)
    limits: set[Limit] = set()
    for name, client in clients.items():
        last = client.telemetry
        if name in failed:
            grid.add_row(name, "lost")
        elif last is None:
            grid.add_row(name, "silent")
        else:
            message = last.message
            limits.add(message.limit)
            faults |= message.faults
            grid.add_row(
                name,
                message.state.name.lower(),
                f"{message.tension:.2f}",
                f"{message.current:.2f}",
                f"{message.length:.3f}",
                f"{message.speed:+.2f}",
                "" if message.limit is Limit.NONE else message.limit.name.lower(),
                ", ".join(fault.name.lower() for fault in message.faults if fault.name),
                f"{100 * message.thermal:.0f}",
                f"{message.supply:.1f}",
                f"{1e3 * (client.link.clock() - last.time):.0f}",
                f"{client.bad_frames + message.bad_frames}/{message.lost_frames}",
            )
    lines = [f"{limit.name.lower()}: {DESCRIPTIONS[Limit][limit.name]}" for limit in sorted(limits - {Limit.NONE})]
    lines += [f"{fault.name.lower()}: {DESCRIPTIONS[Fault][fault.name]}" for fault in faults if fault.name]
    return Group(grid, Text("\n".join(lines).replace("`", ""), style="dim"))


def _telemetry_json(name: str, client: ModuleClient) -> dict[str, Any]:
    """Return the last telemetry as JSON has it: codes by their names."""
    last = client.telemetry
    telemetry: dict[str, Any] | None = None
    if last is not None:
        message = last.message
        telemetry = asdict(message) | {
            "state": message.state.name,
            "faults": [fault.name for fault in message.faults],
            "limit": message.limit.name,
            "brake": message.brake.name,
        }
    return {
        "module": name,
        "url": client.link.url,
        "age": None if last is None else client.link.clock() - last.time,
        "bad_frames_here": client.bad_frames,
        "telemetry": telemetry,
    }


def ping(
    links: Links = None,
    modules: ModulesFile = None,
    count: Annotated[int, typer.Option(help="Pings to each module.", min=1)] = 200,
    json: Json = False,
) -> None:
    """Measure the latency of links to modules.

    Shows how long messages take to modules and back, and which cycle rates are safe with that. A set-point must
    outlive the wait for the next. At the lowest safe rate, three set-points are sent within the module's time to
    live (TTL), less the 99th percentile of the time to the module (half of the trip); more, where so many pings
    are lost that all three could be. The highest is 100 Hz over Bluetooth and 1000 Hz over anything else. All
    modules are measured at the same time. Ctrl-C ends it early. Exit status 1 where a module does not answer, or
    no rate is safe.

    The clock is how much the module's is ahead of this computer's, as exact as half the shortest trip; it wraps
    around after 71 minutes.
    """
    urls = find_links(links, modules)
    done = dict.fromkeys(urls, 0)
    ttls: dict[str, float] = {}

    with until_interrupted() as interrupted, output.progress("pinging") as progress:

        def job(client: ModuleClient) -> RoundTrips:
            ttls[client.name] = 1e-3 * client.hello().ttl_ms

            def go_on(now: int) -> bool:
                done[client.name] = now
                progress(min(done.values()) / count)
                return not interrupted()

            return measure(client, count, go_on)

        trips, failed = call_all(urls, job)
    rates = {
        name: safe_rates(each, ttls[name], bluetooth=is_bluetooth(urls[name])) for name, each in trips.items()
    }
    if json:
        output.print_json([_trips_json(name, urls[name], trips[name], rates[name], ttls[name]) for name in trips])
    elif trips:
        rows = []
        for name, each in trips.items():
            times = [output.short(1e3 * each.percentile(share)) for share in PERCENTILES]
            rate = "none" if (safe := rates[name]) is None else f"{safe[0]:.0f} to {safe[1]:.0f}"
            clock = f"{each.offset:.4f} ± {each.offset_error:.4f}" if each.times else "–"
            pings = len(each.times) + each.lost
            rows.append((name, pings, each.lost, *times, f"{1e3 * ttls[name]:.0f}", rate, clock))
        output.print_table("", TRIPS, rows, gap=1)
    for name, safe in rates.items():
        if safe is None:
            output.print_error(
                f"{name}: no rate is safe over this link; make it better, or raise the module's "
                f"parameter ttl (`tensionlab module config set {urls[name]} ttl=...`)"
            )
    exit_if_failed(failed)
    if None in rates.values():
        raise typer.Exit(1)


def _trips_json(name: str, url: str, trips: RoundTrips, rate: tuple[float, float] | None, ttl: float) -> Any:
    names = ("p50", "p95", "p99", "max")
    return {
        "module": name,
        "url": url,
        "pings": len(trips.times) + trips.lost,
        "lost": trips.lost,
        "seconds": {each: trips.percentile(share) for each, share in zip(names, PERCENTILES, strict=True)},
        "ttl": ttl,
        "safe_rate": rate,
        "clock_offset": trips.offset,
        "clock_offset_error": trips.offset_error,
    }
