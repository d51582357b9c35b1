"""Benchmark of the runner: its jitter at 1 kHz with seven modules, and the processor time of runs.

``python -m benchmarks.runner`` (or ``make bench-runner``): how late cycles begin; their work, which is what
passes from the begin of a cycle to the last set-point that is handed over; and its share of a processor.
``--jitter datasets/benchmarks/jitter.json`` writes the histograms of the figure `jitter`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.processes import simulated
from tensionlab.demand import Demand, RigState
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import MAX_TTL_S, Clock, RunSettings, WorldClock
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.support.operating_system import processors, usable_processors
from tensionlab.support.provenance import manifest

FOUR = "bartels2026-validation"
SEVEN = "seven-modules"
ROUNDS, ROUND_S = 5, 4.0  # runs of each scheduling, one after the other: 20,000 cycles
EDGES_US = np.geomspace(1.0, 1e6, 61)  # of the histograms
PERCENTILES = (50.0, 99.9, 100.0)


@dataclass
class Turning:
    """A force that turns, and the processor's time at each call."""

    rig: Rig
    spent: list[float] = field(default_factory=list)

    def __call__(self, state: RigState) -> Demand:
        """Return the force to render now."""
        self.spent.append(time.thread_time())
        wrench = np.zeros(self.rig.n)
        wrench[:3] = np.cos(state.time), 0.2, np.sin(state.time)
        return Demand(wrench)


def bench(
    rig: Rig, group: ModuleGroup, settings: RunSettings, seconds: float, clock: Clock | None = None
) -> tuple[Statistics, float, float]:
    """Run, and return statistics and the shares of a processor of its cycles and of the whole process."""
    demand = Turning(rig)
    runner = Runner(rig, group, "newton", demand, settings, clock=clock)
    whole, began = time.process_time(), time.monotonic()
    statistics = runner.run(seconds)
    share = (time.process_time() - whole) / (time.monotonic() - began)
    own = (demand.spent[-1] - demand.spent[0]) / (len(demand.spent) - 1) * settings.rate
    return statistics, own, share


def report(what: str, statistics: Statistics, own: float, share: float) -> None:
    """Print a line."""
    work, late = (1e6 * np.array(statistics.percentiles()[name]) for name in ("compute_time", "start_delay"))
    print(
        f"{what}: {statistics.cycles} cycles, work {work[0]:.0f} us median, {work[1]:.0f} us p99; begins "
        f"{late[0]:.0f} us late, {late[1]:.0f} us p99; {statistics.missed} deadlines missed; cycles take "
        f"{100 * own:.1f} % of a processor, the process {100 * share:.1f} %",
        flush=True,
    )


def jitter() -> dict[str, Any]:
    """Measure work and lateness of cycles with ordinary and with real-time scheduling, in turns; print them."""
    rig, last = load_rig(SEVEN), usable_processors()[-1]
    found: dict[str, list[Statistics]] = {"ordinary": [], "real-time": []}
    load = os.getloadavg()[0]
    with simulated(SEVEN) as (links, _):
        for _ in range(ROUNDS):
            for scheduling, runs in found.items():
                processor = last if scheduling == "real-time" else None
                # The longest time to live: what else is running may hold up the simulated modules.
                settings = RunSettings(rate=1000.0, ttl=MAX_TTL_S, processor=processor)
                group = connect(rig, links)
                try:
                    runs.append(bench(rig, group, settings, ROUND_S)[0])
                finally:
                    group.close()
    call = ["python", "-m", "benchmarks.runner", *sys.argv[1:]]
    about = {"manifest": manifest(call), "processors": processors(), "load_average": round(load, 1)}
    about["edges_us"] = EDGES_US.round(3).tolist()
    return about | {scheduling: distribution(scheduling, runs) for scheduling, runs in found.items()}


def distribution(scheduling: str, runs: list[Statistics]) -> dict[str, Any]:
    """Return and print histograms and percentiles of the cycles of some runs."""
    missed = sum(run.missed for run in runs)
    row: dict[str, Any] = {"missed": missed, "deadlines": missed + sum(run.cycles for run in runs)}
    for name in ("compute_times", "start_delays"):
        times = 1e6 * np.concatenate([getattr(run, name) for run in runs])
        counts = np.histogram(times.clip(EDGES_US[0], EDGES_US[-1]), EDGES_US)[0]
        quantiles = np.percentile(times, PERCENTILES).round(1)
        row[name] = {"percentiles_us": quantiles.tolist(), "counts": counts.tolist()}
        print(f"{scheduling}: {name} of {quantiles[0]:.0f} us median, {quantiles[1]:.0f} us at 99.9 %, "
              f"{quantiles[2]:.0f} us at most", flush=True)  # fmt: skip
    print(f"{scheduling}: {missed} of {row['deadlines']} deadlines missed", flush=True)
    return row


def main() -> None:
    """Time runs from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the run at 100 Hz")
    parser.add_argument("--jitter", type=Path, help="JSON file for the histograms of the cycles' times")
    options = parser.parse_args()
    found = jitter()
    if options.jitter is not None:
        options.jitter.write_text(json.dumps(found) + "\n", encoding="utf-8", newline="\n")
    four, seven = load_rig(FOUR), load_rig(SEVEN)
    world = World(four)
    in_process = bench(four, world.group(), RunSettings(rate=1000.0), 20.0, WorldClock(world))
    report("1 kHz, 4 modules in process", *in_process)
    over_tcp("1 kHz, 4 modules over TCP", FOUR, four, 1000.0, 20.0)
    over_tcp("100 Hz, 7 modules over TCP", SEVEN, seven, 100.0, options.seconds)


def over_tcp(what: str, name: str, rig: Rig, rate: float, seconds: float) -> None:
    """Time a run against modules in another process."""
    with simulated(name) as (links, _):
        group = connect(rig, links)
        try:
            report(what, *bench(rig, group, RunSettings(rate=rate), seconds))
        finally:
            group.close()


if __name__ == "__main__":
    main()
