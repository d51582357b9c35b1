"""Modules whose cable length drifts away from the truth: how soon a run notices, and how wrong its force gets.

``python -m benchmarks.length_drift`` (or ``make drift``) plays runs of simulated modules in lockstep, behind
perfect links and published ones, on redundant rigs whose anchors are 3 mm off, while a hand moves as a person
does. In each, the length of one module drifts by 1 to 200 mm/s, with a speed that agrees or with the true one.
Runs without a drift must not be stopped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context

import numpy as np

import tensionlab as tl
from benchmarks.telemetry_faults import PUBLISHED, TamperedLink
from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import Telemetry, WireFrame, read
from tensionlab.hardware.runner.records import Cycle
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.runner.state_estimation import PoseTracker, synchronise
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

RIGS = ("bartels2026-validation", "cube-8", "seven-modules", "tetra-4", "bartels2026-validation-0.3m")
ANCHOR_ERROR_M = 0.003  # standard deviation of each coordinate of an anchor: what a calibration leaves
MAX_DRIFT_M = 0.35  # a drift ends the run without being noticed at this length


@dataclass(frozen=True)
class Case:
    """Make one run. Without a drift rate, in m/s, it takes `seconds` and nothing is wrong."""

    seed: int
    rig: str
    rate: float | None = None
    speed_agrees: bool = True
    seconds: float = 60.0


@dataclass(frozen=True)
class Outcome:
    """Largest force error in N, time from the begin of the drift to the stop in s (NaN: none), and the reason.

    `doubt` is the largest estimate of a length's bias over its threshold: at 1 the run stops.
    """

    case: Case
    force_error: float
    doubt: float
    after: float
    reason: str
    victim: str


class DriftingLink(TamperedLink):
    """Link to a simulated module whose reported length drifts from some time on."""

    def __init__(self, inner: SimulatedLink, begin: float, rate: float, *, speed_agrees: bool) -> None:
        super().__init__(inner, "drift", begin, 0)
        self._rate, self._speed = rate, rate if speed_agrees else 0.0

    def offset(self, age: float = 0.0) -> float:
        """Return the error of the length that was reported this many seconds ago."""
        return self._rate * max(self.clock() - age - self._begin, 0.0)

    def _changed(self, frame: WireFrame) -> bytes:
        said = read(frame)
        assert isinstance(said, Telemetry)
        said = replace(said, length=said.length + self.offset(), speed=said.speed + self._speed)
        return said.frame(frame.sequence).pack()


class Hand:
    """Hand of a person: reaches of minimum jerk between points around home, pauses, tremor, and some flicks.

    Flicks reach 30 m/s², which spools cannot follow: cables go slack for a moment. Minimum jerk: Flash and Hogan
    1985, "The coordination of arm movements", J. Neurosci. 5(7).
    """

    def __init__(self, rig: Rig, draw: np.random.Generator) -> None:
        self._home, self._draw = rig.home, draw
        self._radius = min(0.2 * float(rig.lengths(rig.home).min()), 0.3)
        self._from = self._to = np.zeros(3)
        self._begin, self._arrival, self._next = 0.0, 0.8, 0.8
        self._tremor = draw.uniform(6.0, 10.0), draw.uniform(0.0, 6.0, 3)

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time in s, which does not go back."""
        while time > self._next:
            self._reach()
        share = min((time - self._begin) / (self._arrival - self._begin), 1.0)
        way = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        rate, phases = self._tremor
        tremor = 5e-4 * min(time, 1.0) * np.sin(2.0 * np.pi * rate * time + phases)
        return Pose(self._home + self._from + way * (self._to - self._from) + tremor)

    def _reach(self) -> None:
        draw, self._from = self._draw, self._to
        direction = draw.normal(size=3)
        self._to = direction / np.linalg.norm(direction) * self._radius * draw.uniform() ** (1.0 / 3.0)
        distance = float(np.linalg.norm(self._to - self._from))
        fastest = 3.0 if draw.random() < 0.1 else float(draw.uniform(0.1, 1.2))
        seconds = max(1.875 * distance / fastest, float(np.sqrt(5.77 * distance / 30.0)))
        self._begin, self._arrival = self._next, self._next + seconds
        self._next = self._arrival + (draw.uniform(0.0, 1.0) if draw.random() < 0.5 else 0.0)


