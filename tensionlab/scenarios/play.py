"""Play a scenario on modules: simulated ones with a simulated person, or real ones with a real one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tensionlab.demand import Demand, DemandSource, RigState
from tensionlab.errors import HardwareError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.source import BridgedDemand
from tensionlab.haptics.rendering.assignment import ModuleLimits
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.log.reader import Run, read_run
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.runner.runner import Runner, Tracker
from tensionlab.hardware.runner.settings import Clock, RunSettings, WorldClock
from tensionlab.hardware.runner.statistics import Statistics
from tensionlab.hardware.simulation.channel import Conditions
from tensionlab.hardware.simulation.world import World
from tensionlab.model.rig import Rig
from tensionlab.records import manifest
from tensionlab.scenarios import Felt, Person, Scenario, ScenarioDemand
from tensionlab.scenarios.demand_source import Told

SIMULATED = "sim:"


@dataclass(frozen=True, eq=False)
class Modules:
    """The modules that a scenario is played on, open, and who tells where hand and bodies are.

    Attributes
    ----------
    group : ModuleGroup
    clock : Clock
    links : mapping of str to str
        Where each was reached.
    tracker : callable or None
        None: the cables' lengths tell.
    person : Person or None
        Who is simulated, in this process.
    client : ClientState or None
        Where the tracker's frames come in: where they fail to come, there is no force.
    """

    group: ModuleGroup
    clock: Clock
    links: Mapping[str, str]
    tracker: Tracker | None = None
    person: Person | None = None
    client: ClientState | None = None


@dataclass(frozen=True, eq=False)
class Played:
    """What became of a scenario?

    Attributes
    ----------
    scenario : Scenario
    run : Run
        As the host saw it.
    statistics : Statistics
    felt : Felt or None
        What the simulated person really felt; None where nobody was simulated in this process.
    """

    scenario: Scenario
    run: Run
    statistics: Statistics
    felt: Felt | None


def needs_tracker(rig: Rig) -> bool:
    """Whether cable lengths cannot tell where everything is: too few cables, or anchors that move."""
    return bool(rig.frames) or rig.m < rig.n


def simulated(
    scenario: Scenario, conditions: Conditions | None = None, seed: int = 0, *, paced: bool = False
) -> Modules:
    """Which modules does a simulated person hold, in this process?

    Parameters
    ----------
    scenario : Scenario
    conditions : Conditions, optional
        Of the links.
    seed : int
        Of noise and accidents.
    paced : bool
        Whether time passes as it does here, or as fast as it can.
    """
    person = Person(scenario.person, scenario.rig)
    world = World(scenario.rig, person, seed)
    links = dict.fromkeys((module.name for module in scenario.rig.modules), SIMULATED)
    tracker = (lambda time: person.pose) if needs_tracker(scenario.rig) else None
    return Modules(world.group(conditions, seed), WorldClock(world, paced=paced), links, tracker, person)


def play(
    scenario: Scenario,
    modules: Modules,
    solver: str = "newton",
    seconds: float | None = None,
    log: str | Path | None = None,
    call: Sequence[str] = ("tensionlab.scenarios.play",),
    progress: Callable[[float], None] | None = None,
) -> Played:
    """Play a scenario.

    Parameters
    ----------
    scenario : Scenario
    modules : Modules
        Left open.
    solver : str
        As in `tensionlab.allocate`.
    seconds : float, optional
        How much of it; all if left out.
    log : path, optional
        An MCAP file for every cycle; a temporary one if left out.
    call : sequence of str
        For the log's manifest.
    progress : callable, optional
        Told the share that has been played, from 0 to 1.

    Raises
    ------
    HardwareError
        What went wrong with a module; all have been told to stop then.
    """
    with tempfile.TemporaryDirectory() as folder, fast_enough(modules.group, scenario.slew):
        path = Path(folder) / "scenario.mcap" if log is None else Path(log)
        record = RunLog(path, scenario.rig, manifest(call), solver, settings_of(scenario), modules.links)
        statistics = perform(scenario, modules, record.note, solver, seconds, record, progress)
        felt = None if modules.person is None else modules.person.felt
        return Played(scenario, read_run(path), statistics, felt)


def perform(
    scenario: Scenario,
    modules: Modules,
    tell: Told | None = None,
    solver: str = "newton",
    seconds: float | None = None,
    log: RunLog | None = None,
    progress: Callable[[float], None] | None = None,
) -> Statistics:
    """Play a scenario on modules that are `fast_enough`, and keep nothing of it unless there is a log.

    Parameters
    ----------
    scenario, modules, solver, seconds, progress
        As in `play`.
    tell : callable, optional
        As in `ScenarioDemand`.
    log : RunLog, optional
    """
    length = scenario.seconds if seconds is None else seconds
    scene = ScenarioDemand(scenario, tell)
    scene.renderer.limits = module_limits(scenario.rig, modules.group)
    asked: DemandSource = scene if modules.client is None else BridgedDemand(modules.client, scene)

    def demand(state: RigState) -> Demand:
        if state.cycle == 0 and modules.person is not None:
            modules.person.begin()
        if progress is not None:
            progress(state.time / length)
        return asked(state)

    runner = Runner(
        scenario.rig,
        modules.group,
        solver,
        demand,
        settings_of(scenario),
        log=log,
        clock=modules.clock,
        tracker=modules.tracker,
    )
    return runner.run(length)


def settings_of(scenario: Scenario) -> RunSettings:
    """How does a scenario want to be run?"""
    return RunSettings(rate=scenario.rate, nearest=scenario.nearest)


def module_limits(rig: Rig, group: ModuleGroup) -> ModuleLimits:
    """Return what every module of a group renders, by its parameters; it refuses impedances that go beyond."""
    least = {
        name: min(client.parameter(name) for client in group.clients)
        for name in ("stiffness_limit", "damping_limit", "length_upper")
    }
    return ModuleLimits(
        lower=float(rig.limits.lower.max()),
        upper=float(rig.limits.upper.min()),
        stiffness=least["stiffness_limit"],
        damping=least["damping_limit"],
        length=least["length_upper"],
    )


@contextmanager
def fast_enough(group: ModuleGroup, slew: float | None) -> Iterator[None]:
    """Let tensions change so fast, in N/s, and set the modules back after it; None: leave them alone."""
    if slew is None:
        yield
        return
    before = [client.parameter("slew") for client in group.clients]
    for client in group.clients:
        client.set_parameter("slew", slew)
    try:
        yield
    finally:
        for client, own in zip(group.clients, before, strict=True):
            try:
                client.set_parameter("slew", own)
            except HardwareError:  # it is gone, or lets go: what ended the run has been said
                continue
