"""Codes and parameters of the module protocol and what they mean; the firmware has the same by the same names."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag

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


class State(IntEnum):
    """State of a module; ``firmware/README.md`` draws the transitions."""

    IDLE = 0
    ARMED = 1
    RUNNING = 2
    TIMEOUT = 3
    FAULT = 4
    ESTOP = 5


FOLLOWING_STATES = frozenset((State.ARMED, State.RUNNING))  # states in which a module pulls, and takes set-points
# States with the driver off that only CLEAR leaves: a STOP is refused.
LATCHED_STATES = frozenset((State.FAULT, State.ESTOP))
# States in which a module ignores set-points without having received a STOP.
RELEASED_STATES = LATCHED_STATES | {State.TIMEOUT}


class Code(IntEnum):
    """Result of a command: OK, or why it was refused or failed."""

    OK = 0
    UNKNOWN_TYPE = 1
    BAD_LENGTH = 2
    BAD_VALUE = 3
    BAD_STATE = 4
    BAD_SESSION = 5
    STALE = 6
    NOT_CALIBRATED = 7
    FAULT_PRESENT = 8
    UNKNOWN_PARAMETER = 9
    FAILED = 10


class Limit(IntEnum):
    """Limiter that keeps the tension from the commanded one; the strongest of several."""

    NONE = 0
    LOWER = 1
    UPPER = 2
    SLEW = 3
    THERMAL = 4
    SPEED = 5
    LENGTH = 6
    RELEASING = 7
    TIMEOUT = 8
    IDLE = 9


class Fault(IntFlag):
    """Faults of a module's hardware."""

    ENCODER = 1
    SUPPLY = 2
    SPEED = 4
    CURRENT = 8
    LOOP = 16
    MOTOR = 32
    CABLE = 64


class Calibration(IntEnum):
    """Quantity to calibrate: the cable's length, in m; the measured N/A; the motor's electrical zero."""

    LENGTH = 0
    NEWTON_PER_AMPERE = 1
    ENCODER = 2


class BrakeState(IntEnum):
    """State of the brake: a servo lays the pawl on and lifts it, after reeling in has unloaded it."""

    OPEN = 0
    CLOSING = 1
    CLOSED = 2
    RELEASING = 3
    OPENING = 4


class ResetReason(IntEnum):
    """Reason why a module started."""

    POWER = 0
    SOFTWARE = 1
    WATCHDOG = 2
    BROWNOUT = 3
    OTHER = 4


# The supervisor's events, in the order of the firmware's table.
EVENTS = ("arm", "set-point", "stop", "estop", "clear", "expire", "fault")

