"""Logs without a runner, for the tests: real cycles of a real rig, allocated by a real solver."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import tensionlab as tl
from tensionlab.demand import Demand, Impedance, Pose, RigState
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.protocol.codes import BrakeState, Limit, ResetReason, State
from tensionlab.hardware.protocol.messages import Info
from tensionlab.hardware.runner.records import DEMAND_STOPPED, Cycle, RunEvent, Statistics
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.solvers.base import Status

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
MANIFEST = {"call": "tensionlab run", "date": "2026-11-21T22:00:00+00:00", "seed": 3, "versions": {"numpy": "2"}}


INFO = Info(1, 257, 7, ResetReason.POWER, State.IDLE, 0, 0, True, True, 28, 250, 0.5, 6.0, 3.0, 0.0195, 3.0)


def four():
    return tl.load_rig(RIGS / "bartels2026-validation.toml")


def seven():
    return tl.load_rig(RIGS / "seven-modules.toml")


def new_log(path, rig, solver="newton", policy=None, rate=50.0):
    links = {module.name: f"sim:{module.name}" for module in rig.modules}
    return RunLog(path, rig, MANIFEST, solver, RunSettings(rate, policy=policy), links)


def cycles(rig, count, rate=50.0, solver="newton", policy=None, size=2.0, lost=None) -> Iterator[Cycle]:
    """Yield cycles in which point and desired force go round; one module may be lost half way."""
    random = np.random.default_rng(0)
    exact, own = tl.Allocator(rig.limits), tl.Allocator(rig.limits, solver, policy=policy)
    measured = np.full(rig.m, np.nan)
    sequence = 250
    for index in range(count):
        angle = 2 * np.pi * index / (2.0 * rate)
        active = np.full(rig.m, True)
        if lost is not None and index >= count // 2:
            active[lost] = False
        position = rig.home + 0.05 * np.array([np.cos(angle), np.sin(angle), 0.0])[: rig.dimension]
        structure = rig.structure_matrix(position)
        wrench = np.zeros(rig.n)
        force = size * np.array([np.sin(angle), np.cos(angle), np.sin(3 * angle)])
        wrench[: rig.dimension] = force[: rig.dimension]
        wanted = None if index % 50 == 49 else wrench
        limits = (np.where(active, rig.limits.lower, 0.0), np.where(active, rig.limits.upper, 0.0))
        if active.all():
            found = own(structure, wrench)
        else:
            found = tl.allocate(structure, wrench, limits, solver, policy=policy)
        fallback_used = bool(found.status == Status.UNPROVEN)
        if fallback_used:
            found = exact(structure, wrench) if active.all() else tl.allocate(structure, wrench, limits)
        sequence = (sequence + 1) % 256
        first = index == 0
        state = RigState(
            cycle=index,
            time=index / rate,
            pose=Pose(position),
            twist=random.normal(0.0, 0.01, rig.n),
            structure=structure,
            lengths=rig.lengths(position),
            speeds=random.normal(0.0, 0.01, rig.m),
            tensions=measured,
            ages=np.full(rig.m, np.inf) if first else random.uniform(0.005, 0.03, rig.m),
            delays=np.full(rig.m, np.nan) if first else random.uniform(0.01, 0.05, rig.m),
            active=active,
            states=np.where(active, State.RUNNING, State.FAULT).astype(np.int64),
            faults=np.where(active, 0, 1).astype(np.int64),
            limiters=np.where(found.tensions > 0.6, Limit.NONE, Limit.LOWER).astype(np.int64),
            brakes=np.full(rig.m, -1 if first else BrakeState.OPEN),
            last_sequence=np.full(rig.m, -1 if first else (sequence - 1) % 256),
            windings=np.full(rig.m, 30.0 + index),
            upper_now=rig.limits.upper,
            clearance=np.full(rig.m, np.nan),
        )
        sent = np.where(active, found.tensions, np.nan)
        measured = np.where(active, np.float32(found.tensions), 0.0)
        yield Cycle(
            state=state,
            demand=Demand(
                wrench=wanted,
                impedances={rig.modules[0].name: Impedance(1.0, 50.0)} if wanted is None else {},
                brakes=frozenset({rig.modules[-1].name}) if wanted is None else frozenset(),
                stop=index == count - 1,
            ),
            solver_wrench=wrench if wanted is not None else found.wrench,
            allocation=found,
            fallback_used=fallback_used,
            commanded=sent,
            sequences=np.where(active, sequence, -1),
            start_delay=float(random.exponential(2e-4)),
            compute_time=float(random.uniform(2e-4, 3e-4)),
        )


class EventList(list):
    """Sink of a run that keeps its events."""

    def begin(self, infos, statistics):
        pass

    def write(self, cycle):
        pass

    def note(self, event):
        self.append(event)

    def close(self, statistics):
        pass


def logged(path, rig, count=200, **how):
    """Write a run to a file, and return its cycles."""
    log = new_log(path, rig, **{key: how[key] for key in ("solver", "policy", "rate") if key in how})
    log.begin({module.name: INFO for module in rig.modules}, Statistics())
    log.note(RunEvent(-1, 0.0, "armed", "all modules are armed"))
    written = []
    for cycle in cycles(rig, count, **how):
        log.write(cycle)
        written.append(cycle)
        if how.get("lost") is not None and cycle.state.cycle == count // 2:
            name = rig.modules[how["lost"]].name
            text = f'module "{name}" has let go (FAULT: ENCODER)'
            log.note(RunEvent(cycle.state.cycle, cycle.state.time, "lost", text, name))
    last = written[-1].state if written else SimpleNamespace(cycle=-1, time=0.0)
    log.note(RunEvent(last.cycle, last.time, "ended", DEMAND_STOPPED))
    log.close(Statistics(missed=3, ended=DEMAND_STOPPED))
    return written
