"""Codes and parameters of the module protocol and what they mean; the firmware has the same by the same names."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Self

from tensionlab import _native
from tensionlab.errors import ProtocolError


class Type(IntEnum):
    """Type of a frame: commands first, then answers and telemetry."""

    HELLO = 0x01
    ARM = 0x02
    SET_TENSION = 0x03
    SET_IMPEDANCE = 0x04
    STOP = 0x05
    ESTOP = 0x06
    CLEAR = 0x07
    GET_PARAMETER = 0x08
    SET_PARAMETER = 0x09
    SAVE = 0x0A
    CALIBRATE = 0x0B
    PING = 0x0C
    CONFIGURE_TELEMETRY = 0x0D
    INFO = 0x81
    PARAMETER = 0x88
    PONG = 0x8C
    TELEMETRY = 0x8D
    ACKNOWLEDGE = 0x90
    EVENT = 0x91
    LOG = 0x92


class DescribedCode(IntEnum):
    """Code with a meaning in words."""

    meaning: str

    def __new__(cls, number: int, meaning: str = "") -> Self:  # noqa: D102 - documented by the class
        member = int.__new__(cls, number)
        member._value_, member.meaning = number, meaning
        return member


class State(DescribedCode):
    """State of a module; ``firmware/README.md`` draws the transitions."""

    IDLE = 0, "driver off; settings can be changed"
    ARMED = 1, "pulls with the minimum tension and waits for the first set-point"
    RUNNING = 2, "follows set-points"
    TIMEOUT = 3, "no set-point came in time, or the link closed: releases the cable in two stages"
    FAULT = 4, "a fault while the motor was driven: driver off at once"
    ESTOP = 5, "emergency stop: driver off at once"


FOLLOWING_STATES = frozenset((State.ARMED, State.RUNNING))  # states in which a module pulls, and takes set-points
# States with the driver off that only CLEAR leaves: a STOP is refused.
LATCHED_STATES = frozenset((State.FAULT, State.ESTOP))
# States in which a module ignores set-points without having received a STOP.
RELEASED_STATES = LATCHED_STATES | {State.TIMEOUT}


class Code(DescribedCode):
    """Result of a command: OK, or why it was refused or failed."""

    OK = 0, "done"
    UNKNOWN_TYPE = 1, "no such command in this firmware"
    BAD_LENGTH = 2, "the payload has another length than the command's"
    BAD_VALUE = 3, "a number is not finite, out of its bounds, or inconsistent with another parameter"
    BAD_STATE = 4, "not in this state, or while the module is busy"
    BAD_SESSION = 5, "the session is not the one that armed the module, or armed it last and would again"
    STALE = 6, "the sequence number is not after that of the last set-point (never sent: the set-point is dropped)"
    NOT_CALIBRATED = 7, "N/A is not calibrated; or the cable's length is not known, for an impedance"
    FAULT_PRESENT = 8, "the hardware has a fault now"
    UNKNOWN_PARAMETER = 9, "no parameter has this index"
    FAILED = 10, "the command failed"
    STOPPED = 11, "a STOP, ESTOP, CLEAR or end of the link came after the INFO that ARM quotes"


class Limit(DescribedCode):
    """Limiter that keeps the tension from the commanded one; the strongest of several."""

    NONE = 0, "nothing"
    LOWER = 1, "the minimum tension, `tension_lower`"
    UPPER = 2, "`tension_upper`"
    SLEW = 3, "`slew`: on its way to the commanded tension"
    THERMAL = 4, "the temperature of winding or driver, or `current_peak`"
    SPEED = 5, "the cable reels in faster than `speed_limit`"
    LENGTH = 6, "the cable is at its shortest or longest: `length_lower`, `length_upper`"
    RELEASING = 7, "the brake is being released: at least `brake_release_tension`"
    TIMEOUT = 8, "the module timed out"
    IDLE = 9, "the driver is off, or going off"


class Fault(IntFlag):
    """Faults of a module's hardware, each with a meaning in words."""

    meaning: str

    def __new__(cls, number: int, meaning: str = "") -> Self:  # noqa: D102 - documented by the class
        member = int.__new__(cls, number)
        member._value_, member.meaning = number, meaning
        return member

    ENCODER = 1, "parity, error flag, magnet out of range, or a sensor's number is not finite"
    SUPPLY = 2, "outside `supply_lower` to `supply_upper`; also after a cut of the motor supply"
    SPEED = 4, "reels in at 1.4 times `speed_limit`, or pays out at 2.25 times for 0.1 s"
    CURRENT = 8, "measured 1.5 times `current_peak`, or none although commanded"
    LOOP = 16, "a step came more than 5 ms after the one before"
    MOTOR = 32, "voltage, current and speed are not those of one motor: a wrong electrical zero, N/A or phase"
    CABLE = (
        64,
        "nothing holds the cable: reels in more than 1 m at 1.1 times `speed_limit`, or more "
        "than `length_upper` before it was taut",
    )


