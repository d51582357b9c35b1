"""Datagrams of OSC: python-osc builds what is right; what is wrong is refused within bounds."""

import struct
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import OscBundleBuilder
from pythonosc.osc_message_builder import build_msg

from tensionlab.errors import ProtocolError
from tensionlab.haptics.bridge.osc_packet import MAX_DEPTH, MAX_MESSAGES, OscMessage, read_packet

HAND = build_msg("/body/hand", [0.5, 1.0, 2.0])
HEAD = b"#bundle\0" + struct.pack(">Q", 1)


def element(content, size=None):
    return struct.pack(">i", len(content) if size is None else size) + content


def nested(depth):
    content = HAND.dgram
    for _ in range(depth):
        content = HEAD + element(content)
    return content


@settings(max_examples=50)
@given(
    st.lists(
        st.one_of(
            st.text("abc é", max_size=9), st.booleans(), st.floats(width=32), st.integers(-(2**31), 2**31 - 1)
        )
    )
)
def test_what_another_library_builds_is_read(values):
    read = read_packet(build_msg("/effect/a", values).dgram)
    assert read.time is None
    assert repr(read.messages) == repr([OscMessage("/effect/a", values)])


def test_a_bundle_tells_its_time():
    bundle = OscBundleBuilder(1.7e9 + 0.25)
    bundle.add_content(HAND)
    bundle.add_content(build_msg("/effect/a", []))
    read = read_packet(bundle.build().dgram)
    assert read.time == pytest.approx(1.7e9 + 0.25, abs=1e-6)
    assert [message.address for message in read.messages] == ["/body/hand", "/effect/a"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (HEAD + element(HAND.dgram, -16), "an element of -16 bytes"),
        (HEAD + element(HAND.dgram, 0), "an element of 0 bytes"),
        (HEAD + element(HAND.dgram, 2**31 - 1), "an element of 2147483647 bytes"),
        (nested(MAX_DEPTH + 1), f"more than {MAX_DEPTH} deep"),
        (HEAD + element(HAND.dgram) * (MAX_MESSAGES + 1), f"more than {MAX_MESSAGES} messages"),
        (b"#bundle\0", "time tag is missing"),
        (HAND.dgram[:-4], "end too early"),
        (HAND.dgram[:-1], "multiples of 4"),
        (HAND.dgram + bytes(4), "4 bytes after the last argument"),
        (b"", "a text without an end"),
        (b"body\0\0\0\0", "begins with 'b'"),
        (b"/bod", "a text without an end"),
        (b"/\xff\0\0", "not UTF-8"),
        (b"/a\0\0ff\0\0", "no type tags"),
        (b"/a\0\0,b\0\0\0\0\0\0", "the type tag 'b'"),
    ],
)
def test_what_is_wrong_is_refused_in_words(data, said):
    with pytest.raises(ProtocolError) as refused:
        read_packet(data)
    assert said in str(refused.value)


@settings(max_examples=300)
@given(
    st.one_of(st.binary(max_size=200), st.binary(max_size=100).map(lambda tail: HEAD + tail)), st.integers(0, 60)
)
def test_nothing_but_a_refusal_comes_of_garbage(garbage, at):
    for data in (garbage, HAND.dgram[:at] + garbage[:1] + HAND.dgram[at + 1 :]):
        with suppress(ProtocolError):
            read_packet(data)
