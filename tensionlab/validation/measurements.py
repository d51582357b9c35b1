"""Measurements of a haptic device: forces that a rig renders in a run, and what its force sensor says to them.

Each measurement is a generator of the demands of a run, one a cycle, that returns what it found. It does not know
whether modules, sensor and hand are simulated.

What is measured follows Samur 2012, "Performance metrics for haptic interfaces"; the region of stable walls is the
Z-width of Colgate and Brown 1994, "Factors affecting the Z-width of a haptic display".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from tensionlab.demand import Demand, Impedance, RigState
from tensionlab.hardware.calibration.gain import fit
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.validation.protocol import EARLY_S
from tensionlab.validation.sensors import UPRIGHT, ForceSensor

T = TypeVar("T")
Measuring = Generator[Demand, None, T]  # demands of a run, and the result at its end
SETTLE_S = 0.3  # time after a change that is not evaluated
HALF_POWER = math.sqrt(0.5)  # gain at the bandwidth, -3 dB
AVERAGE_S = (-0.01, 0.01)  # window over which the sensor is averaged: cogging makes it shake
SLOW_SHARE = 0.2  # of the fastest motion: friction of slower ones has no clear direction
CENTRING_N_M = 15.0  # spring that keeps a hand near the rig's home across the wall's axis
PULSE_NS = 0.05  # push that starts the motion at a wall
PUSH_S, REST_S, TRIAL_S = 0.1, 0.8, 3.0  # durations: of that push, before it, and of the trial
SUSTAINED_1_S = -0.03  # growth from which a swing counts as sustained
MAX_SWING_M = 0.05  # deflection at which a trial ends as unstable
STILL_M = 5e-4  # deflection below which a hand is at rest
FIRST_STIFFNESS_N_M, MAX_STIFFNESS_N_M = 50.0, 3200.0
RESOLUTION, MAX_TRIALS = 1.05, 12  # ratio of the stiffnesses between which the boundary is, and limit of trials


class Samples(NamedTuple):
    """Part of a run."""

    times: Floats  # (K,) in s
    forces: Floats  # of the sensor, (K, 3) in N, in the rig's axes
    states: list[RigState]  # of the cycles

    def settled(self) -> Samples:
        """Return the samples without those just after the beginning."""
        late = self.times > SETTLE_S
        return self._replace(times=self.times[late], forces=self.forces[late])


class Reports(NamedTuple):
    """Reports of the modules, K of them, and the sensor's forces at the same times, in SI units."""

    times: Floats  # (K,)
    positions: Floats  # (K, 3)
    velocities: Floats  # (K, 3)
    structures: Floats  # structure matrices (K, 3, m)
    tensions: Floats  # (K, m)
    speeds: Floats  # of paying out, (K, m)
    forces: Floats  # (K, 3), averaged over `AVERAGE_S`


