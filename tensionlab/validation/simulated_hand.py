"""Simulated hands that hold the force sensor in a characterisation, in this process or served over TCP."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from tensionlab.demand import Pose
from tensionlab.hardware.simulation.serve import TcpPort
from tensionlab.hardware.simulation.world import GuidedHand, Motion, World
from tensionlab.model.rig import Rig
from tensionlab.model.wall_stiffness import HAND_DAMPING
from tensionlab.scenarios.person import Person, PersonPlan, Script, Waypoint
from tensionlab.support.arrays import Floats
from tensionlab.validation.error_model import PRESETS, draw_errors
from tensionlab.validation.sensors import SIMULATED_LINE, SimulatedSensor

MOTION_M, MOTION_HZ, MOTION_S = 0.05, 1.0, 4.0  # of a hand along each axis: amplitude, frequency, duration
HAND_MASS_KG = 1.0  # of the simulated hand at walls: theory is of a heavy one
# Requests to the person who holds the sensor of a real rig, by the grip.
TEXTS = {
    "hold": "fix the sensor, its Z axis up, with the handle at {} m",
    "move": "hold the handle by the sensor at {} m; then move it by 5 cm once a second, 4 s along each of x, y, z",
    "loose": "hold the handle loosely by the sensor, at {} m: stiff springs will shake it",
}


class HandRequest(NamedTuple):
    """How to hold the sensor in a part of a characterisation, a key of `TEXTS`, and where, (3,) in m."""

    grip: str
    place: Floats

    def __str__(self) -> str:
        return TEXTS[self.grip].format(", ".join(f"{part:.3f}" for part in self.place))

    def line(self) -> str:
        """Return the request as a simulated sensor takes it."""
        return f"{self.grip} {' '.join(map(str, self.place.tolist()))}\n"

    def motion(self, rig: Rig, start: Floats | None = None) -> Motion:
        """Return the motion of a hand that does so; a loose one starts somewhere else than its place, if given."""
        if self.grip == "loose":
            script = Script((Waypoint(0.0, tuple((self.place if start is None else start).tolist())),))
            hand = Person(PersonPlan(HAND_MASS_KG, 1e-6, HAND_DAMPING, script), rig)
            hand.begin()
            return hand

        def pose(time: float) -> Pose:
            turn, since = divmod(time, MOTION_S)  # along one axis after another, each from rest to rest
            swing = math.sin(math.pi * since / MOTION_S) ** 2 * math.sin(2.0 * math.pi * MOTION_HZ * since)
            offset = MOTION_M * swing * np.eye(3)[int(turn) % 3] if self.grip == "move" else 0.0
            return Pose(self.place + offset, frames=rig.at_rest)

        return pose


class RequestedHand:
    """Hand that does what was requested last, and moves there smoothly; a `CompliantMotion`, at first at home."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._now, self._pose = rig, 0.0, Pose(rig.home, frames=rig.at_rest)
        self.request(HandRequest("hold", rig.home))

    def request(self, request: HandRequest) -> None:
        """Do this from now on."""
        here = self._pose
        motion = request.motion(self._rig, here.position)
        self._since, self._person, self._motion = self._now, motion if isinstance(motion, Person) else None, motion
        if self._person is None:
            self._motion = GuidedHand(lambda time: motion(time) if time > 0.0 else here)
            self._motion(0.0)

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time, no earlier than the last."""
        self._now, self._pose = time, self._motion(time - self._since)
        return self._pose

    @property
    def lengths(self) -> Floats:
        """Lengths of the cables at the latest pose, (m,) in m."""
        return self._rig.lengths(*self._pose)

    def apply_tensions(self, tensions: Floats) -> None:
        """Let the cables pull at a loose hand from now on, with (m,) N."""
        if self._person is not None:
            self._person.apply_tensions(tensions)


class ServedSensor:
    """Force sensor of a simulated rig at a TCP port, held as its client requests, without errors of calibration.

    It sends a line of three numbers each ms. Lines that are no request (`HandRequest.line`) are ignored.
    """

    def __init__(self, rig: Rig, port: TcpPort, seed: int = 0) -> None:
        self.port, self._hand = port, RequestedHand(rig)
        self.world = World(rig, self._hand, seed)
        errors = draw_errors(PRESETS["ideal"], rig.m, seed)
        self._sensor = SimulatedSensor(rig, errors, lambda: self.world.pose, seed)
        self.world.watch = self._sensor.watch
        self._greeted, self._rest = False, b""

    def serve(self, now: float) -> None:
        """Run the modules, the hand and the sensor until a time, in s since the start."""
        *lines, self._rest = (self._rest + (self.port.receive() or b"")).split(b"\n")
        for line in lines:
            with suppress(ValueError):
                grip, *place = line.decode().split()
                if grip in TEXTS and np.isfinite(values := np.array(place, dtype=np.float64)).all():
                    self._hand.request(HandRequest(grip, values))
        self.world.advance(max(now - self.world.time, 0.0))
        forces = self._sensor.take().tolist()
        if self.port.connected():
            greeting = "" if self._greeted else SIMULATED_LINE
            self.port.send((greeting + "".join(f"{x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in forces)).encode())
        self._greeted = self.port.connected()
