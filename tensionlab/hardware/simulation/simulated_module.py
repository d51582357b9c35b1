"""Simulated module: the firmware's own core, compiled, with motor, spool, cable and brake simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import HardwareError
from tensionlab.hardware.calibration.gain import STANDARD_GRAVITY_M_S2
from tensionlab.hardware.protocol.codes import Fault, Limit, ResetReason, State
from tensionlab.hardware.protocol.parameters import PARAMETERS


@dataclass(frozen=True)
class PlantParameter:
    """Parameter of the simulated hardware, and where its value comes from."""

    unit: str
    lower: float
    standard: float
    about: str


PLANT = {row[0]: PlantParameter(*row[1:]) for row in _native.plant_table()}
"""The simulated hardware's parameters, by name."""
PARTS = tuple(_native.plant_parts())
"""What can break."""
STEP_S = 1e-6 * _native.step_microseconds()
"""Time from one step of the firmware to the next, in s."""
TENSION = 3
"""Place of the cable's tension in a sample of the native module."""
TRANSITIONS = [[(accepted, State(to)) for accepted, to in row] for row in _native.transition_table()]
"""The firmware's supervisor: for each event (arm, set-point, stop, estop, clear, expire, fault) and each `State`,
whether it is accepted, and the state after it."""


@dataclass(frozen=True)
class Sample:
    """State of a simulated module.

    Attributes
    ----------
    seconds : float
        Since the start.
    distance : float
        Of the cable's far end, in m.
    length : float
        Of the cable that is out, without its stretch, in m.
    tension : float
        Of the cable, in N.
    commanded : float
        Tension that the firmware makes the motor pull with, in N.
    current : float
        Of the motor, in A.
    brake_force : float
        That the pawl holds, in N.
    state : State
        Of the firmware.
    limit : Limit
        What keeps `commanded` from being what the host wants.
    driver_on : bool
        Whether the motor is driven.
    pawl_down : bool
        Whether the brake is on.
    """

    seconds: float
    distance: float
    length: float
    tension: float
    commanded: float
    current: float
    brake_force: float
    state: State
    limit: Limit
    driver_on: bool
    pawl_down: bool


@dataclass(frozen=True)
class Trace:
    """States of a simulated module over time: columns as in `Sample`, a row after each step of the firmware."""

    seconds: NDArray[np.float64]
    distance: NDArray[np.float64]
    length: NDArray[np.float64]
    tension: NDArray[np.float64]
    commanded: NDArray[np.float64]
    current: NDArray[np.float64]
    brake_force: NDArray[np.float64]
    state: NDArray[np.int64]
    limit: NDArray[np.int64]
    driver_on: NDArray[np.bool_]
    pawl_down: NDArray[np.bool_]

    @classmethod
    def from_table(cls, table: NDArray[np.float64]) -> Self:
        """Name the columns of a table of samples, one a row."""
        c = table.T
        codes, flags = c[7:9].astype(np.int64), c[9:] != 0.0
        return cls(c[0], c[1], c[2], c[3], c[4], c[5], c[6], codes[0], codes[1], flags[0], flags[1])


