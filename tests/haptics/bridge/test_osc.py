"""OSC: python-osc builds what is right, and what is wrong is refused within bounds; places go from end to end."""

import struct
from contextlib import closing, suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import OscBundleBuilder
from pythonosc.osc_message_builder import build_msg

from tensionlab.errors import ProtocolError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import MAX_MESSAGES, OscMessage, OscServer, read_packet
from tensionlab.scenarios import load_scenario
from tests.helpers.examples import many
from tests.helpers.tracked import bundle_of

HAND_MESSAGE = build_msg("/body/hand", [0.5, 1.0, 2.0])
# A rig with the torso as a body.
RIG = load_scenario("collision").rig
HAND, HIP = np.array([0.1, 0.2, 0.3]), np.array([-0.5, 0.0, 1.0])
HEAD = b"#bundle\0" + struct.pack(">Q", 1)


def element(content, size=None):
    return struct.pack(">i", len(content) if size is None else size) + content


@settings(max_examples=many(50))
@given(st.lists(st.one_of(st.text("abc é", max_size=9), st.floats(width=32), st.integers(-(2**31), 2**31 - 1))))
def test_what_another_library_builds_is_read(values):
    read = read_packet(build_msg("/effect/a", values).dgram)
    assert read.time is None
    assert repr(read.messages) == repr([OscMessage("/effect/a", values)])


def test_a_bundle_tells_its_time():
    bundle = OscBundleBuilder(1.7e9 + 0.25)
    bundle.add_content(HAND_MESSAGE)
    bundle.add_content(build_msg("/effect/a", []))
    read = read_packet(bundle.build().dgram)
    assert read.time == pytest.approx(1.7e9 + 0.25, abs=1e-6)
    assert [message.address for message in read.messages] == ["/body/hand", "/effect/a"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (HEAD + element(HAND_MESSAGE.dgram, -16), "an element of -16 bytes"),
        (HEAD + element(HAND_MESSAGE.dgram, 0), "an element of 0 bytes"),
        (HEAD + element(HAND_MESSAGE.dgram, 2**31 - 1), "an element of 2147483647 bytes"),
        (HEAD + element(HEAD + element(HAND_MESSAGE.dgram)), "begins with '#'"),
        (HEAD + element(HAND_MESSAGE.dgram) * (MAX_MESSAGES + 1), f"more than {MAX_MESSAGES} messages"),
        (b"#bundle\0", "time tag is missing"),
        (HAND_MESSAGE.dgram[:-4], "end too early"),
        (HAND_MESSAGE.dgram[:-1], "multiples of 4"),
        (HAND_MESSAGE.dgram + bytes(4), "4 bytes after the last argument"),
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


@settings(max_examples=many(300))
@given(
    st.one_of(st.binary(max_size=200), st.binary(max_size=100).map(lambda tail: HEAD + tail)), st.integers(0, 60)
)
def test_nothing_but_a_refusal_comes_of_garbage(garbage, at):
    for data in (garbage, HAND_MESSAGE.dgram[:at] + garbage[:1] + HAND_MESSAGE.dgram[at + 1 :]):
        with suppress(ProtocolError):
            read_packet(data)


def test_all_bodies_of_a_bundle_come_as_one_frame_of_the_time_that_its_tag_tells():
    box = ClientState(RIG)
    door = OscServer(box, "127.0.0.1", 0, print)
    with closing(door._socket):
        for number in range(2):  # 20 ms apart, by the tags
            data = bundle_of({"hand": HAND * number, "torso": HIP * number}, 1.7e9 + 0.02 * number)
            assert door.receive(data, "127.0.0.1")
    before, latest = box._frames
    assert latest.frame.time - before.frame.time == pytest.approx(0.02, abs=1e-6)
    assert set(latest.frame.bodies) == {"hand", "torso"}
    for frame, share in ((before, 0.0), (latest, 1.0)):
        np.testing.assert_allclose(frame.frame.bodies["hand"].position, share * HAND, atol=1e-7)
        np.testing.assert_allclose(frame.frame.bodies["torso"].position, share * HIP, atol=1e-7)
