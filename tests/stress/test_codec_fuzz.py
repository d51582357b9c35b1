"""Whatever comes over a link, no wrong frame passes, but by the chance that a CRC leaves.

The full million: ``python -m tests.stress.codec_fuzz``.
"""

from binascii import crc_hqx

import pytest

from tensionlab.hardware.protocol.frames import DELIMITER, MAX_PIECE, Decoder
from tests.helpers.examples import many
from tests.stress import codec_fuzz
from tests.stress.codec_fuzz import BY_CHANCE, CERTAIN, allowed, fuzz


def test_damaged_streams_raise_nothing_and_no_wrong_frame_passes():
    count = many(100_000)
    for kind, tally in fuzz(count, seed=1).items():
        assert tally.streams > 0.08 * count
        assert tally.pieces > 0.06 * count
        assert tally.wrong <= allowed(kind, tally), kind
        # Where eight bits flip, a delimiter is often among them, and takes both its neighbours along.
        assert (tally.whole > 0.015 * count) == (kind != "random bytes")


class Careless:
    """Decoder that compares so many bytes of a checksum, and whose pieces have at most so many bytes."""

    def __init__(self, compared=3, longest=MAX_PIECE):
        self.compared, self.longest, self.rest, self.bad_frames = compared, longest, b"", 0

    def feed(self, content):
        *ended, self.rest = (self.rest + content).split(DELIMITER)
        self.rest = self.rest[-self.longest :].lstrip(b"\0")
        return [frame for piece in ended if (frame := self.read(piece.lstrip(b"\0"))) is not None]

    def read(self, piece):
        stuffed, found = piece[:-3], piece[-3:]
        crc = crc_hqx(stuffed, 0xFFFF)
        right = bytes([0x80 | crc >> 9, 0x80 | crc >> 2 & 0x7F, 0xFC | crc & 3])
        if len(piece) > self.longest or found[: self.compared] != right[: self.compared]:
            return None
        return next(iter(Decoder().feed(stuffed + right + DELIMITER)), None)


def test_it_finds_nothing_wrong_with_one_that_compares_all(monkeypatch):
    monkeypatch.setattr(codec_fuzz, "Decoder", Careless)
    assert all(tally.wrong <= allowed(kind, tally) for kind, tally in fuzz(2_000).items())


@pytest.mark.parametrize("compared", [0, 1])
def test_it_finds_a_decoder_that_compares_too_little_of_the_checksum(monkeypatch, compared):
    monkeypatch.setattr(codec_fuzz, "Decoder", lambda: Careless(compared))
    tallies = fuzz(6_000)
    assert any(tallies[kind].wrong > allowed(kind, tallies[kind]) for kind in CERTAIN)


def test_it_finds_a_decoder_that_loses_its_way(monkeypatch):
    monkeypatch.setattr(codec_fuzz, "Decoder", lambda: Careless(longest=5))
    with pytest.raises(AssertionError, match="a whole frame was lost"):
        fuzz(len(CERTAIN) + len(BY_CHANCE))