class ForceError:
    """Largest error of the commanded force by the drift alone: at the pose by the true lengths.

    It is the difference to the force that the run says it renders, which is limited near singular poses.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig, self._tracker = rig, PoseTracker(rig)
        self._structure: Floats | None = None
        self.largest: float = 0.0

    def take(self, state: RigState, offsets: Floats, before: Cycle | None) -> None:
        """Take the state of a cycle, how wrong its lengths are (m,) in m, and the cycle before."""
        if self._structure is not None and before is not None and state.time > 0.5:
            feasible = bool(tl.allocate(self._structure, before.solver_wrench, self._rig.limits).residual < 1e-6)
            error = float(np.linalg.norm(self._structure @ np.nan_to_num(before.commanded) - before.solver_wrench))
            self.largest = max(self.largest, error if feasible else 0.0)
        lengths = synchronise(state.lengths, state.speeds, state.ages) - offsets
        _, self._structure = self._tracker.follow(lengths, state.active)


def play(case: Case) -> Outcome:
    """Play a run, and see when it stops, and how wrong its force was until then."""
    draw = np.random.default_rng(case.seed)
    rig = load_rig(case.rig)
    moved = [replace(each, anchor=each.anchor + draw.normal(0.0, ANCHOR_ERROR_M, 3)) for each in rig.modules]
    world = World(replace(rig, modules=tuple(moved)), Hand(rig, draw), seed=case.seed)
    victim, begin = int(draw.integers(rig.m)), float(draw.uniform(1.5, 4.0))
    conditions = PUBLISHED if case.seed % 2 else Conditions()
    clients, drifting = [], None
    for index, (module, simulated) in enumerate(zip(rig.modules, world.modules, strict=True)):
        link: Link = SimulatedLink(simulated)
        if index == victim and case.rate is not None:
            link = drifting = DriftingLink(
                SimulatedLink(simulated), begin, case.rate, speed_agrees=case.speed_agrees
            )
        faulty = FaultyLink(link, conditions, seed=case.seed + index)
        clients.append(ModuleClient(module.name, faulty, seed=case.seed + index))
    force = draw.normal(size=3)
    force *= draw.uniform(0.2, 1.0) / np.linalg.norm(force)
    error, doubts = ForceError(rig), []

    def demand(state: RigState) -> Demand:
        doubts.append(float(runner._length_monitor._native.doubts()[0].max()))
        if drifting is not None:
            offsets = np.zeros(rig.m)
            offsets[victim] = drifting.offset(float(state.ages[victim]))
            error.take(state, offsets, runner.latest)
        return Demand(force)

    runner = Runner(rig, ModuleGroup(clients), "newton", demand, RunSettings(), clock=WorldClock(world))
    seconds = case.seconds if case.rate is None else begin + MAX_DRIFT_M / abs(case.rate)
    after, reason = float("nan"), ""
    try:
        runner.run(seconds)
    except HardwareError as stopped:
        after, reason = world.time - begin, str(stopped)
    return Outcome(case, error.largest, max(doubts), after, reason, rig.modules[victim].name)


def drifts(count: int, seed: int = 0, rigs: tuple[str, ...] = RIGS) -> Iterator[Case]:
    """Yield cases with a drift of one module, on each rig by turns, rates evenly spread on a logarithmic scale."""
    for number in range(seed, seed + count):
        draw = np.random.default_rng([number, 1])
        rate = 10.0 ** draw.uniform(-3.0, np.log10(0.2)) * draw.choice([-1.0, 1.0])
        yield Case(number, rigs[number % len(rigs)], float(rate), bool(draw.integers(2)))


def clean(hours: float, seed: int = 0, rigs: tuple[str, ...] = RIGS, minutes: float = 5.0) -> Iterator[Case]:
    """Yield cases in which nothing is wrong: a number of simulated hours, in runs of some minutes."""
    for number in range(seed, seed + round(60.0 * hours / minutes)):
        yield Case(number, rigs[number % len(rigs)], seconds=60.0 * minutes)


def campaign(cases: list[Case], processes: int = 1) -> Iterator[Outcome]:
    """Play all cases."""
    if processes == 1:
        yield from map(play, cases)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(partial(play), cases, chunksize=4)


def report(outcomes: list[Outcome]) -> int:
    """Print what was found, and return how many runs were wrong: a force, a missed drift or a false alarm."""
    wrong = 0
    for rig in RIGS:
        own = [each for each in outcomes if each.case.rig == rig and each.case.rate is not None]
        if not own:
            continue
        errors, times = np.array([each.force_error for each in own]), np.array([each.after for each in own])
        missed = int(np.isnan(times).sum())
        wrong += missed + int((errors > 1.0).sum())
        print(
            f"{rig}: {len(own)} drifts, force error {np.median(errors):.2f} N median, {errors.max():.2f} N "
            f"largest, {(errors > 1.0).sum()} above 1 N; noticed after {np.nanmedian(times):.2f} s median, "
            f"{np.nanmax(times):.1f} s largest, {missed} never"
        )
        for low, high in ((0.001, 0.005), (0.005, 0.02), (0.02, 0.07), (0.07, 0.2)):
            part = [each.after for each in own if low <= abs(each.case.rate or 0.0) <= high]
            if part:
                when = f"{np.nanmedian(part):.2f} s median, {np.nanmax(part):.1f} s largest"
                print(f"    {1e3 * low:g} to {1e3 * high:g} mm/s: noticed after {when}")
    calm = [each for each in outcomes if each.case.rate is None]
    alarms = [each for each in calm if each.reason]
    if calm:
        hours = sum(each.case.seconds for each in calm) / 3600.0
        for rig in RIGS:
            largest = max((each.doubt for each in calm if each.case.rig == rig), default=0.0)
            print(f"{rig}: largest doubt {largest:.2f} of the threshold where nothing is wrong")
        print(f"nothing wrong: {len(alarms)} false alarms in {hours:.1f} h")
    for each in [*alarms, *sorted(outcomes, key=lambda one: -one.force_error)[:5]]:
        print(
            f"  {each.case}: {each.force_error:.2f} N, {each.after:.2f} s, {each.victim}: {each.reason}",
            file=sys.stderr,
        )
    return wrong + len(alarms)


def main() -> None:
    """Play a campaign from the command line; exit status 1 if a run was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="drifts")
    parser.add_argument("--hours", type=float, default=10.0, help="simulated, without a drift")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    cases = [*drifts(options.count, options.seed), *clean(options.hours, options.seed)]
    raise SystemExit(bool(report(list(campaign(cases, options.processes)))))


if __name__ == "__main__":
    main()
