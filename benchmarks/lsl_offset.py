"""Samples of a run as an inlet of Lab Streaming Layer gets them: ``python -m benchmarks.lsl_offset``.

A simulated run of ``--seconds`` at ``--rate`` Hz, with inlets in the same process, over this machine's network.
Prints how many samples and markers came, how well the stamps fit the times of the cycles, and what sending takes.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from tensionlab.demand import Demand
from tensionlab.hardware import Runner, RunSettings, World, WorldClock
from tensionlab.hardware.runner.records import Cycle, RunEvent
from tensionlab.lsl import LslStreams, require_lsl
from tensionlab.model.files import load_rig

RIG = "bartels2026-validation"
STREAMS = ("forces", "tensions", "pose", "markers")
TIMEOUT_S = 30.0


class Timed(LslStreams):
    """Streams that keep the times of cycles, and how long it took to send their samples."""

    times: list[float]
    spent: list[float]
    events: int

    def write(self, cycle: Cycle) -> None:
        """Send the samples of a cycle, and keep the time that it took."""
        began = time.perf_counter()
        super().write(cycle)
        self.spent.append(time.perf_counter() - began)
        self.times.append(cycle.state.time)

    def note(self, event: RunEvent) -> None:
        """Send a marker, and count it."""
        super().note(event)
        self.events += 1


def main() -> None:
    """Print the figures; exit status 1 if a sample is missing, late by a cycle, or out of order."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=100.0)
    options = parser.parse_args()
    lsl = require_lsl()
    rig = load_rig(RIG)
    streams = Timed(rig, "newton", options.rate)
    streams.times, streams.spent, streams.events = [], [], 1  # the first says that the run begins
    inlets = {}
    for what in STREAMS:
        (found,) = lsl.resolve_byprop("name", f"{RIG} {what}", timeout=TIMEOUT_S)
        inlets[what] = lsl.StreamInlet(found, max_buflen=int(options.seconds) + 60)
        inlets[what].open_stream(timeout=TIMEOUT_S)
    world = World(rig)
    pull, settings = Demand(np.array([0.0, 0.5, 0.0])), RunSettings(rate=options.rate)
    clock = WorldClock(world, paced=True)
    runner = Runner(rig, world.group(), "newton", lambda state: pull, settings, sinks=[streams], clock=clock)
    runner.run(options.seconds)
    wrong = False
    for what, inlet in inlets.items():
        expected = streams.events if what == "markers" else len(streams.times)
        stamps: list[float] = []
        while len(stamps) < expected:
            sample, stamp = inlet.pull_sample(timeout=1.0)
            if sample is None:
                break
            stamps.append(stamp)
        ordered = bool((np.diff(stamps) >= 0).all())
        wrong |= len(stamps) < expected or not ordered
        line = f"{what:9} {len(stamps):7,d} of {expected:7,d} samples{'' if ordered else ', out of order'}"
        if what != "markers" and len(stamps) == expected:
            spread = float(np.ptp(np.array(stamps) - streams.times))
            wrong |= spread >= 1.0 / options.rate
            line += (
                f"; stamps within {1e3 * spread:.2f} ms of the cycles, which are {1e3 / options.rate:g} ms apart"
            )
        print(line)
    spent = 1e6 * np.array(streams.spent)
    print(f"sending: {np.median(spent):.0f} µs a cycle (median), {np.quantile(spent, 0.99):.0f} µs (p99)")
    raise SystemExit(int(wrong))


if __name__ == "__main__":
    main()