class Calibration(DescribedCode):
    """Quantity to calibrate: the cable's length, in m; the measured N/A; the motor's electrical zero."""

    LENGTH = 0, "the cable is `value` m long now; not stored"
    NEWTON_PER_AMPERE = 1, "measured: `value` N/A; from then on the module counts as calibrated"
    ENCODER = (
        2,
        "find the motor's electrical zero; takes about 3 s and turns the spool by a pole pair; `value` is ignored",
    )


class BrakeState(DescribedCode):
    """State of the brake: a servo lays the pawl on and lifts it, after reeling in has unloaded it."""

    OPEN = 0, "lifted"
    CLOSING = 1, "the servo is on its way down"
    CLOSED = 2, "laid on: the cable reels in but does not pay out"
    RELEASING = 3, "reels in, to take the load off the pawl"
    OPENING = 4, "the servo is on its way up"


class ResetReason(DescribedCode):
    """Reason why a module started."""

    POWER = 0, "it was switched on"
    SOFTWARE = 1, "a restart was commanded"
    WATCHDOG = 2, "its loop hung"
    BROWNOUT = 3, "its supply voltage dropped"
    OTHER = 4, "the reset button, a crash, or unknown"


# The supervisor's events, in the order of the firmware's table.
EVENTS = ("arm", "set-point", "stop", "estop", "clear", "expire", "fault")


@dataclass(frozen=True)
class Parameter:
    """Row of the firmware's table: index in messages, unit, bounds, default, and meaning."""

    index: int
    unit: str
    lower: float
    upper: float
    default: float
    meaning: str


_MEANINGS = {
    "tension_lower": "minimum tension of an armed module",
    "tension_upper": "largest tension",
    "slew": "largest rate of change of the tension",
    "newton_per_ampere": "tension for each ampere; calibrated, not computed",
    "friction_coulomb": "dry friction at the cable, compensated",
    "friction_viscous": "friction that grows with speed, compensated",
    "current_peak": "largest current of the motor",
    "ambient": "warmest room that the module works in",
    "winding_limit": "largest temperature of the winding, as estimated",
    "winding_resistance": "resistance of a motor phase at 20 °C",
    "winding_to_housing": "thermal resistance from the winding to the motor's housing",
    "housing_to_ambient": "thermal resistance from the housing to the room",
    "winding_capacity": "heat capacity of the winding",
    "housing_capacity": "heat capacity of the motor without its winding",
    "thermistor_resistance": "thermistor on the housing, at 25 °C; 0: none",
    "thermistor_beta": "constant of the thermistor",
    "speed_limit": "speed of reeling in above which the module pulls less; at 1.4 times it faults",
    "length_lower": "shortest cable length; below, the module pulls only with the minimum tension",
    "length_upper": "length of the cable; above, the module pulls only with the minimum tension",
    "spool_radius": "cable length per encoder angle",
    "ttl": "time to live of a set-point without its own",
    "stiffness_limit": "largest stiffness of SET_IMPEDANCE",
    "damping_limit": "largest damping of SET_IMPEDANCE",
    "supply_lower": "lowest supply voltage; below it the module faults",
    "supply_upper": "highest supply voltage; above it the module faults",
    "brake_open_pulse": "servo pulse with the pawl lifted; measure it",
    "brake_closed_pulse": "servo pulse with the pawl laid on; measure it",
    "brake_travel": "time of the servo from one to the other; measure it",
    "brake_dwell": "shortest time between two changes of the brake",
    "brake_tooth": "cable from tooth to tooth of the brake's wheel",
    "brake_release_tension": "tension that takes the load off the pawl before it is lifted",
    "timeout_brake": "brake after a timeout",
    "brake_on_fault": "brake after a fault, emergency stop or start: open for people, closed for loads",
    "motor_direction": "sign of the encoder while the cable pays out",
    "motor_zero": "electrical angle at the encoder's zero; CALIBRATE finds it",
    "calibrated": "whether the module may be armed; CALIBRATE sets it",
}  # of the parameters
# The firmware's parameters, by name.
PARAMETERS = {
    row[0]: Parameter(index, *row[1:], meaning=_MEANINGS[row[0]])
    for index, row in enumerate(_native.parameter_table())
}
# Parameters that are one of their two bounds.
BINARY_PARAMETERS = frozenset({"timeout_brake", "brake_on_fault", "motor_direction", "calibrated"})


def single(value: float) -> float:
    """Return the 32-bit number that a module stores in place of this one; infinity if it is too large."""
    return array("f", [value])[0]


def require_name(name: str) -> Parameter:
    """Return a parameter by its name; a `ProtocolError` lists the names there are."""
    if name not in PARAMETERS:
        raise ProtocolError(f"modules have no parameter {name!r}; they have {', '.join(PARAMETERS)}")
    return PARAMETERS[name]


def require_value(name: str, value: float, origin: str) -> float:
    """Return a value as a module stores it; a `ProtocolError` says what the bounds are."""
    row, stored = require_name(name), single(value)
    if not row.lower <= stored <= row.upper:
        raise ProtocolError(f"{origin}: {name} is from {row.lower:g} to {row.upper:g} {row.unit}; got {value:g}")
    return stored
