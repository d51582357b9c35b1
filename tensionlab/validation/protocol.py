"""Published protocol: zero the sensor, then hold one force after another, and average what it shows.

Everything that pulls does so through the `Runner`. The first three forces are along the axes: they show how the
sensor is turned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import allocate
from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import HardwareError, InputError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.codes import Limit
from tensionlab.hardware.protocol.parameters import PARAMETERS
from tensionlab.hardware.runner.records import DEMAND_STOPPED, Cycle
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import Clock, RunSettings
from tensionlab.hardware.simulation.world import newton_per_ampere
from tensionlab.model.directions import grid18
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Solver, Status
from tensionlab.support.arrays import Floats
from tensionlab.validation.sensors import ForceSensor

CONTINUOUS_CURRENT_A = PARAMETERS["current_continuous"].standard  # continuous rating of a winding's current
AXIS_FORCES = 3  # number of forces along the axes, which come first
ZERO_S = 1.0  # time for which the sensor is averaged with all motors off
# Shares of a winding's budget: when modules are to rest before a force that needs more current than they bear for
# ever, and until when. 6 N take 0.17 of it in a second, and are to be had up to 0.7.
HOT, COOL = 0.5, 0.4
EARLY_S = 1e-6  # time by which a cycle may begin too early


@dataclass(frozen=True, eq=False)
class Protocol:
    """Directions (K, 3) that are commanded one after another, with forces of one size in N.

    Each is held for some s, of which the first, while tensions move, are left out of the average.
    """

    hold: float = 1.0
    settle: float = 0.3
    force: float = 1.5
    directions: Floats = field(default_factory=grid18)

    def __post_init__(self) -> None:
        if not 0.0 <= self.settle < self.hold < np.inf:
            raise InputError(
                f"each force is held for {self.hold:g} s, of which {self.settle:g} s are left out; "
                "hold longer than that"
            )

    @property
    def forces(self) -> Floats:
        """All commanded forces, in N: (3 + K, 3), the axes first."""
        return self.force * np.concatenate([np.eye(AXIS_FORCES), self.directions])


@dataclass(frozen=True)
class Measurement:
    """Measurement of one force, ``number`` being its row of `Protocol.forces`.

    In N: the desired force, that of the commanded tensions by the nominal rig, what the sensor showed in its own
    axes less its zero, and the tensions. The status, a name of `Status`, is that of the solver's answer; with
    ``fallback_used`` it was unproven, so that the exact solver's was sent. ``spread`` is the samples' standard
    deviation in N along the axis where it is largest, ``rested`` the s for which modules had to cool before.
    ``limited_modules`` were at a limit of their own.
    """

    number: int
    desired: tuple[float, ...]
    rendered: tuple[float, ...]
    measured: tuple[float, ...]
    tensions: tuple[float, ...]
    status: str
    fallback_used: bool
    samples: int
    spread: float
    rested: float
    limited_modules: tuple[str, ...]


class ForceSequence:
    """Demand source that holds one force after another, from the row ``first`` of `Protocol.forces` on.

    Before a force that needs more than the continuous rating of a winding (where ``heating`` says so), modules
    rest at their lower limits until all are cool enough. ``on_held`` receives of each force that has been held its
    number, the samples (K, 3), and the time for which modules had to rest before it, in s.
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
        """Return the demand of this cycle; drop what the sensor showed while tensions moved."""
        now = state.time + EARLY_S
        heat = float(np.nanmax(state.thermal, initial=0.0))
        if self._resting:
            if heat > COOL:
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
            if heat > HOT and self._heating[self._number]:
                self._resting, self._since = True, now
                return Demand()
        if not self._settled and now >= self._since + self._protocol.settle:
            self._sensor.take()
            self._settled = True
        return self._demands[self._number]


def measure_zero(sensor: ForceSensor, clock: Clock, modules: ModuleGroup) -> Floats:
    """Return what the sensor shows while nothing pulls, (3,) in N; raise `HardwareError` if it shows nothing."""
    modules.stop()
    clock.wait_until(clock.now() + ZERO_S)
    sensor.take()
    clock.wait_until(clock.now() + ZERO_S)
    return _average(sensor.take(), "at zero tension")


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
    """Go through the protocol, from the row ``first`` of its forces on; each measurement is handed on at once.

    Return whether all forces were held: a signal, such as Ctrl-C, may end it before. Raise `HardwareError` of the
    modules, as from `Runner.run`, or of the sensor.
    """
    offset = measure_zero(sensor, clock, modules)
    pose = Pose(rig.home, frames=rig.at_rest)
    forces = protocol.forces

    def held(number: int, samples: Floats, rested: float) -> None:
        assert runner.latest is not None
        average = _average(samples, f"of force {number + 1} of {len(forces)}") - offset
        on_measured(_measurement(number, forces[number], average, samples, rested, runner.latest, rig))

    chosen = allocate(rig.structure_matrix(rig.home, frames=rig.at_rest), forces, rig.limits, solver=solver)
    continuous = [CONTINUOUS_CURRENT_A * newton_per_ampere(module) for module in rig.modules]
    heating = np.any(chosen.tensions > continuous, axis=-1)
    sequence = ForceSequence(protocol, heating, first, sensor, held)
    runner = Runner(rig, modules, solver, sequence, RunSettings(), clock=clock, tracker=lambda time: pose)
    runner.run()
    if runner.statistics.unconfirmed:
        names = ", ".join(runner.statistics.unconfirmed)
        raise HardwareError(f"{names} did not confirm to have stopped; look at them before anything else")
    if runner.statistics.emergency:
        raise HardwareError("an emergency stop ended the validation; `tensionlab module clear` leads out of it")
    return runner.statistics.ended == DEMAND_STOPPED


def _measurement(
    number: int, desired: Floats, average: Floats, samples: Floats, rested: float, latest: Cycle, rig: Rig
) -> Measurement:
    free = (Limit.NONE, Limit.LOWER, Limit.UPPER, Limit.IDLE)
    limits = zip(rig.modules, latest.state.limiters.tolist(), strict=True)
    return Measurement(
        number=number,
        desired=tuple(desired.tolist()),
        rendered=tuple(latest.allocation.wrench.tolist()),
        measured=tuple(average.tolist()),
        tensions=tuple(latest.commanded.tolist()),
        status=Status(int(latest.allocation.status)).name,
        fallback_used=latest.fallback_used,
        samples=len(samples),
        spread=float(samples.std(axis=0).max()),
        rested=rested,
        limited_modules=tuple(module.name for module, limit in limits if limit not in free),
    )


def _average(samples: Floats, when: str) -> Floats:
    if not len(samples):
        raise HardwareError(f"the force sensor showed nothing {when}; is it on, and does it send by itself?")
    return np.asarray(samples.mean(axis=0))
