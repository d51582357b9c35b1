"""Fuzzing of the codec: streams of frames, damaged in many ways, of which none may be taken for a whole one.

Errors of one and two bits are always found, wherever they are, and those of three bits that neither make nor
remove a zero: no frame may pass with one. All other damage passes with a chance of 2^-16, or less where it hits
the checksum, eight of whose bits are fixed. `firmware/fuzz/flips.cpp` flips all one and two bits of frames.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import sqrt

from tensionlab.errors import ProtocolError
from tensionlab.hardware.protocol.codes import Type
from tensionlab.hardware.protocol.frames import DELIMITER, MAX_PAYLOAD, Decoder, WireFrame
from tensionlab.hardware.protocol.messages import PROTOCOL, read

CHANCE = 2.0**-16  # that the CRC of anything is right
AFTER = WireFrame(
    Type.PING, 0xA5, b"afterall"
)  # sent after each stream, to see that the decoder finds its way back


@dataclass
class Tally:
    """What became of the streams that were damaged in one way.

    Attributes
    ----------
    streams : int
        How many there were.
    whole : int
        Frames that were accepted, and had been sent so.
    pieces : int
        Between two delimiters, and not as anything that was sent.
    wrong : int
        Such pieces that the decoder accepted.
    understood : int
        Those of them that make sense as a message.
    """

    streams: int = 0
    whole: int = 0
    pieces: int = 0
    wrong: int = 0
    understood: int = 0


def lengths() -> dict[Type, list[int]]:
    """Return the lengths that the payload of each type may have."""
    found: dict[Type, list[int]] = {each: [] for each in Type}
    for each in Type:
        byte = PROTOCOL if each is Type.INFO else 1  # which means something in every field
        for length in range(MAX_PAYLOAD + 1):
            with suppress(ProtocolError):
                read(WireFrame(each, 0, bytes([byte]) * length))
                found[each].append(length)
    return found


LENGTHS = lengths()


def draw_frame(rng: random.Random) -> WireFrame:
    """Draw a frame that could be a message; a third of its bytes are zero, and many small, as in real ones."""
    kind = rng.choice(list(LENGTHS))
    content = rng.randbytes(rng.choice(LENGTHS[kind]))
    styles = rng.randbytes(len(content))
    thinned = (
        0 if style < 85 else byte & 7 if style < 128 else byte for byte, style in zip(content, styles, strict=True)
    )
    return WireFrame(kind, rng.randrange(256), bytes(thinned))


def _flip_three(rng: random.Random, stream: bytearray) -> None:
    places = [place for place, byte in enumerate(stream) if byte]
    for place in rng.choices(places, k=3):
        bit = 1 << rng.randrange(8)
        if stream[place] != bit:
            stream[place] ^= bit


def flip_any(count: int) -> Callable[[random.Random, bytearray], None]:
    """Return what flips so many bits anywhere."""

    def damage(rng: random.Random, stream: bytearray) -> None:
        for _ in range(count):
            stream[rng.randrange(len(stream))] ^= 1 << rng.randrange(8)

    return damage


def _burst(rng: random.Random, stream: bytearray) -> None:
    begin = rng.randrange(len(stream))
    for place in range(begin, min(begin + rng.randint(2, 20), len(stream))):
        stream[place] = rng.randrange(256)


def _lose(rng: random.Random, stream: bytearray) -> None:
    begin = rng.randrange(len(stream))
    del stream[begin : begin + rng.choice((1, 1, 2, 5, 40))]


def _insert(rng: random.Random, stream: bytearray) -> None:
    place = rng.randrange(len(stream) + 1)
    stream[place:place] = rng.randbytes(rng.choice((1, 1, 2, 5, 40)))


def _swap(rng: random.Random, stream: bytearray) -> None:
    one, other = rng.randrange(len(stream)), rng.randrange(len(stream))
    stream[one], stream[other] = stream[other], stream[one]


def _repeat(rng: random.Random, stream: bytearray) -> None:
    begin, place = rng.randrange(len(stream)), rng.randrange(len(stream))
    stream[place:place] = stream[begin : begin + rng.randint(1, 40)]


def _replace(rng: random.Random, stream: bytearray) -> None:
    stream[:] = rng.randbytes(rng.randint(4, 200))


CERTAIN: dict[str, Callable[[random.Random, bytearray], None]] = {
    "1 bit anywhere": flip_any(1),
    "2 bits anywhere": flip_any(2),
    "3 bits, no zeros": _flip_three,
}  # damage that is always found
BY_CHANCE: dict[str, Callable[[random.Random, bytearray], None]] = {
    "8 bits anywhere": flip_any(8),
    "burst": _burst,
    "bytes lost": _lose,
    "bytes inserted": _insert,
    "bytes swapped": _swap,
    "bytes repeated": _repeat,
    "random bytes": _replace,
}  # damage that it may miss
KINDS = {**CERTAIN, **BY_CHANCE}


def fuzz(streams: int, seed: int = 0) -> dict[str, Tally]:
    """How many wrong frames pass? Any exception but `ProtocolError` comes through.

    Parameters
    ----------
    streams : int
        In all, spread over the kinds of damage. Each has one to four frames, and comes in up to three pieces.
    seed : int

    Raises
    ------
    AssertionError
        If the decoder does not find a whole frame after the damage.
    """
    rng = random.Random(seed)
    tallies = {kind: Tally() for kind in KINDS}
    for index in range(streams):
        kind = list(KINDS)[index % len(KINDS)]
        sent = [draw_frame(rng) for _ in range(rng.randint(1, 4))]
        stream = bytearray().join(frame.pack() for frame in sent)
        KINDS[kind](rng, stream)
        _follow(tallies[kind], {*sent, AFTER}, bytes(stream) + DELIMITER + AFTER.pack(), rng)
    return tallies


def _follow(tally: Tally, sent: set[WireFrame], stream: bytes, rng: random.Random) -> None:
    decoder = Decoder()
    cuts = sorted(rng.randrange(len(stream)) for _ in range(2))
    frames = [
        frame
        for begin, end in zip((0, *cuts), (*cuts, len(stream)), strict=True)
        for frame in decoder.feed(stream[begin:end])
    ]
    assert frames[-1:] == [AFTER], "a whole frame was lost after damage"
    tally.streams += 1
    tally.pieces += decoder.bad_frames
    for frame in frames[:-1]:
        understood = True
        try:
            read(frame)
        except ProtocolError:
            understood = False
        if frame in sent:
            tally.whole += 1
        else:
            tally.pieces += 1
            tally.wrong += 1
            tally.understood += understood


def allowed(kind: str, tally: Tally) -> float:
    """How many wrong frames may there be? None where the CRC is certain; else by chance, and five sigma more."""
    if kind in CERTAIN:
        return 0.0
    mean = CHANCE * tally.pieces
    return mean + 5.0 * sqrt(mean) + 5.0


def main() -> None:
    """Run and print the table; exit status 1 if more wrong frames passed than chance explains."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000, help="streams in all")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    began = time.perf_counter()
    tallies = fuzz(asked.count, asked.seed)
    print(
        f"{'damage':18} {'streams':>9} {'whole':>9} {'pieces':>9} {'by chance':>9} {'wrong':>6} {'understood':>10}"
    )
    for kind, tally in tallies.items():
        chance = f"{CHANCE * tally.pieces:9.1f}" if kind in BY_CHANCE else f"{'none':>9}"
        print(
            f"{kind:18} {tally.streams:9,} {tally.whole:9,} {tally.pieces:9,} {chance} "
            f"{tally.wrong:6} {tally.understood:10}"
        )
    flawed = [kind for kind, tally in tallies.items() if tally.wrong > allowed(kind, tally)]
    seconds = time.perf_counter() - began
    print(
        f"{asked.count:,} streams in {seconds:.0f} s; more wrong frames than chance: {', '.join(flawed) or 'none'}"
    )
    raise SystemExit(1 if flawed else 0)


if __name__ == "__main__":
    main()
