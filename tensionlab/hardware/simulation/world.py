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
from tensionlab.hardware.protocol.codes import Calibration, Code
from tensionlab.hardware.protocol.frames import Decoder
from tensionlab.hardware.protocol.messages import Acknowledge, Calibrate, Message, SetParameter, read
from tensionlab.hardware.protocol.parameters import PARAMETERS, require_value
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import PLANT, STEP_S, SimulatedModule, Trace
from tensionlab.model.module import Module
from tensionlab.model.pose import frame_of
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats


def plant_of(module: Module) -> dict[str, float]:
    """Return the hardware parameters of a rig's module that differ from `PLANT`."""
    spool = PLANT["radius"].default if module.spool_radius is None else module.spool_radius
    return {
        "radius": spool,
        "torque_constant": newton_per_ampere(module) * spool,
        "brake_strength": 0.0 if module.brake is None else module.brake,
    }


def simulated_module(
    module: Module,
    length: float,
    *,
    serial_number: int = 1,
    seed: int = 0,
    settings: bytes | None = None,
    plant: Mapping[str, float] | None = None,
) -> SimulatedModule:
    """Return a simulated module of a rig, calibrated and with the rig's limits, as a maker would leave it.

    Its cable is so many m long. What the rig does not say is as in `PLANT`; without ``brake`` it has none. `plant`
    is what the hardware really is where it is not as the rig says; the firmware does not know of it. Stored
    settings take the place of all that but the cable's length, which no module remembers. A `HardwareError` names
    the module, for what no module of this kind can do.
    """
    longest = PARAMETERS["length_upper"].upper
    if length > longest:
        raise HardwareError(
            f'module "{module.name}": its cable would be {length:.4g} m long, and a module takes {longest:g} m at '
            "most; move the pose or the anchor"
        )
    strongest = PARAMETERS["tension_upper"].upper
    if module.upper > strongest:
        raise HardwareError(
            f'module "{module.name}": its upper limit is {module.upper:g} N, and a module pulls with '
            f"{strongest:g} N at most; give the rig lower limits, or make a smaller one to simulate"
        )
    built = plant_of(module)
    made = built | ({} if plant is None else dict(plant))
    simulated = SimulatedModule(serial_number, plant=made, distance=length, seed=seed, settings=settings)
    simulated.advance(STEP_S)  # before its first step, a module knows nothing
    commands: list[Message] = []
    if not simulated.loaded:
        taut = PARAMETERS["tension_lower"]
        wanted = {
            "length_upper": min(max(PARAMETERS["length_upper"].default, 2.0 * length), longest),
            "tension_upper": module.upper,
            "tension_lower": min(max(module.lower, taut.lower), taut.upper),
            "spool_radius": built["radius"],
        }
        origin = f'module "{module.name}"'
        for name, value in wanted.items():
            commands.append(SetParameter(PARAMETERS[name].index, require_value(name, value, origin)))
        commands.append(Calibrate(Calibration.NEWTON_PER_AMPERE, newton_per_ampere(module)))
    commands.append(Calibrate(Calibration.LENGTH, length))
    for command in commands:
        _tell(simulated, command, module.name)
    return simulated


def newton_per_ampere(module: Module) -> float:
    """Return the N/A that the firmware assumes for a module."""
    if module.newton_per_ampere is not None:
        return module.newton_per_ampere
    return PARAMETERS["newton_per_ampere"].default


def _tell(simulated: SimulatedModule, command: Message, name: str) -> None:
    """Carry out a command, as if it had come over the link."""
    simulated.receive(command.frame(0).pack())
    for frame in Decoder().feed(simulated.transmit()):
        answer = read(frame)
        if isinstance(answer, Acknowledge) and answer.code is Code.OK:
            return
        raise HardwareError(f'module "{name}" answered {answer} to {command}')
    raise HardwareError(f'module "{name}" did not answer {command}')


MOTION_STEP_S = 5e-3  # time over which the cables' far ends move evenly; in between, the pose is computed
# The same where what they hold gives way to them: a cable of 5 kN/m shakes a hand at 20 Hz.
COMPLIANT_STEP_S = 1e-3
Motion = Callable[[float], Pose]  # pose of what the cables hold, at a time in s


