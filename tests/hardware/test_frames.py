"""Frames on the host: the same as the firmware's, for whatever comes over the link."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensionlab import _native
from tensionlab.errors import ProtocolError
from tensionlab.hardware.frames import MAX_FRAME, MAX_PAYLOAD, Decoder, Frame, crc16

FRAMES = st.builds(Frame, st.integers(0, 255), st.integers(0, 255), st.binary(max_size=MAX_PAYLOAD))
# Streams that are mostly frames, with damage in between.
PIECES = st.one_of(FRAMES.map(Frame.pack), st.binary(max_size=80), st.just(b"\0"))


def test_the_check_value_of_the_crc():
    assert crc16(b"123456789") == 0x29B1


def test_a_frame_worked_out_by_hand():
    # STOP with sequence number 7; its CRC is 0x921D, low byte first. No zero in it: one code byte says so.
    assert Frame(0x05, 0x07).pack() == bytes.fromhex("05 05 07 1d 92 00")


@given(FRAMES)
def test_a_frame_comes_back(frame):
    packed = frame.pack()
    assert packed == _native.build_frame(frame.type, frame.sequence, frame.payload)
    assert len(packed) <= MAX_FRAME
    assert packed.index(0) == len(packed) - 1
    assert Decoder().feed(packed) == [frame]


@given(st.lists(PIECES, max_size=8), st.data())
def test_both_sides_read_any_stream_alike_however_it_is_cut(pieces, data):
    stream = b"".join(pieces)
    decoder, frames = Decoder(), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        frames += decoder.feed(stream[:size])
        stream = stream[size:]
    expected, bad = _native.parse_frames(b"".join(pieces))
    assert [(frame.type, frame.sequence, frame.payload) for frame in frames] == expected
    assert decoder.bad_frames == bad


@pytest.mark.parametrize("rubbish", [b"\1\0", b"\5abc\0", b"\3ab\0", b"x" * 10_000 + b"\0", b"\xff" * 70 + b"\0"])
def test_rubbish_is_counted_and_the_next_frame_read(rubbish):
    decoder = Decoder()
    assert decoder.feed(rubbish + Frame(1, 2, b"three").pack()) == [Frame(1, 2, b"three")]
    assert decoder.bad_frames == 1


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ((256, 0), "type is one byte"),
        ((1, -1), "sequence is one byte"),
        ((1, 0, bytes(57)), "at most 56 bytes; got 57"),
    ],
)
def test_what_is_no_frame_is_refused(numbers, message):
    with pytest.raises(ProtocolError, match=message):
        Frame(*numbers)
