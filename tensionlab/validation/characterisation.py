"""Characterisation of a rig as a haptic device: what papers on devices report, measured one after another.

The sensor is held at the rig's home and at positions around it, then moved to and fro, then held loosely. On a
simulated rig this is a matter of motions; on a real one, a person is asked for it before each part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
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
from tensionlab.validation.error_model import PRESETS, draw_errors, require_point, true_rig
from tensionlab.validation.measurements import (
    FeltImpedance,
    FrequencyResponse,
    Measuring,
    Recorder,
    StaticForce,
    StepResponse,
    T,
    WallTrial,
)
from tensionlab.validation.protocol import has_completed, read_zero
from tensionlab.validation.sensors import ForceSensor, simulated_setup
from tensionlab.validation.statistics import fit_yaw

Steps = dict[str, StepResponse]  # by axis
Responses = dict[str, FrequencyResponse]  # by axis or module
PINGS = 20  # to each module
DIRECTIONS = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(way) in (1, 3)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]  # the axes and the diagonals, both ways
MOTION_M, MOTION_HZ, MOTION_S = 0.05, 1.0, 4.0  # of a hand along each axis: amplitude, frequency, duration
HAND_MASS_KG = 1.0  # of the simulated hand at walls: theory is of a heavy one
WALL_DAMPINGS_NS_M = (0.0, 1.0, 2.0)
VIBRATIONS_HZ = np.array([10.0, 20.0, 40.0, 60.0, 80.0, 100.0, 150.0, 200.0, 300.0])
RATE_SHARES = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.36, 0.4, 0.44, 0.48])  # frequencies per rate of a host


@dataclass(frozen=True, eq=False)
class CharacterisationPlan:
    """Rig and sizes: forces held in N, steps and amplitudes of vibrations in N, distance of positions in m.

    ``hold`` s is the time for each force. What follows is of a simulated rig: the preset of its errors, a key of
    `PRESETS` (None: hardware as `PLANT` has it, without errors), the conditions of its links, and the seed.
    """

    rig: Rig
    rate: float = 50.0
    force: float = 1.5
    step: float = 0.5
    amplitude: float = 0.3
    reach: float = 0.1
    hold: float = 0.6
    preset: str | None = None
    conditions: Conditions = field(default_factory=Conditions)
    plant: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Characterisation:
    """What was measured; by axis, "x", "y" and "z", where it is not of the whole rig.

    ``round_trips`` are those of pings and ``delays`` from a set-point to its report, in s. ``vibrations`` are by
    module, ``walls`` by damping, along ``wall_axis``.
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


# Opens modules, their clock and the sensor: for a request to a person, or a simulated motion, given the true rig.
Bench = Callable[[str, Callable[[Rig], Motion] | None], tuple[ModuleGroup, Clock, ForceSensor]]


def simulated_bench(plan: CharacterisationPlan) -> Bench:
    """Return the bench of a simulated rig."""
    errors = draw_errors(PRESETS[plan.preset or "ideal"], plan.rig.m, plan.seed)
    real = true_rig(plan.rig, errors)
    plants = {module.name: plan.plant for module in plan.rig.modules} if plan.preset is None else None

    def open_bench(request: str, motion: Callable[[Rig], Motion] | None) -> tuple[ModuleGroup, Clock, ForceSensor]:
        moved = None if motion is None else motion(real)
        return simulated_setup(plan.rig, errors, plan.seed, moved, plants, plan.conditions)

    return open_bench


def held_at(offset: Floats) -> Callable[[Rig], Motion]:
    """Return the motion of a hand that stays at an offset (3,) in m from the rig's home."""
    return lambda rig: lambda time: Pose(rig.home + offset, frames=rig.at_rest)


def to_and_fro(rig: Rig) -> Motion:
    """Return the motion of a hand along one axis after another, each from rest to rest."""

    def pose(time: float) -> Pose:
        turn, since = divmod(time, MOTION_S)
        swing = math.sin(math.pi * since / MOTION_S) ** 2 * math.sin(2.0 * math.pi * MOTION_HZ * since)
        return Pose(rig.home + MOTION_M * swing * np.eye(3)[int(turn) % 3], frames=rig.at_rest)

    return pose


def loose_hand(rig: Rig) -> Motion:
    """Return the motion of a hand with mass and damping alone."""
    script = Script((Waypoint(0.0, tuple(rig.home.tolist())),), None)
    hand = Person(PersonPlan(HAND_MASS_KG, 1e-6, HAND_DAMPING, script), rig)
    hand.begin()
    return hand


