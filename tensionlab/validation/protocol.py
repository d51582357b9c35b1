"""Published protocol: zero the sensor, then hold one force after another, and average the sensor's samples.

A validation runs from the first force to the last in one session or several: a journal keeps each measurement.
Everything that pulls does so through the `Runner`. The first three forces are along the axes: they show how the
sensor is turned.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from tensionlab.allocation import allocate
from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import HardwareError, InputError, LogError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.codes import Limit
from tensionlab.hardware.runner.records import DEMAND_STOPPED, Statistics
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import Clock, RealClock, RunSettings
from tensionlab.hardware.simulation.world import newton_per_ampere
from tensionlab.model.directions import grid18
from tensionlab.model.files import rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Solver, Status
from tensionlab.support import validation
from tensionlab.support.arrays import Floats
from tensionlab.support.files import writing
from tensionlab.support.files.reading import parse_json, read_text
from tensionlab.support.files.tables import MAX_FILE_BYTES
from tensionlab.validation.error_model import PRESETS, draw_errors, require_point
from tensionlab.validation.sensors import ForceSensor, simulated_setup

NO_LIMIT = (Limit.NONE, Limit.LOWER, Limit.UPPER, Limit.IDLE)  # limiters that are not a module's own
CONTINUOUS_CURRENT_A = 1.0  # about what a winding bears for good: the tables of firmware/README.md
AXIS_FORCES = 3  # number of forces along the axes, which come first
ZERO_S = 1.0  # time for which the sensor is averaged with all motors off
# Temperatures of a winding: above the first, modules rest before a force that needs more than the continuous
# current, until the second. A second of 6 N warms it by 9 K, and they can be rendered up to 84 °C.
HOT_C, COOL_C = 70.0, 62.0
EARLY_S = 1e-6  # time by which a cycle may begin too early
JOURNAL_FILE = "measurements.jsonl"
FORMAT = "tensionlab validation 2"


@dataclass(frozen=True, eq=False)
class Protocol:
    """Directions (K, 3) that are commanded one after another, with forces of one size in N.

    Each is held for ``hold`` s, of which the first ``settle`` s, while tensions move, are not averaged.
    """

    hold: float = 1.0
    settle: float = 0.3
    force: float = 1.5
    directions: Floats = field(default_factory=grid18)

    def __post_init__(self) -> None:
        if not 0.0 <= self.settle < self.hold < np.inf:
            times = f"each force is held for {self.hold:g} s, of which {self.settle:g} s are left out"
            raise InputError(f"{times}; hold longer than that")

    @property
    def forces(self) -> Floats:
        """All commanded forces, in N: (3 + K, 3), the axes first."""
        return self.force * np.concatenate([np.eye(AXIS_FORCES), self.directions])


@dataclass(frozen=True)
class Measurement:
    """Measurement of one force, in N."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    number: int  # row of `Protocol.forces`
    desired: tuple[float, ...]
    rendered: tuple[float, ...]  # of the commanded tensions, by the nominal rig
    measured: tuple[float, ...]  # the sensor's average in its own axes, less its zero
    tensions: tuple[float, ...]  # as commanded
    status: str  # name of the `Status` of the solver's answer
    fallback_used: bool  # whether that was unproven, so that the exact solver's was sent
    samples: int
    spread: float  # standard deviation of the samples along the axis where it is largest
    rested: float  # time for which modules cooled before, in s
    limited_modules: tuple[str, ...]  # at a limit of their own