class Recorder:
    """State of the latest cycle of a run, and the sensor's samples since the cycle before.

    ``zero`` (3,) is the sensor's reading without a force, ``rotation`` leads from the upright sensor's axes to the
    rig's, ``latency`` in s is that of the links, one way.
    """

    def __init__(self, sensor: ForceSensor, zero: Floats, rotation: Floats, latency: float) -> None:
        self._sensor, self._zero, self._rotation = sensor, zero, rotation @ UPRIGHT
        self._latency = latency
        self.delays: list[Floats] = []  # of the loop, (m,) in s, cycle by cycle
        self.state: RigState
        self._times, self._forces = np.empty(0), np.empty((0, 3))

    def observe(self, state: RigState) -> None:
        """Take over the state of a cycle, and read the sensor."""
        previous_time = getattr(self, "state", state).time
        self.state = state
        self.delays.append(state.delays)
        self._forces = (self._sensor.take() - self._zero) @ self._rotation.T
        self._times = np.linspace(previous_time, state.time, len(self._forces) + 1)[1:]

    def align(self, rotation: Floats) -> None:
        """Turn all later forces by one more rotation (3, 3)."""
        self._rotation = rotation @ self._rotation

    def render(
        self, demand: Callable[[float], Demand], seconds: float, ends: Callable[[], bool] = lambda: False
    ) -> Measuring[Samples]:
        """Render a demand of the time since now, for some seconds or until it ends, and return the samples."""
        start = self.state.time
        times, forces, states = [np.empty(0)], [np.empty((0, 3))], []
        while self.state.time - start < seconds - EARLY_S and not ends():
            states.append(self.state)
            yield demand(self.state.time - start)
            times.append(self._times - start)
            forces.append(self._forces)
        return Samples(np.concatenate(times), np.concatenate(forces), states)

    def reports(self, rig: Rig, samples: Samples) -> Reports:
        """Return what modules and sensor measured at the same times."""
        states = samples.states
        time, age = np.array([(state.time - states[0].time, state.ages.mean()) for state in states]).T
        place = np.array([state.pose.position for state in states])
        twist, tensions, speeds = (
            np.array([getattr(state, name) for state in states]) for name in ("twist", "tensions", "speeds")
        )
        times, positions = time - age - self._latency, place - age[:, None] * twist
        sums = np.cumsum(samples.forces, axis=0)
        early, late = (np.searchsorted(samples.times, times + half).clip(1, len(sums)) - 1 for half in AVERAGE_S)
        forces = (sums[late] - sums[early]) / np.maximum(late - early, 1)[:, None]
        frames = states[0].pose.frames
        return Reports(
            times, positions, twist, rig.structure_matrix(positions, frames=frames), tensions, speeds, forces
        )


class StaticForce(NamedTuple):
    """Desired and measured force (3,) in N, and the place of the sensor (3,) in m, held and by lengths."""

    desired: Floats
    measured: Floats
    position: Floats
    found: Floats


def constant(demand: Demand) -> Callable[[float], Demand]:
    """Return a demand that stays the same."""
    return lambda time: demand


