"""Simulated module: the firmware's own core, compiled, with motor, spool, cable and brake simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.hardware.protocol.codes import PARAMETERS, Fault, Limit, ResetReason, State
from tensionlab.model.module import STANDARD_GRAVITY_M_S2
from tensionlab.support.arrays import Floats


class PlantParameter(NamedTuple):
    """Parameter of the simulated hardware, and where its value comes from."""

    unit: str
    lower: float
    default: float
    about: str


# The simulated hardware's parameters, by name.
PLANT = {row[0]: PlantParameter(*row[1:]) for row in _native.plant_table()}
PARTS = tuple(_native.plant_parts())  # parts that can fail
STEP_S = 1e-6 * _native.step_microseconds()  # time from one step of the firmware to the next, in s
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
    winding: float  # temperature of the motor's winding, in °C
    estimated_winding: float  # by the firmware
    state: State
    limit: Limit  # what keeps `commanded` from being what the host wants
    driver_on: bool
    pawl_down: bool


Trace = np.recarray[Any, Any]  # a row as in `Sample` after each step of the firmware
_KINDS = {"float": float, "bool": bool}  # others are integers
_TRACE = np.dtype([(name, _KINDS.get(str(kind), int)) for name, kind in Sample.__annotations__.items()])
COLUMNS = {name: index for index, name in enumerate(Sample.__annotations__)}  # of native samples
TENSION, DRIVER_ON = COLUMNS["tension"], COLUMNS["driver_on"]


class SimulatedModule:
    """Simulated module: bytes in, bytes out, in lockstep with calls of `advance`.

    The firmware runs at 4 kHz. Time passes, and the cable's far end moves to a `distance` in m, only in `advance`
    and `trace`. `plant` replaces parameters in `PLANT`. After any reset reason but power the module assumes a hot
    motor. `settings` is what an earlier module stored; `loaded` is whether it was intact.
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
        plant = dict(plant or {})
        for name, value in plant.items():
            if name not in PLANT:
                raise InputError(f"the plant has no parameter {name!r}; it has {', '.join(PLANT)}")
            row = PLANT[name]
            if not row.lower <= value < math.inf:
                minimum = f"{row.lower:g} {row.unit}"
                raise InputError(f"plant parameter {name!r} is finite and at least {minimum}; got {value}")
        _require_distance(distance)
        self._distance = distance
        self._module = _native.SimulatedModule(serial_number, plant, distance, seed, start_us, reset_reason)
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
        return np.rec.fromarrays(self.samples(seconds, distance).T, dtype=_TRACE)

    def samples(self, seconds: float, distance: float | None = None) -> Floats:
        """Return the rows of `trace` as numbers, (K, 11), without the time that records take."""
        return self._module.trace(*self._steps(seconds, distance))

    def pause(self, seconds: float) -> None:
        """Delay the firmware's next step by some seconds, as if its loop hung."""
        self._module.pause(round(1e6 * seconds))

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return float(self._module.sample()[0])

    @property
    def sample(self) -> Sample:
        """State of the module now."""
        values = self._module.sample()
        return Sample(*values[:9], State(values[9]), Limit(values[10]), *values[11:])

    @property
    def tension(self) -> float:
        """Tension of the cable now, in N."""
        return float(self._module.sample()[TENSION])

    @property
    def faults(self) -> Fault:
        """Faults that the firmware finds now, or found before and that were not cleared."""
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
        """Break a part of the hardware, one of `PARTS`, or repair it."""
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


FLOOR_M = 1.0


class HangingMass(SimulatedModule):
    """Simulated module with a mass in kg on its cable, first on a floor `FLOOR_M` below the module.

    ``m x'' = m g - T``, with x down from the module and T the cable's tension; the floor takes all speed. On the
    floor, `mass` may be changed.
    """

    def __init__(self, mass: float, *, plant: Mapping[str, float] | None = None, seed: int = 0) -> None:
        super().__init__(plant=plant, distance=FLOOR_M, seed=seed)
        self.mass, self._place, self._speed = mass, FLOOR_M, 0.0
        self.advance(STEP_S)  # before its first step, a module knows nothing

    def advance(self, seconds: float, distance: float | None = None) -> None:
        """Let time pass, rounded to steps of the firmware."""
        if distance is not None:
            raise InputError("a hanging mass moves the cable's far end by itself; give no distance")
        for _ in range(round(seconds / STEP_S)):
            tension = self._module.sample()[TENSION]
            self._speed += (STANDARD_GRAVITY_M_S2 - tension / self.mass) * STEP_S
            self._place += self._speed * STEP_S
            if self._place >= FLOOR_M:
                self._place, self._speed = FLOOR_M, 0.0
            self._module.advance(1, self._place)
