"""``tensionlab module monitor`` and ``module ping``: telemetry of modules, and the latency of their links."""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, nullcontext
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.links import Links, ModulesFile, call_all, exit_if_failed, find_links
from tensionlab.cli.common.verbs import Json, option
from tensionlab.errors import HardwareError, LinkError, ModuleFault
from tensionlab.hardware.client.diagnostics import is_bluetooth, measure, percentile, safe_rates
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.locks import Holder, holder, locked_links
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Fault, Limit
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Telemetry
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.hardware.sharing import RunWatcher
from tensionlab.support.formatting import format_number
from tensionlab.support.table import Column, Table

TELEMETRY_PERIOD_MS = 50
REFRESH_PERIOD_S = 0.2  # period of the live table
SILENCE_S = 1.0  # age of a run's latest cycle from which on its process is looked for
# Columns of `monitor`.
TELEMETRY = ("module", "state", Column("tension", "N", ".2f"), Column("current", "A", ".2f"),
             Column("length", "m", ".3f"), Column("speed", "m/s", "+.2f"), "limit", "faults",
             Column("winding", "°C", ".0f"), Column("supply", "V", ".1f"), Column("age", "ms", ".0f"),
             "damaged", "lost")  # fmt: skip
# Columns of `ping`.
PERCENTILES = {"p50": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}
TRIPS = ("module", "pings", "lost", *(Column(name, "ms", format_number) for name in PERCENTILES),
         Column("TTL", "ms", ".0f"), Column("safe rate", "Hz"))  # fmt: skip


class Report(NamedTuple):
    """Latest telemetry of a module, if any, its age in s, and the number of damaged frames."""

    telemetry: Telemetry | None = None
    age: float = math.inf
    bad_frames: int = 0


class WatchedModule:
    """Module that another process has, as its run publishes it; `monitor` uses it like a client."""

    def __init__(self, url: str, process: Holder, run: RunWatcher) -> None:
        self.url, self.name, self.process, self._run = url, url, process, run

    def check(self) -> None:
        """Raise a `LinkError` where the process has ended, or released the module."""
        if self._run.age > SILENCE_S and holder(self.url) != self.process:
            raise LinkError(f"{self.process} has ended or released it; start the monitor again to reach it")

    def report(self) -> Report:
        """Return what the run tells of the module, if it has one."""
        info, report = self._run.info, self._run.report
        if info is None or report is None or self.url not in (urls := [*info.links.values()]):
            return Report()
        index = urls.index(self.url)
        self.name = [*info.links][index]
        age = 0.0 if report.cycle is None else float(report.cycle["ages"][index])
        return Report(report.telemetry[index], age + self._run.age, int(report.bad_frames[index]))


def _report(module: ModuleClient | WatchedModule) -> Report:
    if isinstance(module, WatchedModule):
        return module.report()
    if (latest := module.telemetry) is None:
        return Report(bad_frames=module.bad_frames)
    return Report(latest.message, module.link.clock() - latest.time, module.bad_frames)


Monitored = dict[str, ModuleClient | WatchedModule]


def monitor(
    links: Links = None,
    modules: ModulesFile = None,
    seconds: Annotated[float, option("S", "How long; until Ctrl-C if left out.", min=0.1)] = math.inf,
    json: Json = False,
) -> None:
    """Show the telemetry of modules in a live table, also of those in a run.

    Nothing is changed, nothing pulls. Modules in a run of another process are shown as that one receives them,
    which does not slow it down; those that it uses otherwise, such as to calibrate them, are silent. Without links
    and file: all modules that your processes use on this computer. In a file or a pipe only the last table is
    printed. Exit status 1 where a link broke or could not be opened, or the other process has ended.
    """
    from rich.live import Live

    urls = {url: url for url in locked_links()} if not links and modules is None else find_links(links, modules)
    if not urls:
        output.print_error("None of your tensionlab processes holds a module; name the modules to watch.")
        raise typer.Exit(1)
    with ExitStack() as stack:
        reached, failed = _connect(urls)
        clients = [client for client in reached.values() if isinstance(client, ModuleClient)]
        holders = {process for process in reached.values() if isinstance(process, Holder)}
        runs = {process: RunWatcher(process.port or 0, process.token) for process in holders}
        watched: Monitored = {
            name: WatchedModule(urls[name], source, runs[source]) if isinstance(source, Holder) else source
            for name, source in reached.items()
        }
        for close in (*(client.close for client in clients), *(run.close for run in runs.values())):
            stack.callback(close)
        clock = RealClock(clients)
        end = clock.now() + seconds
        shown = sys.stdout.isatty() and not json
        live = Live(output.styled(_telemetry_table(watched, failed)), console=output.console(), auto_refresh=False)
        kept = "nothing was changed; the same command watches again"
        interrupted = stack.enter_context(output.until_interrupted(kept))
        with live if shown else nullcontext():
            while watched.keys() - failed.keys() and not interrupted() and clock.now() < end:
                clock.wait_until(clock.now() + REFRESH_PERIOD_S)
                for run in runs.values():
                    run.poll()
                for name, module in watched.items():
                    try:
                        module.check()
                    except LinkError as error:
                        failed[name] = error
                    except ModuleFault:
                        pass  # the table has it
                live.update(output.styled(_telemetry_table(watched, failed)), refresh=shown)
        if json:
            output.print_json([_telemetry_json(urls[name], module) for name, module in watched.items()])
        elif not shown:
            output.print_table(_telemetry_table(watched, failed))
        exit_if_failed(failed)


