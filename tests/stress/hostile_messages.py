"""Messages to a bridge, drawn from its schema and around it: valid, nearly valid, and invalid ones."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings
from hypothesis import strategies as st

from tensionlab.haptics.bridge.schema import REFERENCE, message_schema
from tensionlab.haptics.effects import EFFECTS, SOLIDS

NEAR_M = 0.4  # a hand is mostly so far from the rig's home
Json = st.SearchStrategy[Any]
# What is of no parameter's type, or of no physical size.
ODD: Json = st.sampled_from([
    None, True, "", "x", "1.0", [], {}, [[]], {"kind": []}, [0.0, 0.0], [math.nan] * 3, [1e308] * 3, math.nan,
    math.inf, -math.inf, 1e308, -1e308, 5e-324, -1.0, 0, 10**300, list(range(101)),
])  # fmt: skip


SCHEMA = message_schema()["$defs"]


def number(schema: dict[str, Any]) -> Json:
    """Draw numbers of a range, mostly small ones; its ends, and what is just beyond them."""
    above = schema.get("exclusiveMinimum")
    least, most = schema.get("minimum", -math.inf if above is None else above), schema.get("maximum", math.inf)
    low, high = max(least, -1e3), min(most, 1e3)
    inside = st.floats(low, min(high, low + 20.0), exclude_min=above is not None)
    edges = [least, most, math.nextafter(least, -math.inf), math.nextafter(most, math.inf)]
    return st.one_of(inside, inside, inside, st.floats(low, high), st.sampled_from(edges))


def value(schema: dict[str, Any], dimension: int, odd: bool) -> Json:
    """Draw values of a parameter: mostly what is allowed."""
    if "const" in schema:
        return st.just(schema["const"])
    if "$ref" in schema:
        return table(schema["$ref"].removeprefix(REFERENCE), dimension, odd)
    if "allOf" in schema:
        return st.one_of(*(table(solid, dimension, odd) for solid in SOLIDS))
    if schema["type"] == "number":
        return number(schema)
    items = schema["items"]
    if "minItems" not in schema:
        return st.lists(number(items), max_size=4).map(sorted) | st.just([0.5 * each for each in range(99)])
    low, high = items["minimum"], items["maximum"]
    component = st.floats(max(low, -1.0), min(high, 1.0))
    fitting = st.lists(component, min_size=dimension, max_size=dimension)
    return st.one_of(fitting, fitting, fitting, st.lists(st.floats(low, high), min_size=1, max_size=4))


def table(name: str, dimension: int, odd: bool) -> Json:
    """Draw parameters by a definition of the schema; with ``odd``, also such as cannot be."""
    choices = {key: value(schema, dimension, odd) for key, schema in SCHEMA[name]["properties"].items()}
    if odd:
        choices = {key: choice if key == "kind" else choice | ODD for key, choice in choices.items()}
        choices["colour"] = ODD
    required = {"kind": choices.pop("kind")} if "kind" in choices else {}
    return st.fixed_dictionaries(required, optional=choices)


def effect(dimension: int) -> Json:
    """Draw an effect: a kind and parameters."""
    known = [table(name, dimension, odd) for name in EFFECTS for odd in (False, False, True)]
    return st.one_of(*known, ODD, ODD.map(lambda kind: {"kind": kind}))


def frames(dimension: int, names: list[str], home: list[float]) -> Json:
    """Draw frames, as objects: bodies by their names, and effects."""
    near = st.tuples(*(st.floats(each - NEAR_M, each + NEAR_M) for each in home)).map(list)
    place = st.one_of(
        near, near, near, near, st.lists(st.floats(-100.0, 100.0), min_size=dimension, max_size=dimension)
    )
    turn = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)
    body = st.fixed_dictionaries({"position": place}, optional={"rotation": turn})
    odd_body = st.fixed_dictionaries({"position": place | ODD}, optional={"rotation": turn | ODD, "x": ODD})
    bodies = st.dictionaries(st.sampled_from(names), body, max_size=3)
    odd_bodies = st.dictionaries(st.sampled_from([*names, "unknown"]), odd_body | ODD, max_size=3)
    effects = st.dictionaries(st.sampled_from("abcd"), effect(dimension), max_size=3)
    time = st.just(1e4) | st.floats(0.0, 1e4)  # one that goes back is refused
    fitting = st.fixed_dictionaries(
        {"type": st.just("frame"), "time": time, "bodies": bodies}, optional={"effects": effects}
    )
    odd = st.fixed_dictionaries(
        {"type": st.just("frame") | ODD, "time": time | ODD},
        optional={"bodies": odd_bodies | ODD, "effects": effects | ODD, "sequence": st.integers() | ODD, "y": ODD},
    )
    return st.one_of(fitting, fitting, fitting, odd)


def texts(dimension: int, names: list[str], home: list[float]) -> st.SearchStrategy[str]:
    """Draw messages of the WebSocket: mostly JSON of frames, some of it damaged. None is a stop."""
    whole = frames(dimension, names, home).map(json.dumps)
    cut = st.tuples(whole, st.integers(0, 200)).map(lambda pair: pair[0][: -1 - pair[1]])
    odd = st.one_of(
        cut, ODD.map(json.dumps), st.integers(1, 3000).map(lambda depth: "[" * depth), st.text(max_size=40)
    )
    return st.one_of(*[whole] * 7, odd)


def datagrams(dimension: int, names: list[str], home: list[float]) -> st.SearchStrategy[bytes]:
    """Draw datagrams of OSC: mostly what it takes, some of it damaged. None is a stop."""
    places = st.tuples(*(st.floats(each - NEAR_M, each + NEAR_M) for each in home)).map(list)
    odd_places = st.lists(st.floats() | st.text(max_size=3), max_size=8)
    body = st.builds(_osc, st.sampled_from([f"/body/{name}" for name in names]), places)
    odd_body = st.builds(
        _osc, st.sampled_from(["/body/unknown", "/body", "/x", "/effect", "/body/hand"]), odd_places
    )
    effects = st.builds(_osc, st.sampled_from(["/effect/a", "/effect/b"]), effect(dimension).map(_words))
    message = st.one_of(body, body, effects, effects, odd_body)
    size = st.integers(-(2**31), 2**31 - 1)
    bundle = st.builds(_bundle, st.lists(message, max_size=4), st.none() | size)
    nested = st.builds(_nest, bundle, st.integers(1, 12))
    flipped = st.builds(_flip, message | bundle, st.integers(0, 400), st.integers(1, 255))
    return st.one_of(message, message, bundle, flipped, nested, st.binary(max_size=64))


def draw(strategy: st.SearchStrategy[Any], count: int, number_of_draw: int) -> list[Any]:
    """Return `count` examples of a strategy, the same ones for the same number."""
    found: list[Any] = []

    @seed(number_of_draw)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def collect(one: Any) -> None:
        found.append(one)

    collect()
    return found[:count]


def _words(given_effect: Any) -> list[Any]:
    """Return an effect as the arguments of OSC, as far as that can be said there."""
    if not isinstance(given_effect, dict):
        return [given_effect]
    words: list[Any] = [given_effect.get("kind")]
    for name, each in given_effect.items():
        if name != "kind":
            words += [name, *(each if isinstance(each, list) else [each])]
    return words


def _osc(address: str, values: list[Any]) -> bytes:
    tags, content = ",", b""
    for each in values:
        if isinstance(each, bool):
            tags += "T" if each else "F"
        elif isinstance(each, str):
            tags, content = tags + "s", content + _padded(each.encode())
        elif isinstance(each, int | float) and abs(each) < 1e300:
            tags, content = tags + "d", content + struct.pack(">d", float(each))
        elif isinstance(each, float):
            tags, content = tags + "d", content + struct.pack(">d", each)
        else:
            tags += "N"
    return _padded(address.encode()) + _padded(tags.encode()) + content


def _padded(text: bytes) -> bytes:
    return text + b"\0" * (4 - len(text) % 4)


def _bundle(elements: list[bytes], size: int | None) -> bytes:
    """Return a bundle, the first of whose sizes may be another one than it is."""
    sizes = [len(each) if size is None or index else size for index, each in enumerate(elements)]
    parts = [struct.pack(">i", length) + each for length, each in zip(sizes, elements, strict=True)]
    return b"#bundle\0" + struct.pack(">Q", 1) + b"".join(parts)


def _nest(inner: bytes, depth: int) -> bytes:
    for _ in range(depth):
        inner = _bundle([inner], None)
    return inner


def _flip(data: bytes, at: int, by: int) -> bytes:
    return (
        data
        if not data
        else data[: at % len(data)] + bytes([data[at % len(data)] ^ by]) + data[at % len(data) + 1 :]
    )
