"""Messages on the host: what they lie like in a payload, and what is refused."""

import math
import re
import struct
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensionlab.errors import HardwareError, ProtocolError
from tensionlab.hardware.protocol import codes
from tensionlab.hardware.protocol.codes import PARAMETERS, Fault, Type, require_value, single
from tensionlab.hardware.protocol.messages import (
    MAX_PAYLOAD,
    MESSAGES,
    PROTOCOL,
    Info,
    Log,
    SetTension,
    Telemetry,
    WireFrame,
    read,
)

CORE = Path(__file__).parents[3] / "firmware" / "core"
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)


def any_message(kind):
    """A message of this class with any values that fit."""
    values = {}
    for name, size in zip(kind._kinds, kind._layout.format[1:], strict=True):
        of = kind._kinds[name]
        if issubclass(of, codes.IntEnum):
            values[name] = st.sampled_from(of)
        elif issubclass(of, codes.IntFlag):
            values[name] = st.integers(0, 31).map(of)
        elif of is int:
            values[name] = st.integers(0, 256 ** struct.calcsize(size) - 1)
        else:
            values[name] = st.booleans() if of is bool else FLOATS
    if kind is Info:  # what no module has is refused
        above = st.floats(2.0**-100, 2.0**100, width=32)
        values |= {"protocol": st.just(PROTOCOL), "ttl_ms": st.integers(1, 0xFFFF)}
        values |= dict.fromkeys(("newton_per_ampere", "spool_radius", "tension_continuous"), above)
        values |= {"tension_lower": st.just(0.5), "tension_upper": st.floats(0.5, 2.0**100, width=32)}
    return st.builds(kind, **values)


MESSAGE = st.sampled_from([kind for kind in MESSAGES.values() if kind is not Log]).flatmap(any_message)


def test_every_type_has_a_message_and_answers_have_bit_7():
    assert set(MESSAGES) == set(Type)
    assert all(kind.type == type_ for type_, kind in MESSAGES.items())
    assert {type_.name for type_ in Type if type_ & 0x80} == {
        "INFO", "PARAMETER", "PONG", "TELEMETRY", "ACKNOWLEDGE", "EVENT", "LOG"
    }  # fmt: skip


@given(MESSAGE, st.integers(0, 255))
def test_a_message_comes_back(message, sequence):
    frame = message.frame(sequence)
    assert (frame.type, frame.sequence) == (message.type, sequence)
    back = read(frame)
    assert back == message
    for field in fields(message):  # a State is not just a number
        assert type(getattr(back, field.name)) is type(getattr(message, field.name))


@given(st.text(max_size=80))
def test_a_line_of_text_is_cut_and_has_only_printable_ascii(text):
    shown = text.encode("ascii", "replace").decode()[:MAX_PAYLOAD]
    assert read(Log(text).frame(0)) == Log(re.sub(r"[\0-\x1f\x7f]", "\ufffd", shown))


def test_a_payload_worked_out_by_hand():
    packed = SetTension(0x0102, 1.5, brake=True, ttl_ms=250, rounds=3).pack()
    assert packed == bytes.fromhex("0201 0000c03f 01 fa00 03")
    assert Telemetry.unpack(bytes(41)).faults == Fault(0)


def parameter(value):
    return WireFrame(Type.PARAMETER, 0, struct.pack("<Bfff", 0, value, 0.0, 1.0))


def info(**changes):
    usual = {"tension_lower": 0.5, "tension_upper": 6.0, "newton_per_ampere": 3.0, "spool_radius": 0.02}
    usual |= {"tension_continuous": 3.0}
    numbers = (usual | changes).values()
    return WireFrame(
        Type.INFO, 0, struct.pack("<BHI3BH3BH5f", PROTOCOL, 1, 1, 0, 0, 0, 0, 1, 1, 28, 250, *numbers)
    )


