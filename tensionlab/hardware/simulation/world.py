"""Simulated modules of a rig in this process, and motions of the platform that their cables hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from tensionlab.demand import Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import PLANT, STEP_S, SimulatedModule
from tensionlab.model.module import Module
from tensionlab.model.pose import frame_of
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

MAX_CABLE_STIFFNESS_N_M = 1e4  # stiffest simulated cable: a stiffer one is shaken by the steps of motions


def plant_parameters(module: Module) -> dict[str, float]:
    """Return the hardware parameters of a rig's module that differ from `PLANT`."""
    spool = PLANT["radius"].default if module.spool_radius is None else module.spool_radius
    frictions = {"dry_friction": module.friction_coulomb, "viscous_friction": module.friction_viscous}
    return {name: value for name, value in frictions.items() if value is not None} | {
        "radius": spool,
        "torque_constant": newton_per_ampere(module) * spool,
        "brake_strength": 0.0 if module.brake is None else module.brake,
    }


def newton_per_ampere(module: Module) -> float:
    """Return the N/A that the firmware assumes for a module."""
    default = PARAMETERS["newton_per_ampere"].default
    return default if module.newton_per_ampere is None else module.newton_per_ampere


def simulated_module(
    module: Module,
    length: float,
    *,
    serial_number: int = 1,
    seed: int = 0,
    plant: Mapping[str, float] | None = None,
) -> SimulatedModule:
    """Return a simulated module of a rig, calibrated and with the rig's limits, as a maker would leave it.

    Its cable has the length in m, and with `Module.cable_stiffness` stretches as one of that length. What the rig
    does not say is as in `PLANT`; without ``brake`` it has none.
    `plant` replaces parameters of the hardware without the firmware's knowledge. A `HardwareError` names the
    module and what none of its kind can do.
    """
    longest, strongest = PARAMETERS["length_upper"].upper, PARAMETERS["tension_upper"].upper
    if length > longest:
        long = f"its cable would be {length:.4g} m long, and a module takes {longest:g} m at most"
        raise HardwareError(f'module "{module.name}": {long}; move the pose or the anchor')
    if module.upper > strongest:
        strong = f"its upper limit is {module.upper:g} N, and a module pulls with {strongest:g} N at most"
        raise HardwareError(f'module "{module.name}": {strong}; give the rig lower limits to simulate it')
    built = plant_parameters(module)
    if module.cable_stiffness is not None:
        built["stiffness"] = min(module.cable_stiffness / length, MAX_CABLE_STIFFNESS_N_M)
    simulated = SimulatedModule(
        serial_number,
        plant=built | dict(plant or {}),
        distance=length,
        seed=seed,
        start_us=1_234_567 * serial_number,  # no two are switched on at once
    )
    simulated.advance(STEP_S)  # before its first step, a module knows nothing
    client = ModuleClient(module.name, SimulatedLink(simulated), seed)
    lower, upper = PARAMETERS["tension_lower"], PARAMETERS["length_upper"]
    client.set_parameter("length_upper", min(max(upper.default, 2.0 * length), upper.upper))
    client.set_parameter("tension_upper", module.upper)
    client.set_parameter("tension_lower", min(max(module.lower, lower.lower), lower.upper))
    client.set_parameter("spool_radius", built["radius"])
    client.calibrate(Calibration.NEWTON_PER_AMPERE, newton_per_ampere(module))
    client.calibrate(Calibration.LENGTH, length)
    return simulated


MOTION_STEP_S = 5e-3  # time between two poses, over which the cables' far ends move evenly
COMPLIANT_STEP_S = 1e-3  # the same for a `CompliantMotion`: a cable of 5 kN/m shakes a hand at 20 Hz
LINK_STEP_S = 1e-3  # time between two deliveries of links that delay their bytes
Motion = Callable[[float], Pose]  # pose of the platform at a time in s


