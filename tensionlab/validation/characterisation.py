"""Characterisation of a rig as a haptic device: what papers on devices report, measured one after another.

The sensor is held at the rig's home and at positions around it, then moved to and fro, then held loosely. On a
simulated rig this is a matter of motions; on a real one, a person is instructed before each part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import product

import numpy as np

from tensionlab.allocation import allocate
from tensionlab.demand import Demand, RigState
from tensionlab.errors import RigError
from tensionlab.hardware.client import diagnostics
from tensionlab.hardware.client.group import ModuleGroup, temporary_slew
from tensionlab.hardware.protocol.codes import PARAMETERS
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import Clock, RunSettings
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.validation import measurements
from tensionlab.validation.error_model import PRESETS, draw_errors, require_point
from tensionlab.validation.measurements import (
    BackdriveImpedance,
    FrequencyResponse,
    Measuring,
    Recorder,
    StaticForce,
    StepResponse,
    T,
    WallTrial,
)  # fmt: skip
from tensionlab.validation.protocol import has_completed, read_zero
from tensionlab.validation.sensors import ForceSensor, simulated_setup
from tensionlab.validation.simulated_hand import MOTION_S, HandRequest
from tensionlab.validation.statistics import fit_yaw

PINGS = 20  # to each module
DIRECTIONS = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(way) in (1, 3)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]  # the axes and the diagonals, both ways
OFFSETS = np.array([sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)])  # of positions, per reach
WALL_DAMPINGS_NS_M = (0.0, 1.0, 2.0)
# Closer where a spool resonates on its cable; the slew-rate limit does not bound them.
VIBRATIONS_HZ = np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 100.0, 150.0, 200.0, 300.0])
VIBRATION_SLEW_N_S = PARAMETERS["slew"].upper
RATE_SHARES = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.36, 0.4, 0.44, 0.48])  # frequencies per rate of a host


@dataclass(frozen=True, eq=False)
class CharacterisationPlan:
    """Rig, and sizes of what is measured."""

    rig: Rig
    rate: float = 50.0  # of the host, in Hz
    force: float = 1.5  # that is held, in N
    step: float = 0.5  # in N
    amplitude: float = 0.3  # of vibrations, in N
    reach: float = 0.1  # distance of positions from home, in m
    hold: float = 0.6  # in s
    # Of a simulated rig: the links, hardware parameters as in `PLANT`, and the seed.
    conditions: Conditions = field(default_factory=Conditions)
    plant: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0


Steps = dict[str, StepResponse]  # by axis
Responses = dict[str, FrequencyResponse]  # by axis or module
# Opens modules, their clock and the sensor, which is held as requested.
Bench = Callable[[HandRequest], tuple[ModuleGroup, Clock, ForceSensor]]


@dataclass(frozen=True, eq=False)
class Characterisation:
    """What was measured; by axis, "x", "y" and "z", where it is not of the whole rig."""

    plan: CharacterisationPlan
    simulated: bool
    round_trips: Floats  # of pings, in s
    delays: Floats  # from a set-point to its report, in s
    static: list[StaticForce]
    steps: Steps
    responses: Responses
    vibrations: Responses  # by module
    backdrive: BackdriveImpedance
    backdrive_along: dict[str, tuple[float, float, float]]  # friction, damping and inertia
    walls: dict[float, list[WallTrial]]  # by damping, along `wall_axis`
    wall_axis: str

    @property
    def title(self) -> str:
        """Rig and kind."""
        return f"{self.plan.rig.name}, {'simulated' if self.simulated else 'measured'}"


def simulated_bench(plan: CharacterisationPlan) -> Bench:
    """Return the bench of a simulated rig without errors of calibration."""
    errors = draw_errors(PRESETS["ideal"], plan.rig.m, plan.seed)
    plants = {module.name: plan.plant for module in plan.rig.modules}
    return lambda request: simulated_setup(
        plan.rig, errors, plan.seed, request.motion(plan.rig), plants, plan.conditions
    )


def feasible_axes(plan: CharacterisationPlan) -> dict[str, Floats]:
    """Return the axes along which steps can be rendered both ways at home; `RigError` if there is none."""
    rig = plan.rig
    require_point(rig)
    forces = plan.step * np.concatenate([np.eye(3), -np.eye(3)])
    allocation = allocate(rig.structure_matrix(rig.home, frames=rig.at_rest), forces, rig.limits)
    both = np.all((allocation.status == Status.EXACT).reshape(2, 3), axis=0)
    if not both.any():
        problem = f"cannot pull with {plan.step:g} N both ways along any axis at its home"
        raise RigError(f'rig "{rig.name}" {problem}; see `tensionlab rig check`')
    return {name: axis for name, axis, possible in zip("xyz", np.eye(3), both, strict=True) if possible}


def characterise(
    plan: CharacterisationPlan,
    bench: Bench | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Characterisation:
    """Measure a rig as a haptic device, on a bench: the simulated one of the plan if left out.

    KeyboardInterrupt if a signal ended a part of it, `RigError` for a rig that cannot be characterised, and
    `HardwareError` of modules or sensor.
    """
    rig, axes = plan.rig, feasible_axes(plan)
    bench, simulated = bench or simulated_bench(plan), True
    home = rig.structure_matrix(rig.home, frames=rig.at_rest)
    offsets = [np.zeros(3), *(plan.reach * OFFSETS)]
    wall_axis, along = next(iter(axes.items()))
    delays: list[Floats] = []
    trips: list[float] = []
    rotation, done = np.eye(3), 0

    def run(
        grip: str,
        measuring: Callable[[Recorder], Measuring[T]],
        offset: Floats = offsets[0],
        slew: float | None = None,
    ) -> T:
        nonlocal done, simulated
        modules, clock, sensor = bench(HandRequest(grip, rig.home + offset))
        simulated = sensor.simulated
        if not trips:
            times = np.concatenate([diagnostics.measure(client, PINGS, bool) for client in modules.clients])
            trips.extend(times[np.isfinite(times)])
        zero = read_zero(modules, clock, sensor)
        recorder = Recorder(sensor, zero, rotation, float(np.median(trips)) / 2.0)
        with temporary_slew(modules, slew):
            result = run_measurement(plan, modules, clock, recorder, measuring(recorder))
        delays.extend(recorder.delays)
        done += 1
        progress(done / (len(offsets) + 3))
        return result

    rotation, held, steps, responses = run("hold", partial(_at_home, plan, axes))
    vibrations = run("hold", partial(_vibrations, plan, axes), slew=VIBRATION_SLEW_N_S)
    for offset in offsets[1:]:
        held += run("hold", partial(_static, plan, offset=offset), offset)
    backdrive = run("move", lambda recorder: measurements.free_motion(recorder, rig, 3.0 * MOTION_S))
    walls = run("loose", partial(_at_walls, plan, along))
    backdrive_along = {name: backdrive.along(home, axis) for name, axis in axes.items()}
    return Characterisation(
        plan, simulated, np.array(trips), np.array(delays), held, steps, responses, vibrations, backdrive,
        backdrive_along, walls, wall_axis,
    )  # fmt: skip


def _static(plan: CharacterisationPlan, recorder: Recorder, offset: Floats) -> Measuring[list[StaticForce]]:
    """Measure the forces that the rig can hold at an offset from its home, in all directions."""
    rig = plan.rig
    structure = rig.structure_matrix(rig.home + offset, frames=rig.at_rest)
    exact = allocate(structure, plan.force * DIRECTIONS, rig.limits).status == Status.EXACT
    return measurements.static_forces(recorder, rig.home + offset, plan.force * DIRECTIONS[exact], plan.hold)


def _at_home(
    plan: CharacterisationPlan, axes: dict[str, Floats], recorder: Recorder
) -> Measuring[tuple[Floats, list[StaticForce], Steps, Responses]]:
    """Measure how the sensor is turned, and all that is measured at home alone."""
    held = yield from _static(plan, recorder, np.zeros(3))
    turn = fit_yaw(np.array([force.desired for force in held]), np.array([force.measured for force in held]))
    recorder.align(turn)
    held = [force._replace(measured=turn @ force.measured) for force in held]
    steps: Steps = {}
    responses: Responses = {}
    for name, axis in axes.items():
        steps[name] = yield from measurements.step_response(recorder, axis, plan.step)
        responses[name] = yield from measurements.force_response(
            recorder, axis, plan.amplitude, plan.rate * RATE_SHARES, plan.rate
        )
    return turn, held, steps, responses


def _vibrations(plan: CharacterisationPlan, axes: dict[str, Floats], recorder: Recorder) -> Measuring[Responses]:
    """Measure the gain of vibrations by frequency for the module that is best along each axis."""
    rig = plan.rig
    vibrations: Responses = {}
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    for axis in axes.values():
        best = rig.modules[int(np.argmax(np.abs(axis @ structure)))].name
        if best not in vibrations:
            vibrations[best] = yield from measurements.vibration_response(
                recorder, rig, best, plan.amplitude, VIBRATIONS_HZ
            )
    return vibrations


def _at_walls(
    plan: CharacterisationPlan, along: Floats, recorder: Recorder
) -> Measuring[dict[float, list[WallTrial]]]:
    """Measure the boundary of stable walls along an axis for each damping."""
    walls = {}
    for damping in WALL_DAMPINGS_NS_M:
        walls[damping] = yield from measurements.wall_boundary(recorder, plan.rig, along, damping, plan.force)
    return walls


def run_measurement(
    plan: CharacterisationPlan, modules: ModuleGroup, clock: Clock, recorder: Recorder, measuring: Measuring[T]
) -> T:
    """Render a measurement in a run of its own, and return its result; KeyboardInterrupt if a signal ended it."""
    results: list[T] = []

    def demand(state: RigState) -> Demand:
        recorder.observe(state)
        try:
            return next(measuring)
        except StopIteration as end:
            results.append(end.value)
            return Demand(stop=True)

    runner = Runner(plan.rig, modules, "newton", demand, RunSettings(plan.rate), clock=clock)
    if not has_completed(runner.run()):
        raise KeyboardInterrupt
    return results[0]
