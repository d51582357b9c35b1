"""Modules that a verb reaches: by links, by a modules file, or simulated in this process."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import typer

from tensionlab.cli.common.output import if_interrupted, print_error
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.modules_file import load_modules
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.runner.records import RunSink
from tensionlab.hardware.runner.settings import Clock, RealClock, RunSettings, WorldClock
from tensionlab.hardware.simulation.world import Motion, World
from tensionlab.model.rig import Rig
from tensionlab.support.operating_system import INTERRUPT_SIGNALS
from tensionlab.support.provenance import manifest

Answer = TypeVar("Answer")


def call_all(
    links: Mapping[str, str], job: Callable[[ModuleClient], Answer]
) -> tuple[dict[str, Answer], dict[str, HardwareError]]:
    """Carry out a job on all modules, each in a thread; return answers and errors by the modules' names."""

    def call(name: str) -> Answer | HardwareError:
        try:
            with ModuleClient(name, links[name]) as client:
                return job(client)
        except HardwareError as error:
            return error

    unknown = "which modules did it is not known; `tensionlab module info` shows how they are"
    with if_interrupted(unknown), ThreadPoolExecutor(len(links)) as threads:
        found = dict(zip(links, threads.map(call, links), strict=True))
    failed = {name: each for name, each in found.items() if isinstance(each, HardwareError)}
    return {name: each for name, each in found.items() if not isinstance(each, HardwareError)}, failed


def json_rows(
    urls: Mapping[str, str], failed: Mapping[str, HardwareError], row: Callable[[str], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return what JSON says of each module: its name, its URL, a row of its own, and its error, or None."""
    return [
        {"module": name, "url": url, **row(name), "error": str(failed[name]) if name in failed else None}
        for name, url in urls.items()
    ]


def exit_if_failed(failed: Mapping[str, HardwareError]) -> None:
    """Print each error on a line, and leave with exit status 1 if there is one."""
    for name, error in failed.items():
        text = str(error)
        print_error(text if name in text else f"module {name!r}: {text}")
    if failed:
        raise typer.Exit(1)


@contextmanager
def until_interrupted(kept: str) -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C and its like end the work in good order; yield whether one has come.

    At the end, a Ctrl-C is raised, with what is kept.
    """
    came: list[int] = []
    before = [signal.signal(number, lambda number, _: came.append(number)) for number in INTERRUPT_SIGNALS]
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in zip(INTERRUPT_SIGNALS, before, strict=True):
            signal.signal(number, handler)
    if signal.SIGINT in came:
        raise KeyboardInterrupt(kept)


def kept_of_run(log: Path | None) -> str:
    """Return what is kept of a run that Ctrl-C ended, and how to go on."""
    if log is None:
        return "all modules are stopped; --log FILE.mcap keeps what a run does"
    return f"all modules are stopped; {log} has the run until then; the next takes another --log"


class Reached(NamedTuple):
    """All modules of a rig, open: their clients, the clock that they go by, and where each was reached."""

    group: ModuleGroup
    clock: Clock
    links: dict[str, str]


def reach_modules(rig: Rig, modules: str | None, motion: Motion | None) -> Reached:
    """Reach all modules of a rig, from the value of ``--modules``, or simulate them in this process.

    The motion is that of the platform which simulated modules hold; None for the rig's home.
    """
    print_required(rig)
    if modules is None:
        print_simulated()
        world = World(rig, motion)
        links = dict.fromkeys((module.name for module in rig.modules), "sim:")
        return Reached(world.group(), WorldClock(world, paced=True), links)
    links = module_links(rig, modules)
    group = connect(rig, links)
    return Reached(group, RealClock(group.clients), links)


def show_run() -> None:
    """Open a page in the browser that shows the run which this process is about to begin."""
    from tensionlab.viewer.live import open_page

    typer.echo(f"{open_page()} shows the run", err=True)


def print_required(rig: Rig) -> None:
    """Print what the cables hold beside what is desired, if the rig requires something."""
    if rig.required.middle(rig).any():
        constant = replace(rig.required, box=None, wrenches=None, ball=0.0)
        typer.echo(f"the cables also hold what {rig.name} requires: {constant.describe(rig)}", err=True)


def print_simulated() -> None:
    """Print that the modules are simulated, so that nobody waits for real ones to pull."""
    typer.echo("No --modules given: simulating them in this process.", err=True)


def module_links(rig: Rig, modules: str) -> dict[str, str]:
    """Return the URL of each module of a rig, from the value of ``--modules``."""
    if modules.endswith(".toml"):
        return load_modules(modules)
    urls = [url.strip() for url in modules.split(",") if url.strip()]
    if len(urls) != rig.m:
        names = ", ".join(module.name for module in rig.modules)
        raise typer.BadParameter(
            f"--modules has {len(urls)} links, {rig.name} has {rig.m} modules ({names}); give a link for each, "
            "or a file that ends in .toml"
        )
    return {module.name: url for module, url in zip(rig.modules, urls, strict=True)}


def tell_streams(sinks: Iterable[RunSink]) -> None:
    """Say so if streams for Lab Streaming Layer ended before their run did."""
    for sink in sinks:
        if (error := getattr(sink, "error", None)) is not None:
            print_error(f"the streams for Lab Streaming Layer ended before the run: {error}")


def lsl_streams(rig: Rig, solver: str, rate: float, *, wanted: bool) -> list[RunSink]:
    """Return the sink that streams a run to Lab Streaming Layer, if ``wanted``."""
    if not wanted:
        return []
    from tensionlab.interop.lsl import LslStreams

    return [LslStreams(rig, solver, rate)]


def begin_sinks(
    path: Path | None,
    rig: Rig,
    solver: str,
    settings: RunSettings,
    links: dict[str, str],
    lsl: bool,
    scenery: Mapping[str, Any] | None = None,
) -> list[RunSink]:
    """Begin the log of a run and its streams for Lab Streaming Layer, as far as they are wanted."""
    streams = lsl_streams(rig, solver, settings.rate, wanted=lsl)
    if path is None:
        return streams
    return [RunLog(path, rig, manifest(["tensionlab", *sys.argv[1:]]), solver, settings, links, scenery), *streams]