@runtime_checkable
class CompliantMotion(Protocol):
    """Motion that the cables change."""

    @property
    def lengths(self) -> Floats:
        """Lengths of the cables at the latest pose, (m,) in m."""
        ...

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time, no earlier than the last."""

    def apply_tensions(self, tensions: Floats) -> None:
        """Set the tensions of the cables from now on, (m,) in N."""


class World:
    """World of simulated modules and the platform that their cables hold.

    The platform follows the motion, or stays at the rig's home; a `CompliantMotion` reacts to the tensions. The
    seed is of the sensors' noise, ``plants`` are parameters of the hardware by the module's name (see
    `simulated_module`). `time` is in s since the start, `pose` the pose then; `modules` are in the rig's order.
    `watch`, if set, is called in `advance` with the `SimulatedModule.samples` of each.
    """

    def __init__(
        self,
        rig: Rig,
        motion: Motion | None = None,
        seed: int = 0,
        *,
        plants: Mapping[str, Mapping[str, float]] | None = None,
    ) -> None:
        self._rig = rig
        self._motion = motion or (lambda time: Pose(rig.home, frames=rig.at_rest))
        self._compliant = motion if isinstance(motion, CompliantMotion) else None
        moving = MOTION_STEP_S if self._compliant is None else COMPLIANT_STEP_S
        self._step = math.inf if motion is None else moving
        self.time = 0.0
        self.pose = self._motion(0.0)
        self.watch: Callable[[Sequence[Floats]], None] | None = None
        self._delayed: list[ModuleClient] = []  # clients whose bytes arrive when they are due, not once a cycle
        self.modules = tuple(
            simulated_module(
                module, length, serial_number=index + 1, seed=seed + index, plant=(plants or {}).get(module.name)
            )
            for index, (module, length) in enumerate(zip(rig.modules, self._lengths().tolist(), strict=True))
        )

    def advance(self, seconds: float) -> None:
        """Let time pass in all modules while the platform moves."""
        end = self.time + seconds
        while (remaining := end - self.time) > 1e-9:
            step = min(remaining, self._step)
            self.time += step
            if self._compliant is not None:
                self._compliant.apply_tensions(self.tensions)
            self.pose = self._motion(self.time)
            moved = zip(self.modules, self._lengths().tolist(), strict=True)
            if self.watch is None:
                for module, length in moved:
                    module.advance(step, length)
            else:
                self.watch([module.samples(step, length) for module, length in moved])
            for client in self._delayed:
                client.listen()

    @property
    def tensions(self) -> Floats:
        """True tensions of the cables, in N."""
        return np.array([module.tension for module in self.modules])

    @property
    def wrench(self) -> Floats:
        """True wrench on the platform, in N and N·m."""
        return np.asarray(self._rig.structure_matrix(*self.pose) @ self.tensions)

    def group(self, conditions: Conditions | None = None, seed: int = 0) -> ModuleGroup:
        """Return clients of these modules, over links of given conditions; the seed is of numbers and damage."""
        clients = []
        for index, (module, simulated) in enumerate(zip(self._rig.modules, self.modules, strict=True)):
            link: Link = SimulatedLink(simulated)
            if conditions is not None:
                link = FaultyLink(link, conditions, seed=seed + index)
            clients.append(ModuleClient(module.name, link, seed + index))
        if conditions is not None:
            self._delayed += clients
            self._step = min(self._step, LINK_STEP_S)
        return ModuleGroup(clients)

    def _lengths(self) -> Floats:
        return self._rig.lengths(*self.pose) if self._compliant is None else self._compliant.lengths


APPROACH_GAIN_1_S = 20.0  # largest speed of a hand per distance from its target
MAX_HAND_SPEED_M_S = 1.5  # modules let the cable in and out at 2 m/s
MAX_HAND_ACCELERATION_M_S2 = 10.0  # at twice that, modules still keep their cables taut
MAX_INTEGRATION_STEP_S = 0.01


class GuidedHand:
    """Hand that follows a pose without overshoot: positions of hand and body frames; rotations at once.

    `guide` returns the target pose at a time in s; the hand starts there.
    """

    def __init__(self, guide: Callable[[float], Pose]) -> None:
        self._guide = guide
        self._places: dict[str, tuple[Floats, Floats]] = {}
        self._time = 0.0

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time, no earlier than the last."""
        wanted = self._guide(time)
        step, self._time = time - self._time, time
        frames = {}
        for name, where in (wanted.frames or {}).items():
            place, rotation = frame_of(where)
            frames[name] = (self._follow(name, np.asarray(place, dtype=np.float64), step), rotation)
        return Pose(self._follow("", wanted.position, step), wanted.rotation, frames)

    def _follow(self, name: str, wanted: Floats, seconds: float) -> Floats:
        place, velocity = self._places.get(name, (wanted, np.zeros_like(wanted)))
        while seconds > 0.0:
            step = min(seconds, MAX_INTEGRATION_STEP_S)
            gap = wanted - place
            far = float(np.linalg.norm(gap))
            # slow enough to brake in time
            speed = min(MAX_HAND_SPEED_M_S, math.sqrt(MAX_HAND_ACCELERATION_M_S2 * far), APPROACH_GAIN_1_S * far)
            change = gap * (speed / max(far, 1e-12)) - velocity
            largest_change = MAX_HAND_ACCELERATION_M_S2 * step
            velocity = velocity + change * (largest_change / max(float(np.linalg.norm(change)), largest_change))
            place = place + step * velocity
            seconds -= step
        self._places[name] = (place, velocity)
        return place