class SimulatedModule:
    """Simulated module: bytes in, bytes out, in lockstep with calls of `advance`.

    The firmware runs at 4 kHz, and time passes only in `advance` and `trace`. The far end of the cable is where
    they put it; nothing else moves it.

    Parameters
    ----------
    serial_number : int
        What the module calls itself, 32 bits.
    plant : mapping of str to float, optional
        Changes to the simulated hardware; `PLANT` lists names, units and standard values.
    distance : float
        Of the cable's far end at the start, in m. The cable is then straight, and without tension.
    seed : int
        Of the sensors' noise, 32 bits.
    start_us : int
        What the module's clock shows at the start, 32 bits.
    reset_reason : ResetReason
        Why the module started. After anything but power it takes its motor for hot.
    settings : bytes, optional
        What an earlier module had stored. Damaged settings are left alone, as the firmware does: see `loaded`.

    Raises
    ------
    HardwareError
        For a name that `PLANT` does not hold, and for numbers that cannot be.
    """

    def __init__(
        self,
        serial_number: int = 1,
        *,
        plant: Mapping[str, float] | None = None,
        distance: float = 1.0,
        seed: int = 0,
        start_us: int = 0,
        reset_reason: ResetReason = ResetReason.POWER,
        settings: bytes | None = None,
    ) -> None:
        plant = {} if plant is None else plant
        for name, value in plant.items():
            if name not in PLANT:
                raise HardwareError(f"the plant has no parameter {name!r}; it has {', '.join(PLANT)}")
            if not PLANT[name].lower <= value < math.inf:
                least = f"{PLANT[name].lower:g} {PLANT[name].unit}"
                raise HardwareError(f"plant parameter {name!r} is finite and at least {least}; got {value}")
        for name, number in (("serial_number", serial_number), ("seed", seed), ("start_us", start_us)):
            if not 0 <= number < 1 << 32:
                raise HardwareError(f"{name} is from 0 to 2**32 - 1; got {number}")
        _require_distance(distance)
        self._distance = distance
        self._module = _native.SimulatedModule(serial_number, dict(plant), distance, seed, start_us, reset_reason)
        self.loaded = settings is not None and self._module.load(settings)

    def receive(self, content: bytes) -> None:
        """Hand over bytes that came over the link."""
        self._module.receive(content, 0)

    def transmit(self) -> bytes:
        """Take the bytes that the module has to send."""
        return self._module.transmit()

    def close_link(self) -> None:
        """Tell the firmware that the link has broken off."""
        self._module.close_link()

    def advance(self, seconds: float, distance: float | None = None) -> None:
        """Let time pass, rounded to steps of the firmware, while the far end moves evenly to `distance` (m)."""
        self._module.advance(*self._steps(seconds, distance))

    def trace(self, seconds: float, distance: float | None = None) -> Trace:
        """Let time pass as `advance` does, and return a row for each step of the firmware."""
        return Trace.from_table(self._module.trace(*self._steps(seconds, distance)))

    def pause(self, seconds: float) -> None:
        """Let the firmware's next step come so much later, as a loop that hangs would."""
        if not 0.0 <= seconds <= 60.0:
            raise HardwareError(f"a pause takes 0 to 60 s; got {seconds}")
        self._module.pause(round(1e6 * seconds))

    @property
    def seconds(self) -> float:
        """Time since the start."""
        since: float = self._module.sample()[0]
        return since

    @property
    def sample(self) -> Sample:
        """State of the module now."""
        values = self._module.sample()
        return Sample(*values[:7], State(values[7]), Limit(values[8]), *values[9:])

    @property
    def faults(self) -> Fault:
        """Faults that the firmware finds now, or found before and nobody cleared."""
        return Fault(self._module.faults())

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the firmware's parameters now, by name."""
        return dict(zip(PARAMETERS, self._module.parameters(), strict=True))

    @property
    def settings(self) -> bytes:
        """What the module has stored, for the next one to start from; empty if nothing."""
        return self._module.stored()

    def damage(self, part: str) -> None:
        """Break a part of the hardware, one of `PARTS`."""
        self._set_broken(part, broken=True)

    def repair(self, part: str) -> None:
        """Make a part of the hardware whole again, one of `PARTS`."""
        self._set_broken(part, broken=False)

    def _set_broken(self, part: str, *, broken: bool) -> None:
        if part not in PARTS:
            raise HardwareError(f"a module has no part {part!r}; it has {', '.join(PARTS)}")
        self._module.set_broken(part, broken)

    def _steps(self, seconds: float, distance: float | None) -> tuple[int, float]:
        if not 0.0 <= seconds < 1e6:
            raise HardwareError(f"time passes by 0 to 1e6 s; got {seconds}")
        if distance is not None:
            _require_distance(distance)
            self._distance = distance
        return round(seconds / STEP_S), self._distance


def _require_distance(distance: float) -> None:
    if not 0.0 < distance < math.inf:
        raise HardwareError(f"the cable's far end is at a finite distance of more than 0 m; got {distance}")


class HangingMass(SimulatedModule):
    """Simulated module with a mass on its cable, above a floor.

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
            tension = self._module.sample()[TENSION]
            self._speed += (STANDARD_GRAVITY_M_S2 - tension / self.mass) * STEP_S
            self._place += self._speed * STEP_S
            if self._place >= self._floor:
                self._place, self._speed = self._floor, 0.0
            self._module.advance(1, self._place)
