"""Mutations of files: of their content, as a tree of tables, lists and values, or of their bytes."""

from __future__ import annotations

import copy
import random
from collections.abc import Iterator
from typing import Any

MOST = 4  # mutations of one file
DEEP = 3000  # lists within each other, of which no parser that calls itself comes back


class Raw(str):
    """A text that is written as it is, without quotation marks."""

    __slots__ = ()


NUMBERS = (0, 1, -1, 2, 2**31, 2**63, -(2**63), 10**30, 0.0, -0.0, 0.5, 1e300, -1e300, 1e-300, 1e308, 1e7)
NO_NUMBERS = (float("nan"), float("inf"), float("-inf"), True, False, None)
TEXTS = ("", " ", "x", "0", "nan", "inf", "world", "hand", "../../x", "a" * 3000)
STRANGE = ("\x00", "\x1b[2J", "\n", "[/x]", "$x$", "\u202e", "\ufeff", "e\u0301", "\U0001f600", "\ud800")
LISTS: tuple[Any, ...] = (
    [],
    [[]],
    [{}],
    [0.0],
    [0.0, 0.0],
    [0.0, 0.0, 0.0],
    [0.0] * 4,
    ["x"],
    [None],
    {},
    {"x": 0},
    {"kind": "x"},
)
PIECES = ("1979-05-27T07:32:00Z", "07:32:00", "0x", "=", "[", '"', "<!--", "&a;", "9" * 5000)
NESTED = ("[" * DEEP + "]" * DEEP, "{a=" * DEEP + "1" + "}" * DEEP, '{"a":' * DEEP + "1" + "}" * DEEP)
# What may stand in the place of anything.
ODD: tuple[Any, ...] = (*NUMBERS, *NO_NUMBERS, *TEXTS, *STRANGE, *LISTS, *map(Raw, PIECES + NESTED))

# Bytes that mean something to some reader.
INSERTED = (b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\x00", b'"', b"[", b"9" * 40)


def spoil(document: Any, rng: random.Random) -> Any:
    """Return a copy of a document with one to `MOST` mutations of what is in it."""
    spoilt = copy.deepcopy(document)
    for _ in range(rng.randint(1, MOST)):
        places = list(_places(spoilt))
        if not places:
            break
        holder, key = rng.choice(places)
        _mutate(holder, key, rng)
    return spoilt


def spoil_bytes(content: bytes, rng: random.Random) -> bytes:
    """Return bytes with one to `MOST` mutations."""
    spoilt = bytearray(content)
    for _ in range(rng.randint(1, MOST)):
        begin = rng.randrange(len(spoilt) + 1)
        end = min(begin + rng.choice((1, 1, 2, 4, 8, 100)), len(spoilt))
        match rng.randrange(7):
            case 0 if spoilt:
                spoilt[begin % len(spoilt)] ^= 1 << rng.randrange(8)
            case 1:
                spoilt[begin:end] = rng.randbytes(end - begin)
            case 2:
                del spoilt[begin:end]
            case 3:
                spoilt[begin:begin] = spoilt[begin:end] * rng.choice((1, 2, 50))
            case 4:
                del spoilt[begin:]
            case 5:
                spoilt[begin:end] = rng.choice((b"\x00", b"\xff")) * (end - begin)
            case _:
                spoilt[begin:begin] = rng.choice(INSERTED)
    return bytes(spoilt)


def _places(document: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every table and list with each of its keys."""
    left = [document]
    while left:
        holder = left.pop()
        items = holder.items() if isinstance(holder, dict) else enumerate(holder)
        for key, value in items:
            yield holder, key
            if isinstance(value, dict | list):
                left.append(value)


def _mutate(holder: Any, key: Any, rng: random.Random) -> None:
    value = holder[key]
    if isinstance(value, bytes) and rng.random() < 0.8:
        holder[key] = spoil_bytes(value, rng)
        return
    match rng.randrange(8):
        case 0 | 1:
            holder[key] = copy.deepcopy(rng.choice(ODD))  # which is spoilt further, and must not change
        case 2 | 3 if isinstance(value, int | float) and not isinstance(value, bool):
            holder[key] = value * rng.choice((-1, 0, 2, 0.5, 10, 1e-9, 1e9, 1 + 1e-12))
        case 2 | 3 if isinstance(value, str):
            cut = rng.randrange(len(value) + 1)
            holder[key] = value[:cut] + rng.choice(("", "x", "\x07", "é", " ")) + value[cut + rng.randrange(2) :]
        case 4:
            del holder[key]
        case 5 if isinstance(holder, list):
            holder.insert(key, copy.deepcopy(value))
        case 5:
            holder[f"{key}{rng.choice(('s', '_mm', ' ', '.x'))}"] = holder.pop(key)
        case 6 if isinstance(holder, list):
            other = rng.randrange(len(holder))
            holder[key], holder[other] = holder[other], holder[key]
        case 6:
            other = rng.choice(list(holder))
            holder[key], holder[other] = holder[other], holder[key]
        case 7 if isinstance(value, list) and value:
            holder[key] = value * rng.choice((2, 40))
        case _:
            holder[key] = [value]
