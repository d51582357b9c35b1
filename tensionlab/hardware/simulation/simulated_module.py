"""Simulated module: the firmware's own core, compiled, with motor, spool, cable and brake simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.hardware.protocol.codes import Fault, Limit, ResetReason, State
from tensionlab.hardware.protocol.parameters import PARAMETERS
from tensionlab.model.module import STANDARD_GRAVITY_M_S2


@dataclass(frozen=True)
class PlantParameter:
    """Parameter of the simulated hardware, and where its value comes from."""

    unit: str
    lower: float
    default: float
    about: str


# The simulated hardware's parameters, by name.
PLANT = {row[0]: PlantParameter(*row[1:]) for row in _native.plant_table()}
PARTS = tuple(_native.plant_parts())  # parts that can fail
STEP_S = 1e-6 * _native.step_microseconds()  # time from one step of the firmware to the next, in s
TENSION = 3  # place of the cable's tension in a sample of the native module
# The firmware's supervisor: for each event (arm, set-point, stop, estop, clear, expire, fault) and each `State`,
# whether it is accepted, and the state after it.
TRANSITIONS = [[(accepted, State(to)) for accepted, to in row] for row in _native.transition_table()]


@dataclass(frozen=True)
class Sample:
    """State of a simulated module."""

    seconds: float  # since the start
    distance: float  # of the cable's far end, in m
    length: float  # of the cable that is out, without its stretch, in m
    tension: float  # of the cable, in N
    commanded: float  # tension that the firmware makes the motor pull with, in N
    current: float  # of the motor, in A
    brake_force: float  # that the pawl holds, in N
    state: State
    limit: Limit  # what keeps `commanded` from being what the host wants
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
        columns = table.T
        return cls(*columns[:7], *columns[7:9].astype(np.int64), *(columns[9:] != 0.0))


class SimulatedModule:
    """Simulated module: bytes in, bytes out, in lockstep with calls of `advance`.

    The firmware runs at 4 kHz, and time passes only in `advance` and `trace`. The far end of the cable is at a
    `distance` in m, where they put it; nothing else moves it. `plant` has changes to the hardware's parameters in
    `PLANT`. After any reset reason but power the module takes its motor for hot. `settings` is what an earlier
    module had stored. Damaged ones are left alone, as the firmware does: see `loaded`.

    An `InputError` refuses names that `PLANT` does not hold, and numbers that cannot be.
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
                raise InputError(f"the plant has no parameter {name!r}; it has {', '.join(PLANT)}")
            if not PLANT[name].lower <= value < math.inf:
                least = f"{PLANT[name].lower:g} {PLANT[name].unit}"
                raise InputError(f"plant parameter {name!r} is finite and at least {least}; got {value}")
        for name, number in (("serial_number", serial_number), ("seed", seed), ("start_us", start_us)):
            if not 0 <= number < 1 << 32:
                raise InputError(f"{name} is from 0 to 2**32 - 1; got {number}")
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
            raise InputError(f"a pause takes 0 to 60 s; got {seconds}")
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
    def tension(self) -> float:
        """Tension of the cable now, in N."""
        now: float = self._module.sample()[TENSION]
        return now

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

    def damage(self, part: str, *, broken: bool = True) -> None:
        """Break a part of the hardware, one of `PARTS`, or make it whole again."""
        if part not in PARTS:
            raise InputError(f"a module has no part {part!r}; it has {', '.join(PARTS)}")
        self._module.set_broken(part, broken)

    def _steps(self, seconds: float, distance: float | None) -> tuple[int, float]:
        if not 0.0 <= seconds < 1e6:
            raise InputError(f"time passes by 0 to 1e6 s; got {seconds}")
        if distance is not None:
            _require_distance(distance)
            self._distance = distance
        return round(seconds / STEP_S), self._distance


def _require_distance(distance: float) -> None:
    if not 0.0 < distance < math.inf:
        raise InputError(f"the cable's far end is at a finite distance of more than 0 m; got {distance}")


class HangingMass(SimulatedModule):
    """Simulated module with a mass in kg on its cable, above a floor so many m below the module.

    ``m x'' = m g - T``, with x down from the module and T the cable's tension; the floor takes all speed. The mass
    stands there at first, and may be changed then. Time passes as in `SimulatedModule`, but nobody else can move
    the far end.
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
            raise InputError("a hanging mass moves the cable's far end by itself; give no distance")
        for _ in range(round(seconds / STEP_S)):
            tension = self._module.sample()[TENSION]
            self._speed += (STANDARD_GRAVITY_M_S2 - tension / self.mass) * STEP_S
            self._place += self._speed * STEP_S
            if self._place >= self._floor:
                self._place, self._speed = self._floor, 0.0
            self._module.advance(1, self._place)
