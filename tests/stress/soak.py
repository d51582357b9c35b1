"""A long run of seven modules behind bad links, on a simulated clock, and hosts that are killed.

The same seed gives the same log. `test_soak` runs it.
"""

from __future__ import annotations

import random
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.processes import process, simulated
from tensionlab.demand import Pose
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.hardware.log.reader import Run, read_run
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.protocol.codes import Limit, State
from tensionlab.hardware.runner.program import Program, ProgramStep
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import COLUMNS
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.provenance import manifest

RIG = "seven-modules"
LINK = Conditions(latency=0.030, jitter=0.010, drop=0.01, corrupt=0.001)  # of each module: shares of the bytes
ORBIT_M, ORBIT_S = 0.05, 10.0  # radius and period of the hand's circle around its home
TTL, LARGEST_ERROR = 0.5, 0.05
TRANSIT_S = 0.1  # longest time in which a set-point arrives, and then the telemetry that reports it
START = (0.0, -0.5, -1.5)
CORNERS = ((1.5, 0.3, 0.0), (0.0, 0.8, 1.5), (-1.5, 0.3, 0.0), START)
START_SECONDS, STEP_SECONDS = 1.0, 15.0  # the force goes round slowly: a bad link is some 0.1 s behind
OLDEST_LOST = 1.0  # a log may lack the last second before its host was killed
ROUNDING = 1e-5  # tensions are sent in single precision, N


@dataclass(frozen=True)
class Findings:
    """Findings of a run.

    Attributes
    ----------
    cycles, compared : int
        Cycles of the run, and those whose force could be compared.
    largest_error : float
        Largest error of the force that the modules reported, as a share of the desired force.
    outside : int
        Tensions outside the limits, sent or rendered.
    went_back : int
        Times that a module followed an older set-point than one before.
    oldest : float
        Age of the oldest set-point that a module followed, in s.
    """

    cycles: int
    compared: int
    largest_error: float
    outside: int
    went_back: int
    oldest: float

    def problems(self, oldest: float, largest_error: float) -> list[str]:
        """Return what must not be, for a maximum age of set-points (s) and a maximum relative error of forces."""
        wrong = []
        if self.outside:
            wrong.append(f"{self.outside} tensions outside their limits")
        if self.went_back:
            wrong.append(f"{self.went_back} times a module went back to an older set-point")
        if self.oldest > oldest:
            wrong.append(f"a set-point of {self.oldest:.3f} s was still followed; at most {oldest:g} s are right")
        if not self.largest_error <= largest_error:
            wrong.append(f"the force was off by {100 * self.largest_error:.1f} % of the demand")
        if not self.compared:
            wrong.append("no cycle could be compared")
        return wrong


def examine(run: Run, outside: int = 0) -> Findings:
    """Return the findings of a run; outside: tensions outside the limits that were seen during it.

    The force is that of the tensions that the modules reported, at the pose by their cable lengths, against the
    demand at the time the latest of their set-points was sent, where that was exact. Left out are cycles in which
    a limiter of a module is active, or the host limited the slew rate: the set-points are then still moving.
    """
    source = followed(run)
    known = (source >= 0).all(axis=1)
    free = (run.limiters == Limit.NONE) | (run.limiters == Limit.LOWER)
    rows = np.flatnonzero(known & free.all(axis=1))
    latest = source[rows].max(axis=1)
    whole = (run.commanded[latest] == run.chosen[latest]).all(axis=1)
    known_then = np.isfinite(run.measured[rows]).all(axis=1)  # not from a report that is old
    exact = (run.status[latest] == Status.EXACT) & whole & known_then
    rows, latest = rows[exact], latest[exact]
    pulled = np.einsum("knm,km->kn", run.structure[rows], run.measured[rows])
    wanted = run.demanded[latest]
    errors = np.linalg.norm(pulled - wanted, axis=1) / np.linalg.norm(wanted, axis=1)
    sent = run.commanded[np.isfinite(run.commanded)]
    lower, upper = run.rig.limits.lower, run.rig.limits.upper
    outside += int(((run.commanded < lower) | (run.commanded > upper)).sum())
    ages = (run.time[:, None] - run.time[source] - run.ages)[known]
    return Findings(
        cycles=len(run),
        compared=len(rows),
        largest_error=float(errors.max(initial=0.0)) if sent.size else np.nan,
        outside=outside,
        went_back=int((np.diff(source[known], axis=0) < 0).sum()),
        oldest=float(ages.max(initial=0.0)),
    )


