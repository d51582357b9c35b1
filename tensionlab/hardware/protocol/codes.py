"""The protocol's words that are numbers on the wire; the firmware's headers have the same, by the same names."""

from __future__ import annotations

from enum import IntEnum, IntFlag


class Type(IntEnum):
    """What a frame is: commands first, then what modules say."""

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
    """What a module is doing; `firmware/README.md` draws what leads from one to another."""

    IDLE = 0
    ARMED = 1
    RUNNING = 2
    TIMEOUT = 3
    FAULT = 4
    ESTOP = 5


LATCHED_STATES = frozenset((State.FAULT, State.ESTOP))
"""States in which a module has its driver off, and takes no STOP."""
RELEASED_STATES = LATCHED_STATES | {State.TIMEOUT}
"""States in which a module follows no set-points any more, without having been told to stop."""


class Code(IntEnum):
    """Why a command was refused or came to nothing; OK if it was not."""

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
    """What keeps the tension from being what the host wants, the one that bites most."""

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
    """What is wrong with a module's hardware."""

    ENCODER = 1
    SUPPLY = 2
    SPEED = 4
    CURRENT = 8
    LOOP = 16


class Calibration(IntEnum):
    """What to calibrate: the cable's length is now so many m; the measured N/A; the motor's electrical zero."""

    LENGTH = 0
    NEWTON_PER_AMPERE = 1
    ENCODER = 2


class BrakeState(IntEnum):
    """What the brake is doing: a servo lays it on and lifts it, and reeling in takes the load off it before."""

    OPEN = 0
    CLOSING = 1
    CLOSED = 2
    RELEASING = 3
    OPENING = 4


class ResetReason(IntEnum):
    """Why a module started."""

    POWER = 0
    SOFTWARE = 1
    WATCHDOG = 2
    BROWNOUT = 3
    OTHER = 4