def feasible_axes(plan: CharacterisationPlan) -> dict[str, Floats]:
    """Return the axes along which steps can be rendered both ways at home; `RigError` if there is none."""
    require_point(plan.rig)
    rig = plan.rig
    forces = plan.step * np.concatenate([np.eye(3), -np.eye(3)])
    found = allocate(rig.structure_matrix(rig.home, frames=rig.at_rest), forces, rig.limits)
    both = np.all((found.status == Status.EXACT).reshape(2, 3), axis=0)
    if not both.any():
        problem = f"cannot pull with {plan.step:g} N both ways along any axis at its home"
        raise RigError(
            f'rig "{rig.name}" {problem}, so there is nothing to characterise; see `tensionlab rig check`'
        )
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
    best = {rig.modules[int(np.argmax(np.abs(axis @ home)))].name: None for axis in axes.values()}
    offsets = [np.zeros(3), *(sign * plan.reach * axis for axis in np.eye(3) for sign in (-1.0, 1.0))]
    done, parts = 0, len(offsets) + 2
    wall_axis, along = next(iter(axes.items()))
    delays: list[Floats] = []
    trips: list[float] = []
    rotation, latency = np.eye(3), 0.0

    def run(request: str, motion: Callable[[Rig], Motion], measuring: Callable[[Recorder], Measuring[T]]) -> T:
        nonlocal done, latency
        modules, clock, sensor = bench(request, motion)
        if not trips:
            trips.extend(t for each in modules.clients for t in diagnostics.measure(each, PINGS, _more).times)
            latency = float(np.median(trips)) / 2.0
        recorder = Recorder(sensor, read_zero(modules, clock, sensor), rotation, latency)
        found = _run(plan, modules, clock, recorder, measuring(recorder))
        delays.extend(recorder.delays)
        done += 1
        progress(done / parts)
        return found

    def static(offset: Floats) -> Callable[[Recorder], Measuring[list[StaticForce]]]:
        place = rig.home + offset
        chosen = allocate(rig.structure_matrix(place, frames=rig.at_rest), plan.force * DIRECTIONS, rig.limits)
        forces = plan.force * DIRECTIONS[chosen.status == Status.EXACT]
        return lambda recorder: measurements.static_forces(recorder, place, forces, plan.hold)

    def at_home(recorder: Recorder) -> Measuring[tuple[Floats, list[StaticForce], Steps, Responses, Responses]]:
        held = yield from static(offsets[0])(recorder)
        turn = fit_yaw(np.array([each.desired for each in held]), np.array([each.measured for each in held]))
        recorder.align(turn)
        held = [each._replace(measured=turn @ each.measured) for each in held]
        steps: Steps = {}
        responses: Responses = {}
        vibrations: Responses = {}
        for name, axis in axes.items():
            steps[name] = yield from measurements.step_response(recorder, axis, plan.step)
            frequencies = plan.rate * RATE_SHARES
            responses[name] = yield from measurements.force_response(
                recorder, axis, plan.amplitude, frequencies, plan.rate
            )
        for name in best:
            vibrations[name] = yield from measurements.vibration_response(
                recorder, rig, name, plan.amplitude, VIBRATIONS_HZ
            )
        return turn, held, steps, responses, vibrations

    def at_walls(recorder: Recorder) -> Measuring[dict[float, list[WallTrial]]]:
        walls = {}
        for damping in WALL_DAMPINGS_NS_M:
            walls[damping] = yield from measurements.wall_boundary(recorder, rig, along, damping, plan.force)
        return walls

    rotation, held, steps, responses, vibrations = run(_held(rig.home), held_at(offsets[0]), at_home)
    for offset in offsets[1:]:
        held += run(_held(rig.home + offset), held_at(offset), static(offset))
    felt = run(MOVE, to_and_fro, lambda recorder: measurements.free_motion(recorder, rig, 3.0 * MOTION_S))
    walls = run(f"{LOOSE} along {wall_axis}", loose_hand, at_walls)
    return Characterisation(
        plan, simulated, np.array(trips), np.concatenate(delays), held, steps, responses, vibrations, felt,
        {name: felt.along(home, axis) for name, axis in axes.items()}, walls, wall_axis,
    )  # fmt: skip


MOVE = (
    "hold the handle by the sensor, at home; from Enter on move it to and fro by 5 cm, once a second, for 4 s "
    "along each of x, y and z"
)
LOOSE = "hold the handle loosely by the sensor, at home: it is pushed, and springs of growing stiffness shake it"


def _held(place: Floats) -> str:
    return f"fix the sensor, its Z axis up, with the handle at {', '.join(f'{part:.3f}' for part in place)} m"


def _more(count: int) -> bool:
    return True


def _run(
    plan: CharacterisationPlan, modules: ModuleGroup, clock: Clock, recorder: Recorder, measuring: Measuring[T]
) -> T:
    """Render a measurement in a run of its own, and return its result."""
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
        raise KeyboardInterrupt("nothing is kept of this characterisation")
    return results[0]
