"""Whatever comes over a link, no wrong frame passes, but by the chance that a CRC leaves.

The full million: ``python -m tensionlab.experiments.codec_fuzz``.
"""

import itertools
import random

import pytest

from tensionlab.experiments import codec_fuzz
from tensionlab.experiments.codec_fuzz import BY_CHANCE, CERTAIN, allowed, draw_frame, fuzz
from tensionlab.hardware import frames
from tensionlab.hardware.codes import Type
from tensionlab.hardware.frames import Decoder, Frame


def test_damaged_streams_raise_nothing_and_no_wrong_frame_passes():
    for kind, tally in fuzz(100_000, seed=1).items():
        assert tally.streams > 8000
        assert tally.pieces > 6000
        assert tally.wrong <= allowed(kind, tally), kind
        assert (tally.whole > 2000) == (kind != "random bytes")


@pytest.mark.parametrize("count", [1, 2])
def test_all_errors_of_one_and_two_bits_in_what_the_crc_covers_are_found(count):
    rng = random.Random(2)
    for frame in (draw_frame(rng) for _ in range(10 if count == 1 else 1)):
        packed = frame.pack()
        bits = list(itertools.product(codec_fuzz._covered(bytearray(packed)), range(8)))
        for flipped in itertools.combinations(bits, count):
            damaged = bytearray(packed)
            for place, bit in flipped:
                damaged[place] ^= 1 << bit
            if 0 not in damaged[:-1]:
                assert Decoder().feed(bytes(damaged)) == []


def test_the_crc_does_not_cover_the_stuffing():
    # Known: one bit of a stuffing byte moves several bytes, and then a CRC of 16 bits is right once in 65,536.
    sent = "058d9c86fe010101010103a18201010101010322b402ed022201010429d87002f201010101010101027f03cbfa00"
    damaged = bytearray.fromhex(sent)
    damaged[8] ^= 1 << 4
    [whole], [wrong] = Decoder().feed(bytes.fromhex(sent)), Decoder().feed(bytes(damaged))
    assert whole.type == wrong.type == Type.TELEMETRY
    assert whole != wrong


@pytest.mark.parametrize("bits", [0, 8])
def test_it_finds_a_decoder_whose_crc_is_too_short(monkeypatch, bits):
    def unpack(stuffed):
        try:
            body = bytes(frames.cobs.decode(stuffed))
        except frames.cobs.DecodeError:
            return None
        short = (1 << bits) - 1
        if not 4 <= len(body) <= 60 or (frames.crc16(body[:-2]) ^ int.from_bytes(body[-2:], "little")) & short:
            return None
        return Frame(body[0], body[1], body[2:-2])

    monkeypatch.setattr(frames, "unpack", unpack)
    tallies = fuzz(6_000)
    assert any(tallies[kind].wrong > allowed(kind, tallies[kind]) for kind in CERTAIN)


def test_it_finds_a_decoder_that_loses_its_way(monkeypatch):
    monkeypatch.setattr(frames, "MAX_FRAME", 10)
    with pytest.raises(AssertionError, match="a whole frame was lost"):
        fuzz(len(CERTAIN) + len(BY_CHANCE))