class ForceSequence:
    """Demand source that holds one force after another, from the row ``first`` of `Protocol.forces` on.

    Before a force that needs more than the continuous rating of a winding (``heating``), modules rest at their
    lower limits until all are cool enough. ``on_held`` receives the number of each force that was held, its
    samples (K, 3), and the time for which modules rested before it, in s.
    """

    def __init__(
        self,
        protocol: Protocol,
        heating: NDArray[np.bool_],
        first: int,
        sensor: ForceSensor,
        on_held: Callable[[int, Floats, float], None],
    ) -> None:
        self._protocol, self._sensor, self._on_held = protocol, sensor, on_held
        self._heating, self._number = heating, first
        self._since = self._rested = 0.0
        self._settled = self._resting = False
        self._demands = [Demand(force) for force in protocol.forces]

    def __call__(self, state: RigState) -> Demand:
        """Return the demand of this cycle; drop the samples of the time in which tensions moved."""
        now = state.time + EARLY_S
        winding = float(np.nanmax(state.windings, initial=0.0))
        if self._resting:
            if winding > COOL_C:
                return Demand()
            self._rested += now - self._since
            self._resting, self._since = False, now
        elif now >= self._since + self._protocol.hold:
            self._on_held(self._number, self._sensor.take(), self._rested)
            self._number += 1
            self._settled, self._rested = False, 0.0
            self._since += self._protocol.hold
            if self._number == len(self._demands):
                return Demand(stop=True)
            if winding > HOT_C and self._heating[self._number]:
                self._resting, self._since = True, now
                return Demand()
        if not self._settled and now >= self._since + self._protocol.settle:
            self._sensor.take()
            self._settled = True
        return self._demands[self._number]


def measure(
    rig: Rig,
    modules: ModuleGroup,
    clock: Clock,
    sensor: ForceSensor,
    solver: str | Solver,
    protocol: Protocol,
    on_measured: Callable[[Measurement], None],
    first: int = 0,
) -> bool:
    """Go through the protocol, from the row ``first`` of its forces on, and hand each measurement on at once.

    Return whether all forces were held: a signal, such as Ctrl-C, may end it before. Raise `HardwareError` of the
    modules, as from `Runner.run`, or of the sensor.
    """
    offset = read_zero(modules, clock, sensor)
    pose = Pose(rig.home, frames=rig.at_rest)
    forces = protocol.forces

    def held(number: int, samples: Floats, rested: float) -> None:
        cycle = runner.latest
        assert cycle is not None
        average = _average(samples, f"of force {number + 1} of {len(forces)}") - offset
        limiters = zip(rig.modules, cycle.state.limiters.tolist(), strict=True)
        measurement = Measurement(
            number=number,
            desired=tuple(forces[number].tolist()),
            rendered=tuple(cycle.allocation.wrench.tolist()),
            measured=tuple(average.tolist()),
            tensions=tuple(cycle.commanded.tolist()),
            status=Status(int(cycle.allocation.status)).name,
            fallback_used=cycle.fallback_used,
            samples=len(samples),
            spread=float(samples.std(axis=0).max()),
            rested=rested,
            limited_modules=tuple(module.name for module, limiter in limiters if limiter not in NO_LIMIT),
        )
        on_measured(measurement)

    chosen = allocate(rig.structure_matrix(rig.home, frames=rig.at_rest), forces, rig.limits, solver=solver)
    continuous = [CONTINUOUS_CURRENT_A * newton_per_ampere(module) for module in rig.modules]
    heating = np.any(chosen.tensions > continuous, axis=-1)
    sequence = ForceSequence(protocol, heating, first, sensor, held)
    runner = Runner(rig, modules, solver, sequence, RunSettings(), clock=clock, tracker=lambda time: pose)
    return has_completed(runner.run())


def read_zero(modules: ModuleGroup, clock: Clock, sensor: ForceSensor) -> Floats:
    """Return the sensor's average (3,) in N with all modules stopped, in its own axes."""
    modules.stop()
    clock.wait_until(clock.now() + ZERO_S)
    sensor.take()
    clock.wait_until(clock.now() + ZERO_S)
    return _average(sensor.take(), "at zero tension")


def has_completed(statistics: Statistics) -> bool:
    """Return whether a run came to its own end, and not by a signal; `HardwareError` after an emergency."""
    if statistics.unconfirmed:
        names = ", ".join(statistics.unconfirmed)
        raise HardwareError(f"{names} did not confirm to have stopped; look at them before anything else")
    if statistics.emergency:
        raise HardwareError("an emergency stop ended the measurement; `tensionlab module clear` leads out of it")
    return statistics.ended == DEMAND_STOPPED


def _average(samples: Floats, when: str) -> Floats:
    if not len(samples):
        raise HardwareError(f"the force sensor showed nothing {when}; is it on, and does it send by itself?")
    return np.asarray(samples.mean(axis=0))