def _connect(links: dict[str, str]) -> tuple[dict[str, ModuleClient | Holder], dict[str, HardwareError]]:
    """Open the modules that no other process has; return them, or the process that has one, and the errors."""
    failed: dict[str, HardwareError] = {}

    def connect(name: str) -> ModuleClient | Holder | None:
        client, url = None, links[name]
        try:
            user = None if url in OPENERS else holder(url)
            if user is not None and user.port is not None:
                return user
            client = ModuleClient(name, url)
            client.command(ConfigureTelemetry(TELEMETRY_PERIOD_MS))
        except HardwareError as error:
            failed[name] = error
        return client

    with ThreadPoolExecutor(len(links)) as threads:
        reached = dict(zip(links, threads.map(connect, links), strict=True))
    return {name: source for name, source in reached.items() if source is not None}, failed


def _telemetry_table(found: Monitored, failed: dict[str, HardwareError]) -> Table:
    """Return the table, with notes on what its limits and faults mean, and on who has the modules."""
    rows: list[list[Any]] = []
    faults = Fault(0)
    limits: set[Limit] = set()
    users: dict[str, list[str]] = {}
    for name, module in found.items():
        report = _report(module)
        message = report.telemetry
        if isinstance(module, WatchedModule):
            users.setdefault(str(module.process), []).append(module.name)
        if name in failed or message is None:
            rows.append([module.name, "lost" if name in failed else "silent", *[None] * (len(TELEMETRY) - 2)])
            continue
        limits.add(message.limit)
        faults |= message.faults
        limit = "–" if message.limit is Limit.NONE else message.limit.name.lower()
        named = ", ".join(fault.name.lower() for fault in message.faults if fault.name)
        damaged = report.bad_frames + message.bad_frames
        rows.append(
            [module.name, message.state.name.lower(), message.tension, message.current, message.length,
             message.speed, limit, named or "–", message.winding, message.supply, 1e3 * report.age,
             damaged, message.lost_frames]
        )  # fmt: skip
    notes = [f"{limit.name.lower()}: {limit.meaning}" for limit in sorted(limits - {Limit.NONE})]
    notes += [f"{fault.name.lower()}: {fault.meaning}" for fault in faults if fault.name]
    notes += [f"as {user} receives them: {', '.join(names)}" for user, names in users.items()]
    return Table(TELEMETRY, rows, notes=[note.replace("`", "") for note in notes])


def _telemetry_json(url: str, each: ModuleClient | WatchedModule) -> dict[str, Any]:
    report = _report(each)
    return {
        "module": each.name,
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
            times = measure(client, count, report)
            rates = safe_rates(times, ttl, bluetooth=is_bluetooth(urls[client.name]))
            seconds = {name: percentile(times, share) for name, share in PERCENTILES.items()}
            lost = int(np.isnan(times).sum())
            return {"pings": len(times), "lost": lost, "seconds": seconds, "ttl": ttl, "safe_rate": rates}

        with output.progress("pinging") as progress:
            answers, failed = call_all(urls, job)
        if json:
            output.print_json([{"module": name, "url": urls[name], **answer} for name, answer in answers.items()])
        elif answers:
            rows = [
                (name, answer["pings"], answer["lost"], *(1e3 * trip for trip in answer["seconds"].values()),
                 1e3 * answer["ttl"],
                 "{:.0f} to {:.0f}".format(*answer["safe_rate"]) if answer["safe_rate"] else "none")
                for name, answer in answers.items()
            ]  # fmt: skip
            output.print_table(Table(TRIPS, rows))
        unsafe = [name for name, answer in answers.items() if answer["safe_rate"] is None]
        for name in unsafe:
            output.print_error(
                f"{name}: no rate is safe over this link; make it better, or raise the module's "
                f"parameter ttl (`tensionlab module config set {urls[name]} ttl=...`)"
            )
        exit_if_failed(failed)
        if unsafe:
            raise typer.Exit(1)