def followed(run: Run) -> Integers:
    """Return the cycle in which the set-point was sent that each module followed, by its telemetry.

    Returns
    -------
    (K, m) array
        Row of the run; -1 before the first one that a module followed.
    """
    found: Integers = np.full(run.last_sequence.shape, -1, dtype=np.int64)
    for module in range(run.rig.m):
        last = np.full(256, -1, dtype=np.int64)
        for row in range(len(run)):
            if run.last_sequence[row, module] >= 0:
                found[row, module] = last[run.last_sequence[row, module]]
            last[run.sequences[row, module]] = row
    return found


class LimitWatch:
    """Watch of a world that counts how often a running module leaves its limits, from above 0 N when it begins."""

    def __init__(self, limits: TensionLimits) -> None:
        self._lower, self._upper = limits.lower - ROUNDING, limits.upper + ROUNDING
        self._taut = np.zeros(limits.lower.size, dtype=bool)
        self.outside = 0

    def __call__(self, traces: Sequence[Floats]) -> None:
        """Count in the latest steps of all modules."""
        for index, trace in enumerate(traces):
            state, commanded = trace[:, COLUMNS["state"]], trace[:, COLUMNS["commanded"]]
            running = state == State.RUNNING
            taut = running & (commanded >= self._lower[index])
            before = np.concatenate(([self._taut[index]], taut[:-1]))
            slackened = before & running & ~taut
            self.outside += int((slackened | (running & (commanded > self._upper[index]))).sum())
            self._taut[index] = taut[-1]


def on_circle(rig: Rig, time: float) -> Floats:
    """Return the point at a time, in m: on a circle around home, across the axis that points up."""
    first, second = [axis for axis in range(3) if "xyz"[axis] != rig.vertical]
    angle = 2.0 * np.pi * time / ORBIT_S
    point: Floats = rig.home.copy()
    point[first] += ORBIT_M * np.cos(angle)
    point[second] += ORBIT_M * np.sin(angle)
    return point


def soak(seconds: float, log: Path, seed: int = 0) -> Findings:
    """Run for some simulated seconds, write a log, and return the findings."""
    rig = load_rig(RIG)
    world = World(rig, lambda time: Pose(on_circle(rig, time), frames=rig.at_rest), seed)
    watch = LimitWatch(rig.limits)
    world.watch = watch
    steps = [ProgramStep(seconds=START_SECONDS, wrench=list(START))]
    steps += [ProgramStep(seconds=STEP_SECONDS, wrench=list(corner), ramp=True) for corner in CORNERS]
    program = Program(name="the force goes round", steps=steps, repeat=True)
    settings = RunSettings(ttl=TTL)
    links = dict.fromkeys((module.name for module in rig.modules), "sim:")
    record = RunLog(log, rig, manifest(["tests.stress.soak"], seed=seed), "newton", settings, links)
    Runner(rig, world.group(LINK, seed), "newton", program, settings, sinks=[record], clock=WorldClock(world)).run(
        seconds
    )
    return examine(read_run(log), watch.outside)


def kills(count: int, folder: Path, seed: int = 0) -> list[str]:
    """Kill hosts at random moments; return those of their logs that do not open, or lack more than a second."""
    draw, wrong = random.Random(seed), []
    rig = "bartels2026-validation"
    with simulated(rig) as (links, _):
        (folder / "killed.toml").write_text(modules_to_toml(links), encoding="utf-8")
        for index in range(count):
            log = folder / f"killed-{index}.mcap"
            log.unlink(missing_ok=True)
            with process(
                "run", rig, "--modules", folder / "killed.toml", "--force", 0, 0, 1, "--log", log
            ) as host:
                while not log.exists() or log.stat().st_size < 20_000:
                    time.sleep(0.01)
                time.sleep(draw.uniform(0.0, 1.5))
                host.kill()
                killed = time.time()
            run = read_run(log)
            if run.complete or not (run.cycle == range(len(run))).all():
                wrong.append(f"{log}: cycles are missing in the middle")
            if killed - run.began - run.time[-1] > OLDEST_LOST:
                wrong.append(f"{log}: ends {killed - run.began - run.time[-1]:.2f} s before its host was killed")
    return wrong