def static_forces(
    recorder: Recorder, position: Floats, forces: Floats, hold: float
) -> Measuring[list[StaticForce]]:
    """Hold forces (K, 3) in N one after another; the sensor is at the position (3,) in m."""
    held = []
    for force in forces:
        samples = yield from recorder.render(constant(Demand(force)), hold)
        average = samples.settled().forces.mean(axis=0)
        held.append(StaticForce(force, average, position, recorder.state.pose.position))
    return held


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Measured per desired amplitude of a force, by frequency in Hz."""

    frequencies: Floats
    gains: Floats

    @property
    def bandwidth(self) -> float:
        """Frequency in Hz from which the gain is below -3 dB; infinite if that is beyond the highest one."""
        below = np.flatnonzero(self.gains < HALF_POWER)
        if not len(below):
            return math.inf
        after = int(below[0])
        if after == 0:
            return float(self.frequencies[0])
        near = slice(after - 1, after + 1)
        gains, logs = self.gains[near], np.log(self.frequencies[near])
        return float(np.exp(np.interp(-HALF_POWER, -gains, logs)))


def sine_amplitude(times: Floats, values: Floats, frequency: float, *others: float) -> float:
    """Return the amplitude of one frequency in values (K,) by least squares; ``others`` may be in them, too."""
    phases = 2.0 * math.pi * np.outer(times, [frequency, *others])
    rows = np.column_stack([np.sin(phases), np.cos(phases), np.ones(len(times))])
    parts = fit(rows, values).coefficients
    return math.hypot(parts[0], parts[1 + len(others)])


def force_response(
    recorder: Recorder, axis: Floats, amplitude: float, frequencies: Floats, rate: float
) -> Measuring[FrequencyResponse]:
    """Render a force that swings along an axis, as a host does: one value a cycle, ``rate`` times a second."""

    def swing(frequency: float) -> Callable[[float], Demand]:
        return lambda time: Demand(amplitude * math.sin(2.0 * math.pi * frequency * time) * axis)

    return (yield from _response(recorder, swing, axis, amplitude, frequencies, rate))


def vibration_response(
    recorder: Recorder, rig: Rig, module: str, amplitude: float, frequencies: Floats
) -> Measuring[FrequencyResponse]:
    """Have a module render a vibration at its own rate, while the others hold the balance."""
    index = [candidate.name for candidate in rig.modules].index(module)
    length, pull = float(recorder.state.lengths[index]), rig.modules[index].lower + 4.0 * amplitude

    def vibrate(frequency: float) -> Callable[[float], Demand]:
        impedance = Impedance(length, feed_forward=pull, amplitude=amplitude, frequency=frequency)
        return constant(Demand(np.zeros(rig.n), {module: impedance}))

    along = recorder.state.structure[:, index]
    return (yield from _response(recorder, vibrate, along, amplitude, frequencies))


def _response(
    recorder: Recorder,
    demand: Callable[[float], Callable[[float], Demand]],
    along: Floats,
    amplitude: float,
    frequencies: Floats,
    rate: float | None = None,
) -> Measuring[FrequencyResponse]:
    """Measure the gain of demands by frequency; those of a host also have an image below its rate."""
    gains = []
    for frequency in frequencies.tolist():
        seconds = SETTLE_S + max(0.7, 3.0 / frequency)
        samples = (yield from recorder.render(demand(frequency), seconds)).settled()
        images = [] if rate is None else [rate - frequency]
        gains.append(sine_amplitude(samples.times, samples.forces @ along, frequency, *images) / amplitude)
    return FrequencyResponse(frequencies, np.array(gains))


@dataclass(frozen=True, eq=False)
class StepResponse:
    """Force (K,) in N along an axis at times (K,) in s after a step."""

    times: Floats
    force: Floats

    @property
    def _share(self) -> Floats:
        steady = self.force[self.times > 0.6 * self.times[-1]].mean()
        return np.asarray(self.force / steady)

    @property
    def latency(self) -> float:
        """Time in s from the command to a tenth of the step."""
        return self._reaches(0.1)

    @property
    def rise(self) -> float:
        """Time in s from a tenth to nine tenths of the step."""
        return self._reaches(0.9) - self._reaches(0.1)

    @property
    def overshoot(self) -> float:
        """Share of the step by which the force exceeds it."""
        return float(self._share.max()) - 1.0

    def _reaches(self, share: float) -> float:
        return float(self.times[int(np.argmax(self._share >= share))])


def step_response(recorder: Recorder, axis: Floats, size: float) -> Measuring[StepResponse]:
    """Render no force, and then one along an axis."""
    baseline = yield from recorder.render(constant(Demand(0.0 * axis)), 2.0 * SETTLE_S)
    after = yield from recorder.render(constant(Demand(size * axis)), 2.0 * SETTLE_S)
    return StepResponse(after.times, (after.forces - baseline.settled().forces.mean(axis=0)) @ axis)


@dataclass(frozen=True)
class BackdriveImpedance:
    """What each cable adds to a motion, the same for all cables."""

    friction: float  # in N
    damping: float  # in N s/m
    mass: float  # in kg
    tension: float  # the lowest, in N

    def along(self, structure: Floats, axis: Floats) -> tuple[float, float, float]:
        """Return friction, damping and mass that a hand feels along an axis, given the structure matrix (3, m)."""
        parts = np.abs(axis @ structure)
        square = float(parts @ parts)
        return self.friction * float(parts.sum()), self.damping * square, self.mass * square


def free_motion(recorder: Recorder, rig: Rig, seconds: float) -> Measuring[BackdriveImpedance]:
    """Render no force while a hand moves the sensor to and fro, along one axis after another."""
    samples = yield from recorder.render(constant(Demand(np.zeros(3))), seconds)
    reports = recorder.reports(rig, samples)
    accelerations = np.gradient(reports.speeds, reports.times, axis=0)
    pace = np.linalg.norm(reports.velocities, axis=1)
    used = (pace > SLOW_SHARE * pace.max()) & (reports.times > SETTLE_S)
    ways = reports.velocities / np.where(used, pace, 1.0)[:, None]
    shares = np.einsum("kd,kdm->km", ways, reports.structures)
    parts = (np.sign(reports.speeds), reports.speeds, accelerations)
    rows = np.column_stack([*(np.sum(shares * part, axis=1) for part in parts), ways])
    values = np.sum(ways * reports.forces, axis=1) - np.sum(shares * reports.tensions, axis=1)
    friction, damping, mass = fit(rows[used], values[used]).coefficients[:3].tolist()
    return BackdriveImpedance(friction, damping, mass, float(reports.tensions.min()))


@dataclass(frozen=True)
class WallTrial:
    """Spring and damper that a hand was pushed against, and how it swung."""

    stiffness: float  # in N/m
    damping: float  # in N s/m
    growth: float  # rate at which the swing grows, in 1/s
    # What the rig adds to the hand in addition to the spring, in N s/m, by the energy that a passivity observer
    # counts: below zero, the spring gives energy.
    added_damping: float

    @property
    def stable(self) -> bool:
        """Whether the swing dies out; one that neither grows nor dies out does not."""
        return self.growth < SUSTAINED_1_S


def wall_trial(
    recorder: Recorder, rig: Rig, axis: Floats, wall: tuple[float, float], limit: float
) -> Measuring[WallTrial]:
    """Push a hand against a spring and damper about the rig's home, and observe the energy that it is given.

    ``wall`` is stiffness and damping, ``limit`` the largest force in N.
    """
    stiffness, damping = wall
    home = rig.home

    def demand(time: float) -> Demand:
        state = recorder.state
        offset = state.pose.position - home
        along = float(offset @ axis)
        spring = -stiffness * along - damping * float(state.twist @ axis)
        push = PULSE_NS / PUSH_S if time < PUSH_S else 0.0
        across = -CENTRING_N_M * (offset - along * axis)
        return Demand((float(np.clip(spring, -limit, limit)) + push) * axis + across)

    def swings_far() -> bool:
        return abs(float((recorder.state.pose.position - home) @ axis)) > MAX_SWING_M

    yield from recorder.render(lambda _: Demand(-CENTRING_N_M * (recorder.state.pose.position - home)), REST_S)
    samples = yield from recorder.render(demand, TRIAL_S, swings_far)
    reports = recorder.reports(rig, samples)
    reports = Reports(*(values[reports.times > PUSH_S + SETTLE_S / 2.0] for values in reports))
    times, place, speed = reports.times, (reports.positions - home) @ axis, reports.velocities @ axis
    given = float(np.sum((reports.forces @ axis + stiffness * place) * speed))
    pace = float(np.mean(speed**2)) / max(float(np.var(place)), 1e-12)
    swing = np.sqrt((place - place.mean()) ** 2 + speed**2 / max(pace, 1e-12))
    half = len(swing) // 2
    growth = float(np.log(np.mean(swing[half:]) / np.mean(swing[:half])) / (times[half] - times[0]))
    if swings_far():
        growth = max(growth, -SUSTAINED_1_S)
    elif swing[half:].max() < STILL_M:
        growth = min(growth, 2.0 * SUSTAINED_1_S)
    return WallTrial(stiffness, damping, growth, -given / max(float(np.sum(speed**2)), 1e-12))


def wall_boundary(
    recorder: Recorder, rig: Rig, axis: Floats, damping: float, limit: float
) -> Measuring[list[WallTrial]]:
    """Find the largest stable stiffness by bisection; the trials are sorted by stiffness."""
    stiffness, below, above = FIRST_STIFFNESS_N_M, 0.0, math.inf
    trials: list[WallTrial] = []
    while len(trials) < MAX_TRIALS and above > below * RESOLUTION and stiffness <= MAX_STIFFNESS_N_M:
        trial = yield from wall_trial(recorder, rig, axis, (stiffness, damping), limit)
        trials.append(trial)
        below, above = (stiffness, above) if trial.stable else (below, stiffness)
        stiffness = 2.0 * below if above == math.inf else above / 2.0 if below == 0.0 else math.sqrt(below * above)
    return sorted(trials, key=lambda trial: trial.stiffness)