DESCRIPTIONS: dict[type[IntEnum | IntFlag], dict[str, str]] = {
    Code: {
        "OK": "done",
        "UNKNOWN_TYPE": "no such command in this firmware",
        "BAD_LENGTH": "the payload has another length than the command's",
        "BAD_VALUE": "a number is not finite, out of its bounds, or at odds with another parameter",
        "BAD_STATE": "not in this state, or not while the module is busy with something else",
        "BAD_SESSION": "the session is not the one that armed the module, or has armed it before",
        "STALE": "the sequence number is not after that of the last set-point (never sent: such a one is dropped)",
        "NOT_CALIBRATED": "N/A is not calibrated; or the cable's length is not known, for an impedance",
        "FAULT_PRESENT": "something is wrong with the hardware now; see the faults",
        "UNKNOWN_PARAMETER": "no parameter has this index",
        "FAILED": "it was tried, and did not work",
    },
    State: {
        "IDLE": "driver off; settings can be changed",
        "ARMED": "pulls with the minimum tension and waits for the first set-point",
        "RUNNING": "follows set-points",
        "TIMEOUT": "no set-point came in time, or the link closed: releases the cable in two stages",
        "FAULT": "a fault while the motor was driven: driver off at once",
        "ESTOP": "emergency stop: driver off at once",
    },
    Limit: {
        "NONE": "nothing",
        "LOWER": "the minimum tension, `tension_lower`",
        "UPPER": "`tension_upper`",
        "SLEW": "`slew`: on its way to the commanded tension",
        "THERMAL": "the winding's budget: `current_continuous`, `current_peak`, `thermal_time`",
        "SPEED": "the cable reels in faster than `speed_limit`",
        "LENGTH": "the cable is as short or as long as it may be: `length_lower`, `length_upper`",
        "RELEASING": "the brake is being released: at least `brake_release_tension`",
        "TIMEOUT": "the module timed out",
        "IDLE": "the driver is off, or going off",
    },
    Fault: {
        "ENCODER": "parity, error flag, magnet out of range, or a sensor's number is not finite",
        "SUPPLY": "outside `supply_lower` to `supply_upper`; the cut of the motor supply looks like this",
        "SPEED": "reels in at 1.4 times `speed_limit`, or pays out at 2.25 times for 0.1 s",
        "CURRENT": "measured above `current_peak` by half as much again, or none flows although commanded",
        "LOOP": "a step came more than 5 ms after the one before",
        "MOTOR": "voltage, current and speed are not those of one motor: a wrong electrical zero, N/A or phase",
        "CABLE": "nothing holds the cable: reels in more than 1 m at 1.1 times `speed_limit`, or more than "
        "`length_upper` before it was taut",
    },
    Calibration: {
        "LENGTH": "the cable is `value` m long now; not stored",
        "NEWTON_PER_AMPERE": "measured: `value` N/A; from then on the module counts as calibrated",
        "ENCODER": "find the motor's electrical zero; takes some 3 s and turns the spool by a pole pair; "
        "`value` is ignored",
    },
    BrakeState: {
        "OPEN": "lifted",
        "CLOSING": "the servo is on its way down",
        "CLOSED": "laid on: the cable reels in but does not pay out",
        "RELEASING": "reels in, to take the load off the pawl",
        "OPENING": "the servo is on its way up",
    },
    ResetReason: {
        "POWER": "it was switched on",
        "SOFTWARE": "a restart was commanded",
        "WATCHDOG": "its loop hung",
        "BROWNOUT": "its supply sank",
        "OTHER": "the reset button, a crash, or unknown",
    },
}  # what each code means


@dataclass(frozen=True)
class Parameter:
    """Row of the firmware's table: index in messages, unit, bounds and default."""

    index: int
    unit: str
    lower: float
    upper: float
    default: float


# The firmware's parameters, by name.
PARAMETERS = {row[0]: Parameter(index, *row[1:]) for index, row in enumerate(_native.parameter_table())}
# Parameters that are one of their two bounds.
BINARY_PARAMETERS = frozenset({"timeout_brake", "brake_on_fault", "motor_direction", "calibrated"})
PARAMETER_DESCRIPTIONS = {
    "tension_lower": "minimum tension of an armed module",
    "tension_upper": "the largest tension",
    "slew": "how fast the tension changes at most",
    "newton_per_ampere": "tension for each ampere; calibrated, not computed",
    "friction_coulomb": "dry friction at the cable, compensated",
    "friction_viscous": "friction that grows with speed, compensated",
    "current_continuous": "continuous rating of the winding",
    "current_peak": "peak rating of the winding, held for a while",
    "thermal_time": "time constant of the winding",
    "speed_limit": "reeling in faster, the module pulls less; at 1.4 times it faults",
    "length_lower": "cable that must stay out; shorter, it pulls only with the minimum tension",
    "length_upper": "cable there is; longer, it pulls only with the minimum tension",
    "spool_radius": "from encoder angle to cable length",
    "ttl": "time to live of a set-point that says none",
    "stiffness_limit": "of SET_IMPEDANCE",
    "damping_limit": "of SET_IMPEDANCE",
    "supply_lower": "below it the module faults",
    "supply_upper": "above it the module faults",
    "brake_open_pulse": "of the servo with the pawl lifted; measure it",
    "brake_closed_pulse": "of the servo with the pawl laid on; measure it",
    "brake_travel": "that the servo needs from one to the other; measure it",
    "brake_dwell": "least time between two changes",
    "brake_tooth": "cable from tooth to tooth of the brake's wheel",
    "brake_release_tension": "to reel the load off the pawl before it is lifted",
    "timeout_brake": "what the brake does when the module times out",
    "brake_on_fault": "after a fault, an emergency stop or a start: open for people, closed for loads",
    "motor_direction": "sign of the encoder while the cable pays out",
    "motor_zero": "electrical angle at the encoder's zero; CALIBRATE finds it",
    "calibrated": "whether the module may be armed; CALIBRATE sets it",
}  # what each parameter means


def single(value: float) -> float:
    """Return the 32-bit number that a module stores in place of this one."""
    try:
        stored: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return stored


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