@dataclass(frozen=True, eq=False)
class ValidationPlan:
    """Nominal rig, solver and protocol of a validation."""

    rig: Rig
    solver: str
    protocol: Protocol
    preset: str | None = None  # errors of the simulated rig; None for real modules, or those of another process
    seed: int = 0  # of the errors and of the noise

    def setup(self, *, simulated: bool) -> dict[str, Any]:
        """Return what must be the same in all sessions; ``simulated`` tells whether the sensor is."""
        protocol = vars(self.protocol) | {"directions": self.protocol.directions.tolist()}
        seed = None if self.preset is None else self.seed
        errors = {"simulated": simulated, "preset": self.preset, "seed": seed}
        return {"rig": rig_to_toml(self.rig), "solver": self.solver, **protocol, **errors}


class Journal:
    """File of JSON lines from which an interrupted validation continues: the setup, and then each measurement.

    Measurements are read from the file if it exists; its setup must not differ. Measurements are in the order of
    their numbers, without a gap. `LogError` names a file that is of another validation, is damaged, or can't be
    read; `WriteError` one that can't be written.
    """

    def __init__(self, path: Path, setup: Mapping[str, Any]) -> None:
        self.path = path
        self.measurements: list[Measurement] = []
        head: dict[str, Any] = {"format": FORMAT, **setup}
        text = read_text(path, "the journal of a validation", LogError, MAX_FILE_BYTES) if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a process that was killed may have left half a line
        first, *lines = whole.splitlines() or [json.dumps(head)]
        saved = validation.validate(dict[str, Any], parse_json(first, f"{path}, line 1", LogError), LogError, path)
        if other := [key for key in head | saved if saved.get(key) != head.get(key)]:
            advice = "continue with the same, or name another folder"
            raise LogError(f"{path} is of a validation with other {', '.join(other):.100}; {advice}")
        for number, line in enumerate(lines):
            here = f"{path}, line {number + 2}"
            content = parse_json(line, here, LogError)
            self.measurements.append(validation.validate(Measurement, content, LogError, here))
            if (given := self.measurements[-1].number) != number:
                raise LogError(f"{here}: damaged (force {given} where {number} is due); name another folder")
        if (kept := "\n".join([first, *lines, ""])) != text:
            writing.write_text(path, kept)

    def add(self, measurement: Measurement) -> None:
        """Store a measurement on the disk, unless it is stored already."""
        if measurement.number < len(self.measurements):
            return
        assert measurement.number == len(self.measurements)
        self.measurements.append(measurement)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(measurement)) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise LogError(f"{self.path}: cannot be written ({error.strerror}); free disk space") from None


def validate(
    plan: ValidationPlan,
    folder: Path,
    opened: tuple[ModuleGroup, ForceSensor] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[str, Any], list[Measurement]]:
    """Measure all remaining forces; return the setup and the measurements, fewer if a signal ended it.

    A simulated rig is deterministic, and repeats all forces without recording the first ones again: friction
    remembers, so that each force depends a little on those before. Real modules repeat the last force, and
    continue from there.

    The folder keeps the measurements. ``opened`` are real modules and their sensor, or those of another process;
    without them, they are simulated in this process. ``progress`` receives the share of forces measured. Raises
    `RigError` if the rig does not hold a point in space, and `HardwareError` for an error of modules, sensor or
    journal.
    """
    require_point(plan.rig)
    writing.make_folder(folder)
    setup = plan.setup(simulated=opened is None or opened[1].simulated)
    journal = Journal(folder / JOURNAL_FILE, setup)
    total = len(plan.protocol.forces)
    done = len(journal.measurements)
    if done == total:
        return setup, journal.measurements

    def keep(measurement: Measurement) -> None:
        journal.add(measurement)
        if progress is not None:
            progress((measurement.number + 1) / total)

    if opened is None:
        assert plan.preset is not None
        errors = draw_errors(PRESETS[plan.preset], plan.rig.m, plan.seed)
        modules, clock, sensor = simulated_setup(plan.rig, errors, plan.seed)
        measure(plan.rig, modules, clock, sensor, plan.solver, plan.protocol, keep)
        modules.close()
    else:
        group, real_sensor = opened
        real_time, first = RealClock(group.clients), max(done - 1, 0)
        measure(plan.rig, group, real_time, real_sensor, plan.solver, plan.protocol, keep, first)
    return setup, journal.measurements
