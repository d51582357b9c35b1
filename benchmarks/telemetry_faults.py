"""Faults of telemetry that no module announces: a run must notice all of them in time, and nothing else.

``python -m benchmarks.telemetry_faults`` (or ``make faults``) plays runs of simulated modules, in
lockstep, behind perfect links and behind ones as published, with one fault each or none.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context

import numpy as np

from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import HardwareError, ProtocolError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Fault
from tensionlab.hardware.protocol.messages import Decoder, SetTension, Telemetry, WireFrame, read
from tensionlab.hardware.runner.armed_modules import TELEMETRY_UNITS
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig

RIGS = ("bartels2026-validation", "seven-modules", "floor-3")
# 20 to 30 ms one way; 1 % of the frames of some 50 bytes are lost.
PUBLISHED = Conditions(latency=0.02, jitter=0.01, drop=2e-4)
# How late telemetry and set-points get, in s, and how fast, in s a second.
LATE_S, SET_POINTS_LATE_S, CREEP = 1.0, 0.4, 0.4
JUMP_M = 0.3
TTL = 0.25  # of set-points, in s: as runs have it
CYCLES = 3.0  # right for what a single frame shows, in cycles, besides the link's latency


@dataclass(frozen=True)
class Kind:
    """What a fault looks like, and how soon it must be noticed.

    Attributes
    ----------
    said : str
        Part of the reason that a run must give; empty for what needs none.
    within : float
        How soon, as a multiple of the time to live.
    """

    said: str
    within: float


KINDS = {
    "frozen": Kind("repeats its report", 1.0),
    "late": Kind("has been silent for", 1.0),
    "late from the start": Kind("is late", 2.0 + (LATE_S + 0.2) / TTL),  # if it is reported
    "later and later": Kind("is late", 1.0 / CREEP + 2.0),
    "set-points late": Kind("is late", 1.0 / CREEP + 2.0),
    "jump": Kind("than its speed explains", 0.0),
    "not a number": Kind("reports a", 0.0),
    "fault bits": Kind("reports a fault", 0.0),
    "reordered": Kind("", 0.0),
}


class TamperedLink:
    """A link to a simulated module whose reports change from some time on.

    Parameters
    ----------
    inner : SimulatedLink
    kind : str
        One of `KINDS`.
    begin : float
        When, by the module's clock, in s.
    seed : int
    """

    lockstep = True
    file: int | None = None

    def __init__(self, inner: SimulatedLink, kind: str, begin: float, seed: int) -> None:
        self.inner, self.url, self.clock = inner, inner.url, inner.clock
        self._kind, self._begin, self._draw = kind, begin, random.Random(seed)
        self._said, self._heard = Decoder(), Decoder()
        self._back: list[tuple[float, bytes]] = []
        self._there: list[tuple[float, bytes]] = []
        self._kept: bytes | None = None

    def send(self, content: bytes) -> None:
        """Hand set-points over, some of them late."""
        for frame in self._heard.feed(content):
            late = self._kind == "set-points late" and frame.type == SetTension.type
            self._there.append((self.clock() + (self._lag(SET_POINTS_LATE_S) if late else 0.0), frame.pack()))
        self._deliver()

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes, which are not all what the module said."""
        end = self.clock() + timeout
        while True:
            self._deliver()
            content = self.inner.receive(min(max(end - self.clock(), 0.0), 1e-3))
            for frame in self._said.feed(content):
                self._take(frame)
            now = self.clock()
            arrived = b"".join(each for due, each in self._back if due <= now)
            self._back = [(due, each) for due, each in self._back if due > now]
            if arrived or now + 1e-3 > end:
                return arrived

    def close(self) -> None:
        """Close the link inside."""
        self.inner.close()

    def _deliver(self) -> None:
        now = self.clock()
        for due, content in self._there:
            if due <= now:
                self.inner.send(content)
        self._there = [(due, content) for due, content in self._there if due > now]

    def _lag(self, most: float) -> float:
        return min(max(CREEP * (self.clock() - self._begin), 0.0), most)

    def _take(self, frame: WireFrame) -> None:
        now, content = self.clock(), frame.pack()
        if frame.type != Telemetry.type or now < self._begin:
            self._back.append((now, content))
            return
        if self._kind == "frozen":
            self._kept = content if self._kept is None else self._kept
            self._back.append((now, self._kept))
        elif self._kind in ("late", "late from the start"):
            self._back.append((now + LATE_S, content))
        elif self._kind == "later and later":
            self._back.append((now + self._lag(LATE_S), content))
        elif self._kind == "reordered":
            if self._kept is None:
                self._kept = content
            else:
                self._back += [(now, content), (now, self._kept)]
                self._kept = None
        else:
            self._back.append((now, self._changed(frame)))

    def _changed(self, frame: WireFrame) -> bytes:
        try:
            said = read(frame)
        except ProtocolError:
            return frame.pack()
        assert isinstance(said, Telemetry)
        if self._kind == "jump":
            said = replace(said, length=said.length + JUMP_M)
        elif self._kind == "fault bits":
            said = replace(said, faults=Fault.CURRENT)
        elif self._kind == "not a number":
            object.__setattr__(said, self._draw.choice(list(TELEMETRY_UNITS)), float("nan"))
        else:
            return frame.pack()
        values = [getattr(said, name) for name in said._kinds]
        return WireFrame(frame.type, frame.sequence, said._layout.pack(*values)).pack()


