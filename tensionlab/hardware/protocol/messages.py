"""Messages of the module protocol and their frames; ``firmware/PROTOCOL.md`` has the same as tables.

A message's fields, in their order, are its payload: little-endian, in SI units unless they say otherwise. A frame
is COBS(type, sequence number, payload), its CRC-16, and three zeros; one or two flipped bits are always detected.
Frames are coded by the firmware's own code, compiled in.

Payloads are not: a field of `Telemetry` is also in ``firmware/core/answers.cpp``, which writes it, and in
``tensionlab/native/hardware/endpoint.hpp``, which reads it; then run ``firmware/vectors.py``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from inspect import get_annotations
from typing import Annotated, Any, ClassVar, NamedTuple, Self, dataclass_transform, get_type_hints

from tensionlab import _native
from tensionlab.errors import ProtocolError
from tensionlab.hardware.protocol.codes import (
    BrakeState,
    Calibration,
    Code,
    Fault,
    Limit,
    ResetReason,
    State,
    Type,
)

# Most bytes of payload in a frame, and between two delimiters.
MAX_PAYLOAD, MAX_PIECE = _native.MAX_PAYLOAD, _native.MAX_PIECE
DELIMITER = b"\0\0\0"  # end of a frame. It takes three flips to make one of other bytes, none of which is zero.
CHECKSUM_BYTES = 3  # bytes of a checksum
PROTOCOL = 6  # version of the protocol; `Info` has the module's
MESSAGES: dict[int, type[Message]] = {}  # message class of each type of frame

# Layout of a field in the payload, as `struct` format characters.
U8 = Annotated[int, "B"]
U16 = Annotated[int, "H"]
U32 = Annotated[int, "I"]
U64 = Annotated[int, "Q"]
F32 = Annotated[float, "f"]
Flag = Annotated[bool, "?"]
Text = Annotated[str, ""]


class WireFrame(NamedTuple):
    """Frame: type (bit 7: from a module), sequence number (an answer has the command's) and payload."""

    type: int
    sequence: int
    payload: bytes = b""

    def pack(self) -> bytes:
        """Return the frame's bytes on the wire; a `ProtocolError` if a number or the payload is too large."""
        try:
            return _native.build_frame(*self)
        except ValueError as error:
            raise ProtocolError(str(error)) from None


class Decoder:
    """Decoder of a stream of bytes, however it is cut into pieces.

    `bad_frames` counts those that were damaged, too long or too short.
    """

    def __init__(self) -> None:
        self._native = _native.FrameDecoder()

    def feed(self, content: bytes) -> list[WireFrame]:
        """Return the frames that these bytes complete."""
        return [WireFrame(*fields) for fields in self._native.feed(content)]

    @property
    def bad_frames(self) -> int:
        """Number of bad frames up to now."""
        return self._native.bad_frames


class OtherProtocolError(ProtocolError):
    """Answer of a module that speaks another protocol."""

    def __init__(self, spoken: int) -> None:
        advice = "install the tensionlab that the module's firmware came with"
        if spoken < PROTOCOL:
            advice = "put the firmware of this tensionlab on the module (firmware/README.md)"
        super().__init__(f"speaks protocol {spoken}, this tensionlab {PROTOCOL}: {advice}")


@dataclass_transform(frozen_default=True)
class Message:
    """Message of one type of frame; each class below is a frozen dataclass of its fields."""

    type: ClassVar[Type]
    _finite: ClassVar[bool] = True
    _layout: ClassVar[struct.Struct]
    _kinds: ClassVar[dict[str, Callable[[Any], Any]]]
    _codes: ClassVar[tuple[tuple[int, Callable[[Any], Any]], ...]]

    def __init_subclass__(cls, type: Type) -> None:  # noqa: A002 - it is the frame's type
        hints = get_type_hints(cls, include_extras=True)
        layouts = {name: hints[name] for name in get_annotations(cls)}
        cls.type = type
        cls._layout = struct.Struct("<" + "".join(hint.__metadata__[0] for hint in layouts.values()))
        cls._kinds = {name: hint.__origin__ for name, hint in layouts.items()}
        kinds = enumerate(cls._kinds.values())
        cls._codes = tuple((at, cache(kind)) for at, kind in kinds if kind not in (int, float, bool))
        MESSAGES[type] = dataclass(frozen=True)(cls)

    def pack(self) -> bytes:
        """Return the payload; numbers too large, or (but in telemetry) not finite, are a `ProtocolError`."""
        values = vars(self).values()  # its fields, in their order
        try:
            if not self._finite or all(map(math.isfinite, values)):
                return self._layout.pack(*values)
        except (struct.error, OverflowError, TypeError) as error:
            raise ProtocolError(f"{self} cannot be sent: {error}") from error
        raise ProtocolError(f"{self} cannot be sent: all numbers must be finite")

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read a payload. A wrong length, and a value that has no name or is not finite, is a `ProtocolError`."""
        if len(payload) != cls._layout.size:
            raise ProtocolError(f"{cls.__name__} has {cls._layout.size} bytes of payload; got {len(payload)}")
        values = list(cls._layout.unpack(payload))
        if cls._finite and not all(map(math.isfinite, values)):
            name, value = next(pair for pair in zip(cls._kinds, values, strict=True) if not math.isfinite(pair[1]))
            raise ProtocolError(f"{cls.__name__}: {name} is {value}; all its numbers must be finite")
        try:
            for at, kind in cls._codes:
                values[at] = kind(values[at])
        except ValueError as error:
            raise ProtocolError(f"{cls.__name__}: {error}; does the module speak protocol {PROTOCOL}?") from error
        message = object.__new__(cls)
        # All at once: one by one, as the initialiser of a frozen class sets them, takes longer than all else.
        message.__dict__.update(zip(cls._kinds, values, strict=True))
        return message

    def frame(self, sequence: int) -> WireFrame:
        """Return the frame of this message."""
        return WireFrame(self.type, sequence, self.pack())


def printable(text: str) -> str:
    """Return a device's text with unprintable characters replaced."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


def read(frame: WireFrame) -> Message:
    """Return the message of a frame; an unknown type, or a payload that does not fit it, is a `ProtocolError`."""
    if frame.type not in MESSAGES:
        raise ProtocolError(f"no message has type 0x{frame.type:02x} in protocol {PROTOCOL}")
    return MESSAGES[frame.type].unpack(frame.payload)


class Hello(Message, type=Type.HELLO):
    """Request `Info`."""


class Arm(Message, type=Type.ARM):
    """Pull with the minimum tension and wait for set-points of this session, any number but 0.

    `stops` is that of `Info`.
    """

    session: U16
    stops: U8 = 0


class SetTension(Message, type=Type.SET_TENSION):
    """Pull with a tension in N until the next set-point, for at most `ttl_ms` (0: the module's own).

    `rounds` is how often the sequence numbers have begun again since ARM.
    """

    session: U16
    tension: F32
    brake: Flag = False
    ttl_ms: U16 = 0
    rounds: U8 = 0


class SetImpedance(Message, type=Type.SET_IMPEDANCE):
    """Render a spring, a damper and a vibration, at the module's own rate.

    Pull with ``feed_forward + stiffness max(length - rest, 0) + damping max(speed, 0) + amplitude sin(2 pi
    (frequency t + phase))`` N, in m, N/m, N s/m, Hz and turns, where speed is that of paying out and t is by the
    module's clock.
    """

    session: U16
    rest: F32
    stiffness: F32
    damping: F32
    feed_forward: F32
    amplitude: F32 = 0.0
    frequency: F32 = 0.0
    phase: F32 = 0.0
    brake: Flag = False
    ttl_ms: U16 = 0
    rounds: U8 = 0


class Stop(Message, type=Type.STOP):
    """Release the cable in any state, and be idle."""


class EmergencyStop(Message, type=Type.ESTOP):
    """Release the cable at once, and stay so until `Clear`."""


class Clear(Message, type=Type.CLEAR):
    """Leave fault or emergency stop."""


class GetParameter(Message, type=Type.GET_PARAMETER):
    """Request value and bounds of a parameter; the answer is `ParameterValue`."""

    index: U8


class SetParameter(Message, type=Type.SET_PARAMETER):
    """Change a parameter until the next start, or for good with `Save`."""

    index: U8
    value: F32


class Save(Message, type=Type.SAVE):
    """Store all parameters."""


class Calibrate(Message, type=Type.CALIBRATE):
    """Take over something measured, a length in m or the N/A; or find the motor's zero (value ignored)."""

    what: Annotated[Calibration, "B"]
    value: F32 = 0.0


class Ping(Message, type=Type.PING):
    """Send this number back in `Pong`, with the module's clock."""

    echo: U64


class ConfigureTelemetry(Message, type=Type.CONFIGURE_TELEMETRY):
    """Send `Telemetry` with this period, 5 ms or more; 0: never."""

    period_ms: U16


class Info(Message, type=Type.INFO):
    """Description of a module.

    firmware: major and minor version, a byte each; stops: how many STOP, ESTOP, CLEAR and ends of the link there
    were; session: the one that armed it last, 0 if none did; spool_radius in m; tension_continuous: what it may
    pull for good, in N.
    """

    protocol: U8
    firmware: U16
    serial_number: U32
    reset_reason: Annotated[ResetReason, "B"]
    state: Annotated[State, "B"]
    stops: U8
    session: U16
    calibrated: Flag
    length_known: Flag
    parameters: U8
    ttl_ms: U16
    tension_lower: F32
    tension_upper: F32
    newton_per_ampere: F32
    spool_radius: F32
    tension_continuous: F32

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read a payload; another protocol is an `OtherProtocolError`, impossible numbers a `ProtocolError`."""
        if payload and payload[0] != PROTOCOL:  # the rest may have changed
            raise OtherProtocolError(payload[0])
        info = super().unpack(payload)
        for name in ("ttl_ms", "tension_lower", "newton_per_ampere", "spool_radius", "tension_continuous"):
            if not getattr(info, name) > 0:
                raise ProtocolError(f"Info: {name} is {getattr(info, name):g}; it must be above 0")
        if info.tension_lower > info.tension_upper:
            lower, upper = info.tension_lower, info.tension_upper
            raise ProtocolError(f"Info: tension_lower {lower:g} is above tension_upper {upper:g}")
        return info


class ParameterValue(Message, type=Type.PARAMETER):
    """Value and bounds of a parameter."""

    index: U8
    value: F32
    lower: F32
    upper: F32


class Pong(Message, type=Type.PONG):
    """Echo of `Ping`, with the module's clock in us, which wraps around after 71 minutes."""

    echo: U64
    time_us: U32


class Telemetry(Message, type=Type.TELEMETRY):
    """Measurements and state of a module.

    `tension` is what the motor is commanded to, N; `current` as measured, A; `speed` of paying out, m/s;
    `bearable` what winding and driver bear now, N; `winding` the winding's estimated temperature, °C;
    `sequence` that of the last set-point; `lost_frames` those that found no room to be sent; `longest_step_us` the
    longest since the last telemetry.
    """

    _finite = False  # a sensor that fails may say anything

    time_us: U32
    state: Annotated[State, "B"]
    faults: Annotated[Fault, "H"]
    limit: Annotated[Limit, "B"]
    sequence: U8
    tension: F32
    current: F32
    length: F32
    speed: F32
    supply: F32
    bearable: F32
    winding: U8
    brake: Annotated[BrakeState, "B"]
    bad_frames: U16
    lost_frames: U16
    longest_step_us: U16


class Acknowledge(Message, type=Type.ACKNOWLEDGE):
    """Result of a command; `session` is the one that armed the module last, 0 if none did."""

    command: Annotated[Type, "B"]
    code: Annotated[Code, "B"]
    state: Annotated[State, "B"]
    session: U16 = 0


class Event(Message, type=Type.EVENT):
    """Change of state without a command."""

    state: Annotated[State, "B"]
    faults: Annotated[Fault, "H"]
    limit: Annotated[Limit, "B"]


class Log(Message, type=Type.LOG):
    """Line of text."""

    text: Text

    def pack(self) -> bytes:
        """Return the payload; text that is too long is cut."""
        return self.text.encode("ascii", "replace")[:MAX_PAYLOAD]

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read a payload; unprintable characters are replaced."""
        return cls(printable(payload.decode("ascii", "replace")))
