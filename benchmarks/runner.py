"""Benchmark of the runner: processor time of a run at 1 kHz with four modules, and at 100 Hz with seven.

``python -m benchmarks.runner`` (or ``make bench-runner``): the work of a cycle, which is what
passes from its begin to the last set-point that is handed over, and its share of a processor.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np

from benchmarks.processes import simulated
from tensionlab.demand import Demand, RigState
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import Clock, RunSettings, WorldClock
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig

FOUR = "bartels2026-validation"
SEVEN = "seven-modules"


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
    rig: Rig, group: ModuleGroup, rate: float, seconds: float, clock: Clock | None = None
) -> tuple[Statistics, float, float]:
    """Run, and return statistics and the shares of a processor of its cycles and of the whole process."""
    demand = Turning(rig)
    runner = Runner(rig, group, "newton", demand, RunSettings(rate=rate), clock=clock)
    whole, began = time.process_time(), time.monotonic()
    statistics = runner.run(seconds)
    share = (time.process_time() - whole) / (time.monotonic() - began)
    own = (demand.spent[-1] - demand.spent[0]) / (len(demand.spent) - 1) * rate
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


def main() -> None:
    """Time runs from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the run at 100 Hz")
    seconds = parser.parse_args().seconds
    four, seven = load_rig(FOUR), load_rig(SEVEN)
    world = World(four)
    report("1 kHz, 4 modules in process", *bench(four, world.group(), 1000.0, 20.0, WorldClock(world)))
    over_tcp("1 kHz, 4 modules over TCP", FOUR, four, 1000.0, 20.0)
    over_tcp("100 Hz, 7 modules over TCP", SEVEN, seven, 100.0, seconds)


def over_tcp(what: str, name: str, rig: Rig, rate: float, seconds: float) -> None:
    """Time a run against modules in another process."""
    with simulated(name) as (links, _):
        group = connect(rig, links)
        try:
            report(what, *bench(rig, group, rate, seconds))
        finally:
            group.close()


if __name__ == "__main__":
    main()
