"""Frames on the host: the same as the firmware's, for whatever comes over the link."""

from binascii import crc_hqx

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensionlab import _native
from tensionlab.errors import ProtocolError
from tensionlab.hardware.protocol.messages import DELIMITER, MAX_PAYLOAD, MAX_PIECE, Decoder, WireFrame

FRAMES = st.builds(WireFrame, st.integers(0, 255), st.integers(0, 255), st.binary(max_size=MAX_PAYLOAD))
# Streams that are mostly frames, with damage in between.
PIECES = st.one_of(FRAMES.map(WireFrame.pack), st.binary(max_size=80), st.integers(1, 7).map(bytes))


def stated(frame):
    """What firmware/PROTOCOL.md says of a frame: stuffing, CRC in 7, 7 and 2 bits, delimiter."""
    runs = (bytes([frame.type, frame.sequence]) + frame.payload).split(b"\0")
    code, *rest = b"".join(bytes([len(run) + 1]) + run for run in runs)
    stuffed = bytes([code | 0xC0, *rest])
    crc = crc_hqx(stuffed, 0xFFFF)
    return stuffed + bytes([0x80 | crc >> 9, 0x80 | crc >> 2 & 0x7F, 0xFC | crc & 3]) + DELIMITER


def test_a_frame_worked_out_by_hand():
    # STOP with sequence number 7. No zero in it: one code byte 03 says so, whose upper bits are set.
    # The CRC of C3 05 07 is 0x3C29: 0011110 0001010 01 in binary.
    assert crc_hqx(b"\xc3\x05\x07", 0xFFFF) == 0x3C29
    assert WireFrame(0x05, 0x07).pack() == bytes.fromhex("c3 05 07 9e 8a fd 00 00 00")


@given(FRAMES)
def test_a_frame_comes_back(frame):
    packed = frame.pack()
    assert packed == stated(frame)
    assert len(packed) <= MAX_PIECE + len(DELIMITER)
    assert packed.index(0) == len(packed) - 3
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


@pytest.mark.parametrize("byte", [b"x", b"\0", b"x\0", b"x\0\0"])
def test_bytes_without_end_are_not_kept(byte):
    decoder = Decoder()
    for _ in range(100):
        assert decoder.feed(byte * 10_000) == []
        assert decoder._native.kept < 2 * MAX_PIECE + 10
    assert decoder.feed(DELIMITER + WireFrame(1, 2, b"three").pack()) == [WireFrame(1, 2, b"three")]
    assert decoder.bad_frames == (byte != b"\0")


@pytest.mark.parametrize("size", range(0, MAX_PAYLOAD + 1, 7))
@pytest.mark.parametrize("content", [b"\0", b"\xff", b"\1", b"\x10\0", WireFrame(6, 0).pack()[:-3] + b"\x80"])
def test_no_flipped_bit_lets_a_frame_pass_and_the_next_is_read(size, content):
    before, after = WireFrame(1, 1), WireFrame(2, 2)
    wire = WireFrame(3, 3, (content * MAX_PAYLOAD)[:size]).pack()
    for bit in range(8 * len(wire)):
        damaged = bytearray(wire)
        damaged[bit // 8] ^= 1 << bit % 8
        kept = [before] if damaged[-3:] != DELIMITER else [before, after]
        assert Decoder().feed(before.pack() + damaged + after.pack()) == kept


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
        WireFrame(*numbers).pack()
