"""The force sensor: what it has measured since somebody last looked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule, Trace
from tensionlab.model.rig import Rig
from tensionlab.validation.alignment import UPRIGHT
from tensionlab.validation.drift_noise import RATE, Wander
from tensionlab.validation.error_model import Errors, true_rig

STRIDE = round(1.0 / RATE / STEP_S)
"""Steps of the firmware from one sample to the next."""


class ForceSensor(Protocol):
    """A sensor that the cables pull on. It measures by itself; somebody takes what came, now and then."""

    @property
    def simulated(self) -> bool:
        """Whether it is no real one."""

    def take(self) -> Floats:
        """What was measured since the last call? (K, 3) forces in N, in the sensor's own axes, Z up."""

    def close(self) -> None:
        """Let go of it."""


class SimulatedSensor:
    """A sensor that holds the point of a simulated rig.

    Parameters
    ----------
    rig : Rig
        As the host believes it to be.
    errors : Errors
        What is wrong with it.
    seed : int
        Of the noise.
    """

    simulated = True

    def __init__(self, rig: Rig, errors: Errors, seed: int = 0) -> None:
        real = true_rig(rig, errors)
        self._pull = UPRIGHT.T @ errors.tilt @ real.structure_matrix(real.home, frames=real.at_rest)
        self._biases, self._wander = errors.biases, Wander(errors.noise, seed)
        self._steps = 0
        self._kept: list[Floats] = []

    def watch(self, traces: Sequence[Trace]) -> None:
        """See the modules step on; what `World.watch` calls. A sample is taken each ms."""
        first = -self._steps % STRIDE
        self._steps += len(traces[0].tension)
        tensions = np.stack([trace.tension[first::STRIDE] for trace in traces], axis=-1)
        driven = np.stack([trace.driver_on[first::STRIDE] for trace in traces], axis=-1)
        if len(tensions):
            self._feel(tensions, driven)

    def look(self, modules: Sequence[SimulatedModule]) -> None:
        """Take one sample of the modules as they are now."""
        samples = [module.sample for module in modules]
        self._feel(
            np.array([[sample.tension for sample in samples]]),
            np.array([[sample.driver_on for sample in samples]]),
        )

    def take(self) -> Floats:
        """What was measured since the last call?"""
        kept, self._kept = self._kept, []
        return np.concatenate(kept) if kept else np.empty((0, 3))

    def close(self) -> None:
        """There is nothing to let go of."""

    def _feel(self, tensions: Floats, driven: NDArray[np.bool_]) -> None:
        pulled = np.maximum(tensions + np.where(driven, self._biases, 0.0), 0.0)
        self._kept.append(pulled @ self._pull.T + self._wander.take(len(pulled)))
