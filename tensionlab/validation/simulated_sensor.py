"""Simulated force sensor with drift noise: in this process, or served over TCP as lines of numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.settings import WorldClock
from tensionlab.hardware.simulation.serve import TcpPort
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule, Trace
from tensionlab.hardware.simulation.world import World
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.validation.error_model import RigErrors, require_point, true_plants, true_rig
from tensionlab.validation.sensors import SAMPLE_RATE_HZ, SIMULATED, UPRIGHT

STEPS_PER_SAMPLE = round(1.0 / SAMPLE_RATE_HZ / STEP_S)  # steps of the firmware
CORRELATION_TIME_S = 1.0
BLOCK_SAMPLES = 1000  # samples at a time, so that no power of the decay gets out of range


class DriftNoise:
    """Slow noise of three axes: an Ornstein-Uhlenbeck process for each, sample by sample.

    ``deviation`` is its standard deviation in N; the same ``seed`` gives the same samples, in pieces of any size.
    """

    def __init__(self, deviation: float, seed: int) -> None:
        self._random = np.random.default_rng([seed, 1])
        self._decay = float(np.exp(-1.0 / (SAMPLE_RATE_HZ * CORRELATION_TIME_S)))
        self._kick = deviation * np.sqrt(1.0 - self._decay**2)
        self._last: Floats = deviation * self._random.standard_normal(3)

    def take(self, count: int) -> Floats:
        """Return the next samples, (count, 3) in N."""
        sizes = [min(BLOCK_SAMPLES, count - start) for start in range(0, count, BLOCK_SAMPLES)]
        return np.concatenate([np.empty((0, 3)), *map(self._block, sizes)])

    def _block(self, count: int) -> Floats:
        decay = self._decay ** np.arange(1, count + 1)[:, None]
        kicks = self._kick * self._random.standard_normal((count, 3))
        values: Floats = decay * (self._last + np.cumsum(kicks / decay, axis=0))
        self._last = values[-1]
        return values


class SimulatedSensor:
    """Sensor that holds the point of a simulated rig.

    The rig is as the host believes it to be, the errors are what is wrong with it, and the seed is of the noise.
    """

    simulated = True

    def __init__(self, rig: Rig, errors: RigErrors, seed: int = 0) -> None:
        real = true_rig(rig, errors)
        self._pull = UPRIGHT.T @ errors.tilt @ real.structure_matrix(real.home, frames=real.at_rest)
        self._biases, self._noise = errors.biases, DriftNoise(errors.noise, seed)
        self._steps = 0
        self._kept: list[Floats] = []

    def watch(self, traces: Sequence[Trace]) -> None:
        """Sample the steps of the modules, once each ms; what `World.watch` calls."""
        first = -self._steps % STEPS_PER_SAMPLE
        self._steps += len(traces[0].tension)
        tensions = np.stack([trace.tension[first::STEPS_PER_SAMPLE] for trace in traces], axis=-1)
        driven = np.stack([trace.driver_on[first::STEPS_PER_SAMPLE] for trace in traces], axis=-1)
        if len(tensions):
            self._keep(tensions, driven)

    def sample(self, modules: Sequence[SimulatedModule]) -> None:
        """Take one sample of the modules as they are now."""
        samples = [module.sample for module in modules]
        self._keep(
            np.array([[sample.tension for sample in samples]]),
            np.array([[sample.driver_on for sample in samples]]),
        )

    def take(self) -> Floats:
        """Return the forces since the last call."""
        kept, self._kept = self._kept, []
        return np.concatenate(kept) if kept else np.empty((0, 3))

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _keep(self, tensions: Floats, driven: NDArray[np.bool_]) -> None:
        pulled = np.maximum(tensions + np.where(driven, self._biases, 0.0), 0.0)
        self._kept.append(pulled @ self._pull.T + self._noise.take(len(pulled)))


class SensorServer:
    """Server of a `SimulatedSensor` over TCP: a line of three numbers each ms to a client."""

    def __init__(self, rig: Rig, errors: RigErrors, seed: int, port: TcpPort) -> None:
        self._sensor = SimulatedSensor(rig, errors, seed)
        self._port = port
        self._sent = 0
        self._greeted = False

    def take(self, modules: Sequence[SimulatedModule]) -> None:
        """Sample the modules, if it is time to, and send the force.

        Where their time made a leap, there is one sample for it, not many that are alike.
        """
        self._port.receive()
        if not self._port.connected():
            self._greeted = False
            return
        if not self._greeted:
            self._port.send(f"{SIMULATED}\n".encode())
            self._greeted = True
        due = int(modules[0].seconds * SAMPLE_RATE_HZ)
        if due == self._sent:
            return
        self._sent = due
        self._sensor.sample(modules)
        lines = [" ".join(f"{value:.6f}" for value in force) + "\n" for force in self._sensor.take().tolist()]
        self._port.send("".join(lines).encode())


def simulated_setup(rig: Rig, errors: RigErrors, seed: int = 0) -> tuple[ModuleGroup, WorldClock, SimulatedSensor]:
    """Return simulated modules, their clock and a sensor, in lockstep, where the errors put them."""
    require_point(rig)
    world = World(true_rig(rig, errors), seed=seed, plants=true_plants(rig, errors))
    sensor = SimulatedSensor(rig, errors, seed)
    world.watch = sensor.watch
    return world.group(), WorldClock(world), sensor