@runtime_checkable
class CompliantMotion(Protocol):
    """Motion that the cables change."""

    @property
    def lengths(self) -> Floats:
        """Lengths of the cables at the latest pose, (m,) in m."""
        ...

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time that does not go back."""

    def apply_tensions(self, tensions: Floats) -> None:
        """Set the tensions of the cables from now on, (m,) in N."""


class World:
    """World of simulated modules and the platform that their cables hold.

    Parameters
    ----------
    rig : Rig
    motion : callable, optional
        Where the platform is at each time, at the rig's home if left out. A `CompliantMotion` gives way.
    seed : int
        Of the sensors' noise.
    plants : mapping of str to mapping, optional
        What the hardware of a module, by its name, really is: see `simulated_module`.

    Attributes
    ----------
    modules : tuple of SimulatedModule
        In the rig's order.
    time : float
        In s since the start.
    pose : Pose
        At that time.
    watch : callable or None
        Sees each step of all modules while time passes in `advance`: a `Trace` of each, in the rig's order.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import World
    >>> world = World(tl.load_rig("floor-3"))
    >>> world.advance(0.1)
    >>> round(world.time, 3), len(world.modules)
    (0.1, 3)
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
        self._motion = motion if motion is not None else lambda time: Pose(rig.home, frames=rig.at_rest)
        self._given = motion if isinstance(motion, CompliantMotion) else None
        self._piece = math.inf if motion is None else MOTION_STEP_S if self._given is None else COMPLIANT_STEP_S
        self.time = 0.0
        self.pose = self._motion(0.0)
        self.watch: Callable[[Sequence[Trace]], None] | None = None
        plants = {} if plants is None else plants
        self.modules = tuple(
            simulated_module(
                module, length, serial_number=index + 1, seed=seed + index, plant=plants.get(module.name)
            )
            for index, (module, length) in enumerate(zip(rig.modules, self._lengths(), strict=True))
        )

    def advance(self, seconds: float) -> None:
        """Let time pass in all modules while the platform moves."""
        end = self.time + seconds
        while (left := end - self.time) > 1e-9:
            step = min(left, self._piece)
            self.time += step
            if self._given is not None:
                self._given.apply_tensions(self.tensions)
            self.pose = self._motion(self.time)
            moved = list(zip(self.modules, self._lengths(), strict=True))
            if self.watch is None:
                for module, length in moved:
                    module.advance(step, length)
            else:
                self.watch([module.trace(step, length) for module, length in moved])

    @property
    def tensions(self) -> Floats:
        """True tensions of the cables, in N."""
        return np.array([module.tension for module in self.modules])

    @property
    def wrench(self) -> Floats:
        """True wrench on the platform, in N and N·m."""
        structure: Floats = self._rig.structure_matrix(*self.pose) @ self.tensions
        return structure

    def group(self, conditions: Conditions | None = None, seed: int = 0) -> ModuleGroup:
        """Return clients of these modules, over links of given conditions; the seed is of numbers and damage."""
        clients = []
        for index, (module, simulated) in enumerate(zip(self._rig.modules, self.modules, strict=True)):
            link: Link = SimulatedLink(simulated)
            if conditions is not None:
                link = FaultyLink(link, conditions, seed=seed + index)
            clients.append(ModuleClient(module.name, link, seed + index))
        return ModuleGroup(clients)

    def _lengths(self) -> list[float]:
        lengths = self._rig.lengths(*self.pose) if self._given is None else self._given.lengths
        return list(lengths.tolist())


APPROACH_GAIN_1_S = 20.0  # close to where it is to be, a hand is so many times as fast as it is far
MAX_HAND_SPEED_M_S = 1.5  # modules let the cable in and out at 2 m/s
# At twice that, with a body that moves as well, modules still keep their cables taut.
MAX_HAND_ACCELERATION_M_S2 = 10.0
TINY_M = 1e-12  # a distance that is none
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
        """Return the pose at a time, which must not go back."""
        wanted = self._guide(time)
        step, self._time = time - self._time, time
        position = self._follow("", wanted.position, step)
        frames = {}
        for name, where in (wanted.frames or {}).items():
            place, rotation = frame_of(where)
            frames[name] = (self._follow(name, np.asarray(place, dtype=np.float64), step), rotation)
        return Pose(position, wanted.rotation, frames)

    def _follow(self, name: str, wanted: Floats, seconds: float) -> Floats:
        place, velocity = self._places.get(name, (wanted, np.zeros_like(wanted)))
        while seconds > 0.0:
            step = min(seconds, MAX_INTEGRATION_STEP_S)
            gap = wanted - place
            far = float(np.linalg.norm(gap))
            # So that it can brake in time.
            speed = min(MAX_HAND_SPEED_M_S, math.sqrt(MAX_HAND_ACCELERATION_M_S2 * far), APPROACH_GAIN_1_S * far)
            change = gap * (speed / max(far, TINY_M)) - velocity
            most = MAX_HAND_ACCELERATION_M_S2 * step
            velocity = velocity + change * (most / max(float(np.linalg.norm(change)), most))
            place = place + step * velocity
            seconds -= step
        self._places[name] = (place, velocity)
        return place
