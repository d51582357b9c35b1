"""``tensionlab module monitor`` and ``module ping``: telemetry of modules, and the latency of their links."""

from __future__ import annotations

import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from typing import Annotated, Any

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.links import Links, ModulesFile, call_all, exit_if_failed, find_links
from tensionlab.cli.common.verbs import Json, option
from tensionlab.errors import HardwareError, LinkError, ModuleFault
from tensionlab.hardware.client.diagnostics import is_bluetooth, measure, safe_rates
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.locks import Holder, holder, locked_links
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.shared_telemetry import Report, Watcher
from tensionlab.hardware.protocol.codes import Fault, Limit
from tensionlab.hardware.protocol.messages import ConfigureTelemetry
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.support.formatting import format_number
from tensionlab.support.table import Column, Table

TELEMETRY_PERIOD_MS = 50
REFRESH_PERIOD_S = 0.2  # period of the live table
SILENCE_S = 1.0  # how long another process may send no report before it is looked for
# Columns of `monitor`.
TELEMETRY = ("module", "state", Column("tension", "N", ".2f"), Column("current", "A", ".2f"),
             Column("length", "m", ".3f"), Column("speed", "m/s", "+.2f"), "limit", "faults",
             Column("heat", "%", ".0f"), Column("supply", "V", ".1f"), Column("age", "ms", ".0f"),
             "damaged", "lost")  # fmt: skip
# Columns of `ping`.
PERCENTILES = {"p50": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}
TRIPS = ("module", "pings", "lost", *(Column(name, "ms", format_number) for name in PERCENTILES),
         Column("TTL", "ms", ".0f"), Column("safe rate", "Hz"))  # fmt: skip


class WatchedModule:
    """Module that another process has, as that one publishes it; `monitor` uses it like a client."""

    def __init__(self, url: str, process: Holder) -> None:
        self.url, self.name, self.process = url, url, process
        self._report = Report(url, url, None, math.inf, 0)
        self._came = time.perf_counter()

    def take(self, report: Report) -> None:
        """Take the latest report of the process on the module."""
        self.name, self._report, self._came = report.name, report, time.perf_counter()

    def check(self) -> None:
        """Raise a `LinkError` where the process has ended, or released the module."""
        if time.perf_counter() - self._came > SILENCE_S and holder(self.url) != self.process:
            raise LinkError(f"{self.process} has ended or released it; start the monitor again to reach it")

    def report(self) -> Report:
        """Return the latest report; its age is that of now."""
        return replace(self._report, age=self._report.age + time.perf_counter() - self._came)


Monitored = dict[str, ModuleClient | WatchedModule]


def monitor(
    links: Links = None,
    modules: ModulesFile = None,
    seconds: Annotated[float, option("S", "How long; until Ctrl-C if left out.", min=0.1)] = math.inf,
    json: Json = False,
) -> None:
    """Show the telemetry of modules in a live table, also of those in a run.

    Nothing is changed, nothing pulls. Modules that another process uses, such as ``tensionlab run``, are shown as
    that one receives them, which does not slow it down. Without links and file: all modules that your processes
    use on this computer. In a file or a pipe only the last table is printed. Exit status 1 where a link broke or
    could not be opened, or the other process has ended.
    """
    from rich.live import Live

    urls = {url: url for url in locked_links()} if not links and modules is None else find_links(links, modules)
    if not urls:
        output.print_error("None of your tensionlab processes holds a module; name the modules to watch.")
        raise typer.Exit(1)
    with ExitStack() as stack:
        found, failed = _connect(urls)
        clients = [each for each in found.values() if isinstance(each, ModuleClient)]
        watched = {each.url: each for each in found.values() if isinstance(each, WatchedModule)}
        processes = {each.process for each in watched.values()}
        watchers = [Watcher(process.port, process.token) for process in processes if process.port is not None]
        for close in (*(client.close for client in clients), *(watcher.close for watcher in watchers)):
            stack.callback(close)
        clock = RealClock(clients)
        end = clock.now() + seconds
        shown = sys.stdout.isatty() and not json
        live = Live(output.styled(_telemetry_table(found, failed)), console=output.console(), auto_refresh=False)
        kept = "nothing was changed; the same command watches again"
        interrupted = stack.enter_context(output.until_interrupted(kept))
        with live if shown else nullcontext():
            while found.keys() - failed.keys() and not interrupted() and clock.now() < end:
                for watcher in watchers:
                    watcher.ask()
                clock.wait_until(clock.now() + REFRESH_PERIOD_S)
                for report in (report for watcher in watchers for report in watcher.reports()):
                    if report.url in watched:
                        watched[report.url].take(report)
                for name, module in found.items():
                    try:
                        module.check()
                    except LinkError as error:
                        failed[name] = error
                    except ModuleFault:
                        pass  # the table has it
                live.update(output.styled(_telemetry_table(found, failed)), refresh=shown)
        if json:
            output.print_json([_telemetry_json(urls[name], module) for name, module in found.items()])
        elif not shown:
            output.print_table(_telemetry_table(found, failed))
        exit_if_failed(failed)


