"""Streams of frames, damaged in many ways: no damaged frame passes, except by the chance that a checksum leaves.

Errors of one and two bits are always found, wherever they are, and those of three bits that neither make nor
remove a zero. Other damage passes with a chance of 2^-16, or less where it hits the checksum, eight of whose bits
are fixed. `firmware/fuzz/flips.cpp` flips all one and two bits of frames.
"""

import random
from contextlib import suppress
from math import sqrt

import pytest

from tensionlab.errors import ProtocolError
from tensionlab.hardware.protocol.codes import Type
from tensionlab.hardware.protocol.messages import (
    DELIMITER,
    MAX_PAYLOAD,
    PROTOCOL,
    Decoder,
    WireFrame,
    read,
)
from tests.stress import cases

CHANCE = 2.0**-16  # that the checksum of anything is right
AFTER = WireFrame(Type.PING, 0xA5, b"afterall")  # sent after each stream; the decoder must find it


def payload_lengths():
    """Return the lengths that the payload of each type may have."""
    found = {}
    for kind in Type:
        byte = PROTOCOL if kind is Type.INFO else 1  # which means something in every field
        for length in range(MAX_PAYLOAD + 1):
            with suppress(ProtocolError):
                read(WireFrame(kind, 0, bytes([byte]) * length))
                found.setdefault(kind, []).append(length)
    return found


LENGTHS = payload_lengths()


def draw_frame(rng):
    """Draw a frame that could be a message; a third of its bytes are zero, and many small, as in real ones."""
    kind = rng.choice(list(LENGTHS))
    content = rng.randbytes(rng.choice(LENGTHS[kind]))
    thinned = (rng.choice((0, byte & 7, byte)) for byte in content)
    return WireFrame(kind, rng.randrange(256), bytes(thinned))


def flip(count):
    def damage(rng, stream):
        for _ in range(count):
            stream[rng.randrange(len(stream))] ^= 1 << rng.randrange(8)

    return damage


def flip_three(rng, stream):
    for place in rng.choices([place for place, byte in enumerate(stream) if byte], k=3):
        bit = 1 << rng.randrange(8)
        if stream[place] != bit:
            stream[place] ^= bit


def burst(rng, stream):
    begin = rng.randrange(len(stream))
    for place in range(begin, min(begin + rng.randint(2, 20), len(stream))):
        stream[place] = rng.randrange(256)


def lose(rng, stream):
    begin = rng.randrange(len(stream))
    del stream[begin : begin + rng.choice((1, 2, 5, 40))]


def insert(rng, stream):
    place = rng.randrange(len(stream) + 1)
    stream[place:place] = rng.randbytes(rng.choice((1, 2, 5, 40)))


def swap(rng, stream):
    one, other = rng.randrange(len(stream)), rng.randrange(len(stream))
    stream[one], stream[other] = stream[other], stream[one]


def repeat(rng, stream):
    begin, place = rng.randrange(len(stream)), rng.randrange(len(stream))
    stream[place:place] = stream[begin : begin + rng.randint(1, 40)]


def replace(rng, stream):
    stream[:] = rng.randbytes(rng.randint(4, 200))


ALWAYS_FOUND = (flip(1), flip(2), flip_three)
MAY_PASS = (flip(8), burst, lose, insert, swap, repeat, replace)


def count_wrong(damage, streams):
    """Return the numbers of damaged pieces, of those accepted of them, and of frames that are as sent."""
    rng = random.Random(1)
    pieces, wrong, whole = 0, 0, 0
    for _ in range(streams):
        sent = [draw_frame(rng) for _ in range(rng.randint(1, 4))]
        stream = bytearray().join(frame.pack() for frame in sent)
        damage(rng, stream)
        content = bytes(stream) + DELIMITER + AFTER.pack()
        cut = rng.randrange(len(content))
        decoder = Decoder()
        *frames, last = decoder.feed(content[:cut]) + decoder.feed(content[cut:]) or [None]
        assert last == AFTER, "a whole frame was lost after damage"
        unsent = [frame for frame in frames if frame not in (*sent, AFTER)]
        for frame in unsent:
            with suppress(ProtocolError):
                read(frame)
        pieces, wrong = pieces + decoder.bad_frames + len(unsent), wrong + len(unsent)
        whole += len(frames) - len(unsent)
    return pieces, wrong, whole


@pytest.mark.parametrize("damage", ALWAYS_FOUND)
def test_errors_of_few_bits_never_pass(damage):
    pieces, wrong, whole = count_wrong(damage, cases(2_000))
    assert wrong == 0
    assert min(pieces, whole) > 0.5 * cases(2_000)


@pytest.mark.parametrize("damage", MAY_PASS)
def test_other_damage_passes_only_by_the_chance_of_a_checksum(damage):
    pieces, wrong, _ = count_wrong(damage, cases(2_000))
    assert pieces > 0.5 * cases(2_000)
    assert wrong <= CHANCE * pieces + 5.0 * sqrt(CHANCE * pieces) + 5.0