@pytest.mark.parametrize(
    ("session", "tension"),
    [
        *((1, value) for value in (math.nan, math.inf, -math.inf, 1e39)),
        (-1, 1.0),
        (65536, 1.0),
        ("one", 1.0),
        (1.5, 1.0),
    ],
)
def test_numbers_that_do_not_fit_are_not_sent(session, tension):
    with pytest.raises(ProtocolError, match=r"SetTension\(session=.* cannot be sent"):
        SetTension(session, tension).pack()


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (WireFrame(0x7F, 0), "no message has type 0x7f in protocol 6"),
        (WireFrame(Type.PONG, 0, bytes(11)), "Pong has 12 bytes of payload; got 11"),
        (WireFrame(Type.ACKNOWLEDGE, 0, bytes([1, 99, 0, 0, 0])), "Acknowledge: 99 is not a valid Code; does"),
        (WireFrame(Type.EVENT, 0, bytes([9, 0, 0, 0])), "Event: 9 is not a valid State"),
        (WireFrame(Type.INFO, 0), "Info has 37 bytes of payload; got 0"),
        (WireFrame(Type.INFO, 0, b"\2earlier"), "speaks protocol 2, this tensionlab 6: put the firmware"),
        (WireFrame(Type.INFO, 0, b"\7later, and longer"), "speaks protocol 7, this tensionlab 6: install the"),
        (parameter(math.nan), "ParameterValue: value is nan; all its numbers must be finite"),
        (parameter(math.inf), "value is inf"),
        (info(tension_lower=-math.inf), "Info: tension_lower is -inf"),
        (info(tension_lower=-1.0), "Info: tension_lower is -1; it must be above 0"),
        (info(tension_lower=9.0), "Info: tension_lower 9 is above tension_upper 6"),
        (info(spool_radius=0.0), "Info: spool_radius is 0; it must"),
        (info(newton_per_ampere=-0.0), "Info: newton_per_ampere is -0"),
    ],
)
def test_what_cannot_be_understood_says_why(frame, message):
    with pytest.raises(ProtocolError, match=message) as raised:
        read(frame)
    assert isinstance(raised.value, HardwareError)


def test_small_numbers_of_a_module_are_numbers():
    assert read(info(spool_radius=5e-4, tension_lower=1e-4)).spool_radius == pytest.approx(5e-4)


@pytest.mark.parametrize("name", PARAMETERS)
def test_values_of_parameters_are_bounded_as_the_module_stores_them(name):
    row = PARAMETERS[name]
    for value in (row.lower, row.upper, (row.lower + row.upper) / 2):
        assert require_value(name, value, "here") == single(value)
    for value in (row.lower - 0.01 * max(abs(row.lower), 1.0), 1.01 * row.upper + 0.01, math.nan):
        with pytest.raises(ProtocolError, match=f"here: {name} is from {row.lower:g} to {row.upper:g} "):
            require_value(name, value, "here")
    with pytest.raises(ProtocolError, match=f"no parameter 'x{name}'; they have .*{name}"):
        require_value(f"x{name}", row.lower, "here")


def test_faults_of_a_later_firmware_are_kept():
    faults = Telemetry.unpack(bytes(5) + b"\x21\x00" + bytes(34)).faults
    assert faults == Fault.ENCODER | 0x20


@pytest.mark.parametrize(
    ("enum", "header", "declaration"),
    [
        (codes.Type, "messages.hpp", "enum class Type"),
        (codes.Code, "messages.hpp", "enum class Code"),
        (codes.Calibration, "messages.hpp", "enum class Calibration"),
        (codes.State, "supervisor.hpp", "enum class State"),
        (codes.Limit, "limiter.hpp", "enum class Limit"),
        (codes.BrakeState, "brake.hpp", "enum class BrakeState"),
        (codes.ResetReason, "module.hpp", "enum class ResetReason"),
        (codes.Fault, "monitor.hpp", "enum Fault"),
    ],
)
def test_words_are_those_of_the_firmware(enum, header, declaration):
    text = (CORE / header).read_text()
    body = re.search(declaration + r"[^{]*\{(.*?)\}", text, re.DOTALL)[1]
    words = {}
    lines = re.sub(r"//.*", "", body).replace(", ", ",\n")
    for word, number in re.findall(r"(\w+)(?: = (\w+))?,? *(?:\n|$)", lines):
        words[re.sub("^kFault", "", word).upper()] = int(number, 0) if number else len(words)
    assert words == {member.name: member.value for member in enum}