def _connect(links: dict[str, str]) -> tuple[Monitored, dict[str, HardwareError]]:
    """Open all modules that no other process has, and have them report; return them and all errors."""
    failed: dict[str, HardwareError] = {}

    def connect(name: str) -> ModuleClient | WatchedModule | None:
        client, url = None, links[name]
        try:
            user = None if url in OPENERS else holder(url)
            if user is not None and user.port is not None:
                return WatchedModule(url, user)
            client = ModuleClient(name, url)
            client.command(ConfigureTelemetry(TELEMETRY_PERIOD_MS))
        except HardwareError as error:
            failed[name] = error
        return client

    with ThreadPoolExecutor(len(links)) as threads:
        reached = dict(zip(links, threads.map(connect, links), strict=True))
    return {name: each for name, each in reached.items() if each is not None}, failed


def _telemetry_table(found: Monitored, failed: dict[str, HardwareError]) -> Table:
    """Return the table, with notes on what its limits and faults mean, and on who has the modules."""
    rows: list[list[Any]] = []
    faults = Fault(0)
    limits: set[Limit] = set()
    users: dict[str, list[str]] = {}
    for name, each in found.items():
        report = each.report()
        message = report.telemetry
        if isinstance(each, WatchedModule):
            users.setdefault(str(each.process), []).append(each.name)
        if name in failed or message is None:
            rows.append([report.name, "lost" if name in failed else "silent", *[None] * (len(TELEMETRY) - 2)])
            continue
        limits.add(message.limit)
        faults |= message.faults
        limit = "–" if message.limit is Limit.NONE else message.limit.name.lower()
        named = ", ".join(fault.name.lower() for fault in message.faults if fault.name)
        damaged = report.bad_frames + message.bad_frames
        rows.append(
            [report.name, message.state.name.lower(), message.tension, message.current, message.length,
             message.speed, limit, named or "–", 100.0 * message.thermal, message.supply, 1e3 * report.age,
             damaged, message.lost_frames]
        )  # fmt: skip
    notes = [f"{limit.name.lower()}: {limit.meaning}" for limit in sorted(limits - {Limit.NONE})]
    notes += [f"{fault.name.lower()}: {fault.meaning}" for fault in faults if fault.name]
    notes += [f"as {user} receives them: {', '.join(names)}" for user, names in users.items()]
    return Table(TELEMETRY, rows, notes=[note.replace("`", "") for note in notes])


def _telemetry_json(url: str, each: ModuleClient | WatchedModule) -> dict[str, Any]:
    report = each.report()
    return {
        "module": report.name,
        "url": url,
        "process": each.process.pid if isinstance(each, WatchedModule) else None,
        "age": None if report.telemetry is None else report.age,
        "bad_frames_here": report.bad_frames,
        "telemetry": report.telemetry,
    }


def ping(
    links: Links = None,
    modules: ModulesFile = None,
    count: Annotated[int, option("N", "Pings to each module.", min=1)] = 200,
    json: Json = False,
) -> None:
    """Measure the latency of links to modules.

    Shows how long messages take to modules and back, and which cycle rates are safe with that. A set-point must
    outlive the wait for the next. At the lowest safe rate, three set-points are sent within the module's time to
    live (TTL), less the 99th percentile of the time to the module (half of the trip); more, where pings are lost
    often enough that all three could be. The highest is 100 Hz over Bluetooth and 1000 Hz over anything else. All
    modules are measured at the same time. Ctrl-C ends it early. Exit status 1 where a module does not answer, or
    no rate is safe.
    """
    urls = find_links(links, modules)
    done = dict.fromkeys(urls, 0)
    with output.until_interrupted("nothing was changed; the same command measures again") as interrupted:

        def job(client: ModuleClient) -> dict[str, Any]:
            def report(now: int) -> bool:
                done[client.name] = now
                progress(min(done.values()) / count)
                return not interrupted()

            ttl = 1e-3 * client.hello().ttl_ms
            trips = measure(client, count, report)
            rates = safe_rates(trips, ttl, bluetooth=is_bluetooth(urls[client.name]))
            seconds = {name: trips.percentile(share) for name, share in PERCENTILES.items()}
            sent = len(trips.times) + trips.lost
            return {"pings": sent, "lost": trips.lost, "seconds": seconds, "ttl": ttl, "safe_rate": rates}

        with output.progress("pinging") as progress:
            found, failed = call_all(urls, job)
        if json:
            output.print_json([{"module": name, "url": urls[name], **each} for name, each in found.items()])
        elif found:
            rows = [
                (name, each["pings"], each["lost"], *(1e3 * trip for trip in each["seconds"].values()),
                 1e3 * each["ttl"],
                 "{:.0f} to {:.0f}".format(*each["safe_rate"]) if each["safe_rate"] else "none")
                for name, each in found.items()
            ]  # fmt: skip
            output.print_table(Table(TRIPS, rows))
        unsafe = [name for name, each in found.items() if each["safe_rate"] is None]
        for name in unsafe:
            output.print_error(
                f"{name}: no rate is safe over this link; make it better, or raise the module's "
                f"parameter ttl (`tensionlab module config set {urls[name]} ttl=...`)"
            )
        exit_if_failed(failed)
        if unsafe:
            raise typer.Exit(1)
