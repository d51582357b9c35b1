"""A simulated force sensor for others: a line of three numbers a millisecond, over TCP."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

from tensionlab.hardware.simulation.serve import TcpPort
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tensionlab.model.rig import Rig
from tensionlab.validation.drift_noise import RATE
from tensionlab.validation.error_model import Errors
from tensionlab.validation.readings import SIMULATED
from tensionlab.validation.sensor import SimulatedSensor


class ServedSensor:
    """Sends what a `SimulatedSensor` feels to whoever connects. A context manager, which closes the port.

    Parameters
    ----------
    rig, errors, seed
        As for `SimulatedSensor`.
    port : TcpPort
    """

    def __init__(self, rig: Rig, errors: Errors, seed: int, port: TcpPort) -> None:
        self._sensor = SimulatedSensor(rig, errors, seed)
        self._port = port
        self.url = port.url
        self._sent = 0
        self._told = False

    def __enter__(self) -> Self:
        """Keep the port open."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self._port.close()

    def take(self, modules: Sequence[SimulatedModule]) -> None:
        """Look at the modules, if it is time to, and send what is felt.

        Where their time made a leap, there is one sample for it, not many that are alike.
        """
        self._port.receive()
        if not self._port.connected():
            self._told = False
            return
        if not self._told:
            self._port.send(f"{SIMULATED}\n".encode())
            self._told = True
        due = int(modules[0].seconds * RATE)
        if due == self._sent:
            return
        self._sent = due
        self._sensor.look(modules)
        lines = [" ".join(f"{value:.6f}" for value in force) + "\n" for force in self._sensor.take().tolist()]
        self._port.send("".join(lines).encode())
