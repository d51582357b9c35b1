"""Playing a scenario on modules: simulated ones with a simulated person, or real ones with a real one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tensionlab.demand import Demand, DemandSource, RigState
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.source import BridgedDemand
from tensionlab.haptics.rendering.assignment import ModuleLimits
from tensionlab.hardware.client.group import ModuleGroup, temporary_slew
from tensionlab.hardware.log.reader import Run, read_run
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.runner.records import RunSink, Statistics
from tensionlab.hardware.runner.runner import Runner, Tracker
from tensionlab.hardware.runner.settings import Clock, RunSettings, WorldClock
from tensionlab.hardware.sharing import SharedRun
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import World
from tensionlab.model.rig import Rig
from tensionlab.scenarios.demand_source import ScenarioDemand
from tensionlab.scenarios.person import Person, PersonRecord
from tensionlab.scenarios.scenario import Scenario
from tensionlab.scenarios.scenery import as_mapping
from tensionlab.support.provenance import manifest


@dataclass(frozen=True, eq=False)
class ScenarioModules:
    """Open modules, with their links by name, and the source of the poses of hand and bodies."""

    group: ModuleGroup
    clock: Clock
    links: Mapping[str, str]
    tracker: Tracker | None = None  # without one, the pose comes from the cables' lengths
    person: Person | None = None  # simulated in this process
    client: ClientState | None = None  # receives a tracker's frames; without frames the force is 0


@dataclass(frozen=True, eq=False)
class ScenarioResult:
    """Scenario that was played, its run, and the record of a person simulated in this process."""

    scenario: Scenario
    run: Run
    statistics: Statistics
    person: PersonRecord | None

    def __repr__(self) -> str:
        return f"<ScenarioResult {self.scenario.name}: {self.statistics.title}, {self.statistics.answers}>"

    def _repr_html_(self) -> str:
        return self.statistics._repr_html_()


def needs_tracker(rig: Rig) -> bool:
    """Return whether cable lengths do not determine the pose: too few cables, or moving anchors."""
    return bool(rig.frames) or rig.m < rig.n


def simulate_modules(
    scenario: Scenario, conditions: Conditions | None = None, seed: int = 0, *, paced: bool = False
) -> ScenarioModules:
    """Return modules in this process whose cables a simulated person holds.

    The conditions are those of the links, the seed that of noise and accidents. Time passes as fast as possible
    or, if ``paced``, no faster than real time.
    """
    person = Person(scenario.person, scenario.rig)
    world = World(scenario.rig, person, seed)
    links = dict.fromkeys((module.name for module in scenario.rig.modules), "sim:")
    tracker = (lambda time: person.pose) if needs_tracker(scenario.rig) else None
    clock = WorldClock(world, paced=paced)
    return ScenarioModules(world.group(conditions, seed), clock, links, tracker, person)


def play(
    scenario: Scenario,
    modules: ScenarioModules,
    solver: str = "newton",
    seconds: float | None = None,
    log: str | Path | None = None,
    call: Sequence[str] = ("tensionlab.scenarios.play",),
    progress: Callable[[float], None] | None = None,
    sinks: Sequence[RunSink] = (),
) -> ScenarioResult:
    """Play a scenario on modules, which stay open, and read its log.

    It lasts ``seconds``, by default the whole scenario. ``log`` is the MCAP file of the run, a temporary one if
    left out, and ``call`` the call in its manifest. ``progress`` is called with the share that has been played;
    ``sinks`` get the run besides the log. `HardwareError` if a module failed; all have been stopped.
    """
    length = scenario.seconds if seconds is None else seconds
    rig, group, scenery = scenario.rig, modules.group, as_mapping(scenario)
    settings = RunSettings(rate=scenario.rate, policy=scenario.policy)

    def note(kind: str, text: str) -> None:
        runner.note(kind, text)

    inner = ScenarioDemand(scenario, note)
    source: DemandSource = inner if modules.client is None else BridgedDemand(modules.client, inner)

    def demand(state: RigState) -> Demand:
        if state.cycle == 0 and modules.person is not None:
            modules.person.begin()
        if progress is not None:
            progress(state.time / length)
        return source(state)

    with tempfile.TemporaryDirectory() as folder, temporary_slew(group, scenario.slew):
        inner.renderer.limits = module_limits(rig, group)
        path = Path(folder) / "scenario.mcap" if log is None else Path(log)
        record = RunLog(path, rig, manifest(call), solver, settings, modules.links, scenery)
        sinks = [SharedRun(rig, solver, settings, group.clients, scenery), record, *sinks]
        clock, tracker = modules.clock, modules.tracker
        runner = Runner(rig, group, solver, demand, settings, sinks=sinks, clock=clock, tracker=tracker)
        statistics = runner.run(length)
        person = None if modules.person is None else modules.person.record
        return ScenarioResult(scenario, read_run(path), statistics, person)


def module_limits(rig: Rig, group: ModuleGroup) -> ModuleLimits:
    """Return the limits of impedances that every module of a group renders, by its parameters."""
    names = ("stiffness_limit", "damping_limit", "length_upper", "slew")
    limits = (min(client.parameter(name) for client in group.clients) for name in names)
    return ModuleLimits(float(rig.limits.lower.max()), float(rig.limits.upper.min()), *limits)