@dataclass(frozen=True)
class Case:
    """One run: a fault of one module at some time, or none, and what its links are like."""

    seed: int
    kind: str | None
    published_link: bool


@dataclass(frozen=True)
class Outcome:
    """What was noticed.

    Attributes
    ----------
    case : Case
    wrong : str
        What should have been otherwise; empty if all is right.
    after : float
        How long after the begin of the fault it was noticed, in s; NaN if it was not.
    """

    case: Case
    wrong: str
    after: float


def play(case: Case, seconds: float = 4.0) -> Outcome:
    """Play a run, in which the hand moves, and return what it reports of its modules."""
    draw = np.random.default_rng(case.seed)
    rig = load_rig(RIGS[case.seed % len(RIGS)])
    world = World(rig, _hand(rig, draw), seed=case.seed)
    victim = int(draw.integers(rig.m))
    begin = 0.0 if case.kind == "late from the start" else float(draw.uniform(0.8, 1.5))
    conditions = PUBLISHED if case.published_link else Conditions()
    clients = []
    for index, (module, simulated) in enumerate(zip(rig.modules, world.modules, strict=True)):
        link: Link = SimulatedLink(simulated)
        if index == victim and case.kind is not None:
            link = TamperedLink(SimulatedLink(simulated), case.kind, begin, case.seed)
        faulty = FaultyLink(link, conditions, seed=case.seed + index)
        clients.append(ModuleClient(module.name, faulty, seed=case.seed + index))
    noticed: list[float] = []
    own = world.modules[victim]
    settings = RunSettings(ttl=TTL, on_loss="continue" if case.seed % 2 else "stop")

    def demand(state: RigState) -> Demand:
        if not state.active.all() and not noticed:
            noticed.append(own.seconds)
        return Demand(np.array([0.0, 0.4 * np.sin(4.0 * state.time), 0.2]))

    runner = Runner(rig, ModuleGroup(clients), "newton", demand, settings, clock=WorldClock(world))
    error = ""
    try:
        runner.run(seconds)
    except HardwareError as caught:
        error = str(caught)
        noticed = noticed or [own.seconds]
    after = noticed[0] - begin if noticed else float("nan")
    lost = runner.statistics.lost or ({"": error} if error else {})
    return Outcome(
        case, _judge(case, rig.modules[victim].name, lost, after, clients[victim].endpoint.stale), after
    )


def _judge(case: Case, victim: str, lost: dict[str, str], after: float, stale: int) -> str:
    """Say what is wrong with what was noticed."""
    if case.kind is None or not KINDS[case.kind].said:
        if lost:
            return f"false alarm: {lost}"
        return "" if case.kind is None or stale else "not noticed"
    kind = KINDS[case.kind]
    if list(lost) != [victim]:
        return f"lost {lost or 'no module'} in place of {victim}"
    if kind.said not in lost[victim]:
        return f"called {lost[victim]!r}"
    bound = kind.within * TTL + CYCLES * 0.02 + 0.1 + (0.06 if case.published_link else 0.0)
    return f"noticed after {after:.3f} s, more than {bound:.3f} s" if after > bound else ""


def _hand(rig: Rig, draw: np.random.Generator) -> Callable[[float], Pose]:
    """Return the path of a hand that goes round home, at up to 1 m/s, which it gains in half a second."""
    radius, rate = 0.1, draw.uniform(1.0, 10.0)
    first, second = np.linalg.qr(draw.normal(size=(rig.dimension, 2)))[0].T

    def motion(time: float) -> Pose:
        angle = rate * (time + 0.5 * np.expm1(-time / 0.5))
        return Pose(rig.home + radius * (np.sin(angle) * first + (1.0 - np.cos(angle)) * second))

    return motion


def campaign(count: int, seed: int = 0, processes: int = 1) -> Iterator[Outcome]:
    """Play runs with a fault, and as many without, behind perfect and published links by turns."""
    kinds = list(KINDS)
    cases = [
        Case(seed + index, kind, bool(index // len(kinds) % 2))
        for index in range(count)
        for kind in (kinds[index % len(kinds)], None)
    ]
    if processes == 1:
        yield from map(play, cases)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(partial(play), cases, chunksize=4)


def main() -> None:
    """Play a campaign from the command line; exit status 1 if a fault is missed, or seen where there is none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    outcomes = list(campaign(options.count, options.seed, options.processes))
    counts = Counter(each.case.kind or "no fault" for each in outcomes)
    wrong = [each for each in outcomes if each.wrong]
    for kind, count in counts.items():
        own = [each for each in outcomes if (each.case.kind or "no fault") == kind]
        times = [each.after for each in own if np.isfinite(each.after)]
        latest = f", after {np.median(times):.2f} s (median), {max(times):.2f} s (latest)" if times else ""
        print(f"{kind}: {count} runs, {sum(bool(each.wrong) for each in own)} wrong{latest}")
    for each in wrong[:20]:
        print(f"{each.case}: {each.wrong}", file=sys.stderr)
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()
