"""Characterisation of a rig as a haptic device: what papers on devices report, measured one after another.

The sensor is held at the rig's home and at positions around it, then moved to and fro, then held loosely. On a
simulated rig this is a matter of motions; on a real one, a person is asked for it before each part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import product

import numpy as np

from tensionlab.allocation import allocate
from tensionlab.demand import Demand, Pose, RigState
from tensionlab.errors import RigError
from tensionlab.hardware.client import diagnostics
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import Clock, RunSettings
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import Motion
from tensionlab.model.rig import Rig
from tensionlab.model.stiffness import HAND_DAMPING
from tensionlab.scenarios.person import Person, PersonPlan, Script, Waypoint
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.validation import measurements
from tensionlab.validation.error_model import PRESETS, draw_errors, require_point
from tensionlab.validation.measurements import (
    FeltImpedance,
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
from tensionlab.validation.statistics import fit_yaw

PINGS = 20  # to each module
DIRECTIONS = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(way) in (1, 3)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]  # the axes and the diagonals, both ways
MOTION_M, MOTION_HZ, MOTION_S = 0.05, 1.0, 4.0  # of a hand along each axis: amplitude, frequency, duration
HAND_MASS_KG = 1.0  # of the simulated hand at walls: theory is of a heavy one
WALL_DAMPINGS_NS_M = (0.0, 1.0, 2.0)
VIBRATIONS_HZ = np.array([10.0, 20.0, 40.0, 60.0, 80.0, 100.0, 150.0, 200.0, 300.0])
RATE_SHARES = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.36, 0.4, 0.44, 0.48])  # frequencies per rate of a host
# Requests to the person who holds the sensor of a real rig.
HOLD = "fix the sensor, its Z axis up, with the handle at {} m"
MOVE = "hold the handle by the sensor at home; then move it by 5 cm once a second, for 4 s along each of x, y, z"
LOOSE = "hold the handle loosely by the sensor, at home: stiff springs will shake it along {}"


@dataclass(frozen=True, eq=False)
class CharacterisationPlan:
    """Rig and sizes: forces held, steps and vibrations in N, distance of positions from home in m, time held in s.

    The conditions of the links, hardware parameters (as in `PLANT`) and the seed are those of a simulated rig.
    """

    rig: Rig
    rate: float = 50.0
    force: float = 1.5
    step: float = 0.5
    amplitude: float = 0.3
    reach: float = 0.1
    hold: float = 0.6
    conditions: Conditions = field(default_factory=Conditions)
    plant: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0


Steps = dict[str, StepResponse]  # by axis
Responses = dict[str, FrequencyResponse]  # by axis or module
# Opens modules, their clock and the sensor: for a request to a person, or a simulated motion.
Bench = Callable[[str, Motion | None], tuple[ModuleGroup, Clock, ForceSensor]]


@dataclass(frozen=True, eq=False)
class Characterisation:
    """What was measured; by axis, "x", "y" and "z", where it is not of the whole rig.

    ``round_trips`` are those of pings and ``delays`` from a set-point to its report, in s. ``vibrations`` are by
    module; ``felt_along`` has friction, damping and inertia; ``walls`` are by damping, along ``wall_axis``.
    """

    plan: CharacterisationPlan
    simulated: bool
    round_trips: Floats
    delays: Floats
    static: list[StaticForce]
    steps: Steps
    responses: Responses
    vibrations: Responses
    felt: FeltImpedance
    felt_along: dict[str, tuple[float, float, float]]
    walls: dict[float, list[WallTrial]]
    wall_axis: str

    @property
    def title(self) -> str:
        """Rig and kind."""
        return f"{self.plan.rig.name}, {'simulated' if self.simulated else 'measured'}"


def simulated_bench(plan: CharacterisationPlan) -> Bench:
    """Return the bench of a simulated rig without errors of calibration."""
    errors = draw_errors(PRESETS["ideal"], plan.rig.m, plan.seed)
    plants = {module.name: plan.plant for module in plan.rig.modules}
    return lambda request, motion: simulated_setup(plan.rig, errors, plan.seed, motion, plants, plan.conditions)


def to_and_fro(rig: Rig) -> Motion:
    """Return the motion of a hand along one axis after another, each from rest to rest."""

    def pose(time: float) -> Pose:
        turn, since = divmod(time, MOTION_S)
        swing = math.sin(math.pi * since / MOTION_S) ** 2 * math.sin(2.0 * math.pi * MOTION_HZ * since)
        return Pose(rig.home + MOTION_M * swing * np.eye(3)[int(turn) % 3], frames=rig.at_rest)

    return pose


def loose_hand(rig: Rig) -> Motion:
    """Return the motion of a hand with mass and damping alone."""
    script = Script((Waypoint(0.0, tuple(rig.home.tolist())),))
    hand = Person(PersonPlan(HAND_MASS_KG, 1e-6, HAND_DAMPING, script), rig)
    hand.begin()
    return hand


def feasible_axes(plan: CharacterisationPlan) -> dict[str, Floats]:
    """Return the axes along which steps can be rendered both ways at home; `RigError` if there is none."""
    rig = plan.rig
    require_point(rig)
    forces = plan.step * np.concatenate([np.eye(3), -np.eye(3)])
    found = allocate(rig.structure_matrix(rig.home, frames=rig.at_rest), forces, rig.limits)
    both = np.all((found.status == Status.EXACT).reshape(2, 3), axis=0)
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
    simulated, bench = bench is None, bench or simulated_bench(plan)
    home = rig.structure_matrix(rig.home, frames=rig.at_rest)
    offsets = [np.zeros(3), *(sign * plan.reach * axis for axis in np.eye(3) for sign in (-1.0, 1.0))]
    wall_axis, along = next(iter(axes.items()))
    delays: list[Floats] = []
    trips: list[float] = []
    rotation, done = np.eye(3), 0

    def run(request: str, motion: Motion, measuring: Callable[[Recorder], Measuring[T]]) -> T:
        nonlocal done
        modules, clock, sensor = bench(request, motion)
        if not trips:
            trips.extend(t for each in modules.clients for t in diagnostics.measure(each, PINGS, bool).times)
        latency = float(np.median(trips)) / 2.0
        recorder = Recorder(sensor, read_zero(modules, clock, sensor), rotation, latency)
        found = run_measurement(plan, modules, clock, recorder, measuring(recorder))
        delays.extend(recorder.delays)
        done += 1
        progress(done / (len(offsets) + 2))
        return found

    def hold(offset: Floats, measuring: Callable[[Recorder], Measuring[T]]) -> T:
        place = rig.home + offset
        text = HOLD.format(", ".join(f"{part:.3f}" for part in place))
        return run(text, lambda time: Pose(place, frames=rig.at_rest), measuring)

    rotation, held, steps, responses, vibrations = hold(offsets[0], partial(_at_home, plan, axes))
    for offset in offsets[1:]:
        held += hold(offset, partial(_static, plan, offset=offset))
    felt = run(MOVE, to_and_fro(rig), lambda recorder: measurements.free_motion(recorder, rig, 3.0 * MOTION_S))
    walls = run(LOOSE.format(wall_axis), loose_hand(rig), partial(_at_walls, plan, along))
    felt_along = {name: felt.along(home, axis) for name, axis in axes.items()}
    return Characterisation(
        plan, simulated, np.array(trips), np.array(delays), held, steps, responses, vibrations, felt, felt_along,
        walls, wall_axis,
    )  # fmt: skip


def _static(plan: CharacterisationPlan, recorder: Recorder, offset: Floats) -> Measuring[list[StaticForce]]:
    """Measure the forces that the rig can hold at an offset from its home, in all directions."""
    rig = plan.rig
    structure = rig.structure_matrix(rig.home + offset, frames=rig.at_rest)
    exact = allocate(structure, plan.force * DIRECTIONS, rig.limits).status == Status.EXACT
    return measurements.static_forces(recorder, rig.home + offset, plan.force * DIRECTIONS[exact], plan.hold)


def _at_home(
    plan: CharacterisationPlan, axes: dict[str, Floats], recorder: Recorder
) -> Measuring[tuple[Floats, list[StaticForce], Steps, Responses, Responses]]:
    """Measure how the sensor is turned, and all that is measured at home alone."""
    rig, held = plan.rig, (yield from _static(plan, recorder, np.zeros(3)))
    turn = fit_yaw(np.array([each.desired for each in held]), np.array([each.measured for each in held]))
    recorder.align(turn)
    held = [each._replace(measured=turn @ each.measured) for each in held]
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    steps: Steps = {}
    responses: Responses = {}
    vibrations: Responses = {}
    for name, axis in axes.items():
        steps[name] = yield from measurements.step_response(recorder, axis, plan.step)
        responses[name] = yield from measurements.force_response(
            recorder, axis, plan.amplitude, plan.rate * RATE_SHARES, plan.rate
        )
        best = rig.modules[int(np.argmax(np.abs(axis @ structure)))].name
        if best not in vibrations:
            vibrations[best] = yield from measurements.vibration_response(
                recorder, rig, best, plan.amplitude, VIBRATIONS_HZ
            )
    return turn, held, steps, responses, vibrations


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
