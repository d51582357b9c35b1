"""A simulated module with a mass on its cable, in lockstep: what weighs is integrated, step by step."""

from __future__ import annotations

from collections.abc import Mapping

from tensionlab.errors import HardwareError
from tensionlab.hardware.calibration.gain import GRAVITY
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


class HangingMass(SimulatedModule):
    """What would a module do with a mass on its cable, above a floor?

    ``m x'' = m g - T``, with x down from the module and T the cable's tension; the floor takes all speed. Time and
    place pass as in `SimulatedModule`, but nobody else can move the far end.

    Parameters
    ----------
    mass : float
        In kg; may be changed while it stands on the floor.
    floor : float
        Below the module, in m. The mass stands there at first.
    plant, seed
        As in `SimulatedModule`.
    """

    def __init__(
        self, mass: float, floor: float = 1.0, *, plant: Mapping[str, float] | None = None, seed: int = 0
    ) -> None:
        super().__init__(plant=plant, distance=floor, seed=seed)
        self.mass = mass
        self._floor = self._place = floor
        self._speed = 0.0
        self.advance(STEP_S)  # before its first step, a module knows nothing

    def advance(self, seconds: float, distance: float | None = None) -> None:
        """Let time pass, rounded to steps of the firmware."""
        if distance is not None:
            raise HardwareError("a hanging mass moves the cable's far end by itself; give no distance")
        for _ in range(round(seconds / STEP_S)):
            self._speed += (GRAVITY - self.sample.tension / self.mass) * STEP_S
            self._place += self._speed * STEP_S
            if self._place >= self._floor:
                self._place, self._speed = self._floor, 0.0
            super().advance(STEP_S, self._place)
