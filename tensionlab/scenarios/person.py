"""Simulated person whose hand or head the cables hold: it follows a script, and yields to their force."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tensionlab.demand import Pose
from tensionlab.errors import ScenarioError
from tensionlab.haptics.effects import parameters
from tensionlab.model.kinematics import structure_matrix
from tensionlab.model.rig import Cables, Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import brief

# Frequency ratios of a sway's axes, so that it is a loop and no line.
AXIS_RATES = np.array([1.0, 0.83, 1.21])
MAX_STEP_S = 1e-3  # longest step of the integration
SPEED_STEP_S = 1e-4  # step of the difference that gives the script's velocity


@parameters.checked_dataclass(ScenarioError)
class Waypoint:
    """Position in m at a time in s since the start."""

    time: parameters.Time
    position: parameters.Point


@parameters.checked_dataclass(ScenarioError)
class Sway:
    """Small oscillation: amplitudes in m, one per axis, and a frequency in Hz."""

    amplitude: parameters.Point
    frequency: parameters.Frequency = 0.4


@parameters.checked_dataclass(ScenarioError)
class Script:
    """Motion through waypoints, in order of time, plus a sway.

    Between waypoints it has minimum jerk (Flash and Hogan 1985, "The coordination of arm movements"), from rest to
    rest; before the first and after the last it rests.
    """

    waypoints: tuple[Waypoint, ...]
    sway: Sway | None = None

    def __post_init__(self) -> None:
        if not self.waypoints:
            raise ScenarioError("a script has no waypoints; give at least one")
        times = [waypoint.time for waypoint in self.waypoints]
        positions = [waypoint.position for waypoint in self.waypoints]
        if (np.diff(times) <= 0.0).any():
            raise ScenarioError(f"the waypoints' times are {brief(times)}; give each later than the last")
        sizes = {len(position) for position in positions} | ({len(self.sway.amplitude)} if self.sway else set())
        if len(sizes) > 1:
            raise ScenarioError(
                f"the waypoints are {brief(positions)}; give all the same number of coordinates, and the sway too"
            )

    @cached_property
    def _path(self) -> tuple[list[float], list[Floats]]:
        return [point.time for point in self.waypoints], [np.array(point.position) for point in self.waypoints]

    def position(self, time: float) -> Floats:
        """Return the position in m at a time in s."""
        times, positions = self._path
        latest = bisect_right(times, time) - 1
        if 0 <= latest < len(times) - 1:
            share = (time - times[latest]) / (times[latest + 1] - times[latest])
            way = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            position = (1.0 - way) * positions[latest] + way * positions[latest + 1]
        else:
            position = positions[max(latest, 0)].copy()
        if self.sway is not None:
            phases = 2.0 * math.pi * self.sway.frequency * time * AXIS_RATES[: position.size]
            position = position + np.array(self.sway.amplitude) * np.sin(phases)
        return position


@parameters.checked_dataclass(ScenarioError)
class PersonPlan:
    """Parameters of a simulated person: a mass on a spring and a damper whose other end follows a script.

    It models the equilibrium point of an arm (Hogan 1985, "The mechanics of multi-joint posture and movement
    control").
    """

    mass: parameters.PositiveMass
    """Effective mass of the hand or the head, in kg."""
    stiffness: parameters.PositiveStiffness
    """Stiffness of the spring, in N/m."""
    damping: parameters.PositiveDamping
    """Damping of the damper, in N s/m."""
    script: Script
    """Motion of the hand or the head."""
    bodies: Mapping[str, Script] = field(default_factory=dict)
    """Motions of the origins of the frames to which modules are attached; the frames do not turn."""


@dataclass(frozen=True, eq=False)
class PersonRecord:
    """Motion of a simulated person and the force of the cables on it, once a ms."""

    time: Floats  # (K,), in s since the script began
    position: Floats  # of the hand or the head, (K, d), in m
    force: Floats  # true force of the cables on it, (K, d), in N
    tensions: Floats  # true tensions, (K, m), in N


class Person:
    """Simulated person, called with a time for its pose.

    It stands still at the start of its script until `begin` is called. The rig's point is its hand or head;
    ``pose``, with the bodies, and ``velocity`` (d,), in m/s, are those now.
    """

    def __init__(self, plan: PersonPlan, rig: Rig) -> None:
        self._plan, self._rig = plan, rig
        self._time, self._start = 0.0, math.inf
        self._position = plan.script.position(0.0)
        self.velocity: Floats = np.zeros_like(self._position)
        self._tensions: Floats = np.zeros(rig.m)
        self._required = rig.required.middle(rig)  # wrench that the cables hold besides
        self._force: Floats | None = None
        self._cables: Cables | None = None
        self._rows: list[tuple[float, Floats, Floats, Floats]] = []
        self._take_place()

    def begin(self) -> None:
        """Start the script now, unless it has started."""
        self._start = min(self._start, self._time)

    def apply_tensions(self, tensions: Floats) -> None:
        """Set the cables' tensions from now on, (m,) in N."""
        self._tensions = tensions

    def apply_force(self, force: Floats) -> None:
        """Set a force from now on, (d,) in N, instead of the cables' force."""
        self._force = force

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time in s, which must not decrease from call to call."""
        while (remaining := time - self._time) > 1e-9:
            step = min(remaining, MAX_STEP_S)
            self._time += step
            if self._start < math.inf:
                self._move(step)
        return self.pose

    @property
    def cables(self) -> Cables:
        """Cables at the current pose."""
        if self._cables is None:
            self._cables = self._rig.cables(*self.pose)
        return self._cables

    @property
    def lengths(self) -> Floats:
        """Lengths of the cables at the current pose, in m."""
        return self.cables.lengths

    @property
    def record(self) -> PersonRecord:
        """Record since the script began."""
        columns = zip(*self._rows, strict=True) if self._rows else ((),) * 4
        widths = ((), (self._rig.dimension,), (self._rig.dimension,), (self._rig.m,))
        return PersonRecord(*(np.array(c).reshape(-1, *width) for c, width in zip(columns, widths, strict=True)))

    def _move(self, step: float) -> None:
        """Take one step of the semi-implicit Euler method, with which a spring gains no energy."""
        plan, now = self._plan, self._time - self._start
        goal = plan.script.position(now)
        speed = (plan.script.position(now + SPEED_STEP_S) - goal) / SPEED_STEP_S
        force = self._force
        if force is None:
            force = structure_matrix(self.cables.directions, self.cables.arms) @ self._tensions - self._required
        own = plan.stiffness * (goal - self._position) + plan.damping * (speed - self.velocity)
        self.velocity = self.velocity + step * (own + force) / plan.mass
        self._position = self._position + step * self.velocity
        self._take_place()
        self._rows.append((now, self._position, force, self._tensions))

    def _take_place(self) -> None:
        """Update the pose and the cables."""
        now = max(self._time - self._start, 0.0)
        bodies = self._plan.bodies
        frames = {name: (bodies[name].position(now), None) for name in self._rig.frames}
        self.pose = Pose(self._position, frames=frames)
        self._cables = None
