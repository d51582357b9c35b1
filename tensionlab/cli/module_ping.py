"""``tensionlab module ping``: how good the links are, and which rate is safe over them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.module_targets import (
    Json,
    ModulesFile,
    Words,
    complain,
    on_all,
    targets,
    until_interrupted,
)
from tensionlab.cli.ending import say

if TYPE_CHECKING:
    from tensionlab.hardware.client.latency import Trips
    from tensionlab.hardware.client.module import ModuleClient

PERCENTILES = (50.0, 95.0, 99.0, 100.0)


def ping(
    words: Words = None,
    modules: ModulesFile = None,
    count: Annotated[int, typer.Option(help="Pings to each module.", min=1)] = 200,
    json: Json = False,
) -> None:
    """Measure how long messages take to modules and back, all at the same time, and tell the safe rate.

    A set-point must outlive the wait for the next. The least safe rate has three set-points sent within the
    module's time to live, less the 99th percentile of the way there (half the trip); more, where so many pings are
    lost that all of them could be. The highest is 100 Hz over Bluetooth and 1000 Hz over anything else. Ctrl-C
    ends it early. Exit status 1 where a module does not answer, or no rate is safe.

    The clock is what the module's shows more than this computer's, as exact as half the shortest trip; it wraps
    around after 71 minutes.
    """
    from tensionlab.hardware.client.latency import is_bluetooth, measure, safe_rates

    links = targets(words, modules)
    done = dict.fromkeys(links, 0)
    ttls: dict[str, float] = {}

    with until_interrupted() as interrupted, output.progress("pinging") as show:

        def job(client: ModuleClient) -> Trips:
            ttls[client.name] = 1e-3 * client.hello().ttl_ms

            def told(now: int) -> bool:
                done[client.name] = now
                show(min(done.values()) / count)
                return not interrupted()

            return measure(client, count, told)

        trips, failed = on_all(links, job)
    rates = {
        name: safe_rates(each, ttls[name], bluetooth=is_bluetooth(links[name])) for name, each in trips.items()
    }
    if json:
        output.print_json([_plain(name, links[name], trips[name], rates[name], ttls[name]) for name in trips])
    elif trips:
        grid = output.table(gap=1)
        grid.add_column("module", overflow="fold")
        for heading in ("pings", "lost", "p50\nms", "p95\nms", "p99\nms", "max\nms", "TTL\nms"):
            grid.add_column(heading, justify="right", no_wrap=True)
        grid.add_column("safe rate\nHz", justify="right")
        grid.add_column("clock\ns", justify="right")
        for name, each in trips.items():
            rate = rates[name]
            grid.add_row(
                name,
                str(len(each.times) + each.lost),
                str(each.lost),
                *(output.short(1e3 * each.percentile(share)) for share in PERCENTILES),
                f"{1e3 * ttls[name]:.0f}",
                "none" if rate is None else f"{rate[0]:.0f} to {rate[1]:.0f}",
                f"{each.offset:.4f} ± {each.offset_error:.4f}" if each.times else "–",
            )
        output.console().print(grid)
    for name, rate in rates.items():
        if rate is None:
            say(
                f"{name}: no rate is safe over this link; make it better, or raise the module's "
                f"parameter ttl (`tensionlab module config set {links[name]} ttl=...`)"
            )
    complain(failed)
    if None in rates.values():
        raise typer.Exit(1)


def _plain(name: str, url: str, trips: Trips, rate: tuple[float, float] | None, ttl: float) -> dict[str, Any]:
    return {
        "module": name,
        "url": url,
        "pings": len(trips.times) + trips.lost,
        "lost": trips.lost,
        "seconds": {f"p{share:.0f}": trips.percentile(share) for share in PERCENTILES[:-1]}
        | {"max": trips.percentile(100.0)},
        "ttl": ttl,
        "safe_rate": rate,
        "clock_offset": trips.offset,
        "clock_offset_error": trips.offset_error,
    }
