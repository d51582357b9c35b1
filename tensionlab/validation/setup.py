"""A simulated rig with errors: modules in lockstep, and the sensor that they pull on."""

from __future__ import annotations

from typing import NamedTuple

from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.settings import WorldClock
from tensionlab.hardware.simulation.world import World
from tensionlab.model.rig import Rig
from tensionlab.validation.error_model import Errors, require_point, true_plants, true_rig
from tensionlab.validation.sensor import SimulatedSensor


class SimulatedSetup(NamedTuple):
    """What `measure` needs of a simulated rig."""

    modules: ModuleGroup
    clock: WorldClock
    sensor: SimulatedSensor


def simulated_setup(rig: Rig, errors: Errors, seed: int = 0) -> SimulatedSetup:
    """Which modules and sensor stand where the errors put them?

    Raises
    ------
    RigError
        If the rig does not hold a point in space.
    HardwareError
        If no module of this kind can do what the rig says.
    """
    require_point(rig)
    world = World(true_rig(rig, errors), seed=seed, plants=true_plants(rig, errors))
    sensor = SimulatedSensor(rig, errors, seed)
    world.watch = sensor.watch
    return SimulatedSetup(world.group(), WorldClock(world), sensor)
