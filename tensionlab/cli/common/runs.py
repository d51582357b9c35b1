"""Runs on the modules of a rig: where they reach them, what records them, and with which status they end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.links import links_of_rig
from tensionlab.errors import TensionlabError
from tensionlab.haptics.rendering.effect_fidelity import FidelityRecord, fidelity_table
from tensionlab.haptics.rendering.fidelity import Fidelity
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.client.locks import SIMULATED, LinkLock, lock_simulated
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.protocol.messages import Info
from tensionlab.hardware.runner.records import CTRL_C, MAX_TIMES, Cycle, RunEvent, RunSink, Statistics
from tensionlab.hardware.runner.settings import Clock, RealClock, RunSettings, WorldClock
from tensionlab.hardware.simulation.world import Motion, World
from tensionlab.model.rig import Rig

_found_by: list[LinkLock | None] = []  # held until this process ends


def reach_modules(
    rig: Rig, modules: str | None, motion: Motion | None
) -> tuple[ModuleGroup, Clock, dict[str, str]]:
    """Return all modules of a rig, from the value of ``--modules`` or simulated, their clock, and the URL of each.

    The motion is that of the platform which simulated modules hold; None for the rig's home.
    """
    print_required(rig)
    if modules is None:
        print_simulated()
        world = World(rig, motion)
        links = dict.fromkeys((module.name for module in rig.modules), SIMULATED)
        if not _found_by:
            _found_by.append(lock_simulated())
        return world.group(), WorldClock(world, paced=True), links
    links = links_of_rig(rig, modules)
    group = connect(rig, links)
    return group, RealClock(group.clients), links


def print_required(rig: Rig) -> None:
    """Print what the cables hold in addition to the desired wrench, if the rig requires something."""
    if rig.required.middle(rig).any():
        constant = replace(rig.required, box=None, wrenches=None, ball=0.0)
        output.print_message(f"the cables also hold what {rig.name} requires: {constant.describe(rig)}")


def print_simulated() -> None:
    """Print that no real module pulls."""
    output.print_message("No --modules given: simulating them in this process.")


def show_run() -> None:
    """Open a page in the browser that shows the run which this process is about to begin."""
    from tensionlab.viewer.live import open_page

    output.print_message(f"{open_page()} shows the run")


def lsl_streams(rig: Rig, solver: str, rate: float, *, wanted: bool) -> list[RunSink]:
    """Return the sink that streams a run to Lab Streaming Layer, if it is wanted."""
    if not wanted:
        return []
    from tensionlab.interop.lsl import LslStreams

    return [LslStreams(rig, solver, rate)]


def open_sinks(
    log: Path | None,
    rig: Rig,
    solver: str,
    settings: RunSettings,
    links: dict[str, str],
    lsl: bool,
    scenery: Mapping[str, Any] | None = None,
) -> list[RunSink]:
    """Open the log of a run and its streams for Lab Streaming Layer, as far as they are wanted."""
    streams = lsl_streams(rig, solver, settings.rate, wanted=lsl)
    if log is not None:
        streams.insert(0, RunLog(log, rig, output.manifest(), solver, settings, links, scenery))
    return streams


class FidelitySink:
    """Sink that reports the fidelity of the latest `MAX_TIMES` cycles of a run, and how it is scheduled."""

    def __init__(self, rig: Rig) -> None:
        self._record, self._required = FidelityRecord(rig, MAX_TIMES), rig.required.middle(rig)
        self.fidelity = self._record.fidelity

    def write(self, cycle: Cycle) -> None:
        """Take a cycle."""
        demand = cycle.demand
        if demand.wrench is not None:
            desired = None if demand.desired is None else demand.desired - self._required
            demand = replace(demand, wrench=demand.wrench - self._required, desired=desired)
        infeasible = cycle.solver_wrench - cycle.allocation.wrench if cycle.allocation.infeasible else 0.0
        self._record.add(cycle.state, demand, infeasible)

    def begin(self, infos: Mapping[str, Info], statistics: Statistics) -> None:
        """Take nothing."""

    def note(self, event: RunEvent) -> None:
        """Print what the system granted of real-time scheduling."""
        if event.kind == "scheduling":
            output.print_message(f"real-time scheduling: {event.text}")

    def close(self, statistics: Statistics) -> None:
        """Take nothing."""


def print_fidelity(found: Mapping[str, Fidelity]) -> None:
    """Print the fidelity of a run's effects, if it had some."""
    if found:
        output.print_line()
        output.print_table(fidelity_table(found))


def end_run(
    statistics: Statistics, sinks: Iterable[RunSink], log: Path | None, failure: TensionlabError | None = None
) -> None:
    """Print what went wrong in a run; leave with exit status 1 if something did, or by Ctrl-C if that ended it."""
    for sink in sinks:
        if (error := getattr(sink, "error", None)) is not None:
            output.print_error(f"the streams for Lab Streaming Layer ended before the run: {error}")
    if failure is not None:
        output.print_error(str(failure))
    for name, why in statistics.unconfirmed.items():
        output.print_error(f'module "{name}" did not confirm that it has stopped: {why}')
    if failure is not None or statistics.emergency or statistics.unconfirmed or statistics.lost:
        raise typer.Exit(1)
    if statistics.ended == CTRL_C:
        kept = f"{log} has the run until then; the next takes another --log"
        raise KeyboardInterrupt(f"all modules are stopped; {kept if log else '--log FILE.mcap keeps a run'}")
