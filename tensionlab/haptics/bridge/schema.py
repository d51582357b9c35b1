"""JSON Schema of the bridge's messages, with every effect and its parameters, for clients in any language."""

from __future__ import annotations

import inspect
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import Any

from pydantic.json_schema import models_json_schema

from tensionlab.errors import EffectError
from tensionlab.haptics.bridge.messages import EXAMPLES, HAND, IN, KINDS, OUT, PROTOCOL
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.described import effect_of
from tensionlab.haptics.effects.parameters import MAX_COUNT, Bound, Many, Range, Vector, bounds
from tensionlab.model.rig import Rig

ABOUT = (
    "A client gets a welcome first. Each message of the client that commands is answered with exactly one state "
    "or refused, in order; events come between the answers: read on until the type is not event. Times are in s: "
    "that of a frame by the client's own clock, all others by that of the run, which is `time` of the state. "
    "Lengths are in m, forces in N. No number is infinite or NaN."
)
"""What a client has to know besides the messages."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"
REFERENCE = "#/$defs/"
PARAMETER = re.compile(r"^(?P<name>\w+) :.*\n(?P<text>(?: {4}.*\n?)+)", re.MULTILINE)
"""Of a docstring in NumPy style."""
SHORT_LIST = re.compile(r"\[[^\[\]{}]{0,200}\]")
IN_PYTHON = (
    (", or -inf for long ago", "; long ago if left out"),
    (", or inf for not yet", "; not yet if left out"),
)
"""What a docstring says that JSON cannot, which has no infinity, and what stands for it."""
MOTION_CLOCK, STATE_CLOCK = "on the motion's clock", "on the clock of `time` of the state"
CLAUSE_END = re.compile(r"[.;](\s|$)")


def message_schema(rig: Rig | None = None) -> dict[str, Any]:
    """Return the JSON Schema of all messages.

    ``$defs`` has each by the name of its class, such as ``Frame``, and effects and solids by their kinds, such as
    ``wall``; ``Effect`` is any effect, ``ClientMessage`` and ``BridgeMessage`` any message of one side.

    Parameters
    ----------
    rig : Rig, optional
        Whose bodies there are, in whose space vectors are, and whose ``up`` the defaults know. Without one: any
        bodies, vectors in the plane or in space, and the defaults of space with Z up.
    """
    models: list[Any] = [*((kind, "validation") for kind in IN), *((kind, "serialization") for kind in OUT)]
    definitions = models_json_schema(models, ref_template=REFERENCE + "{model}")[1]["$defs"]
    for kind in (*IN, *OUT):
        message = definitions[kind.__name__]
        message["required"] = ["type", *(key for key in message.get("required", ()) if key != "type")]
        if rig is None or kind in OUT:
            message["examples"] = [EXAMPLES[kind]]
    definitions["Event"]["properties"]["kind"]["enum"] = list(KINDS)
    frame = definitions["Frame"]["properties"]
    frame["effects"]["anyOf"][0]["additionalProperties"] = _reference("Effect")
    size = {"minItems": 2, "maxItems": 3}
    if rig is not None:
        size = {"minItems": rig.dimension, "maxItems": rig.dimension}
        bodies = dict.fromkeys((HAND, *rig.frames), frame["bodies"]["additionalProperties"])
        frame["bodies"] |= {"properties": bodies, "additionalProperties": False}
    definitions["Body"]["properties"]["position"] |= size
    for name, effect in EFFECTS.items():
        _define(name, effect, _by_default({"kind": name}, effect, rig), size, definitions)
    for name, solid in SOLIDS.items():
        shape = _by_default({"kind": "shaped", "field": {"kind": name}}, EFFECTS["shaped"], rig)
        _define(name, solid, None if shape is None else shape.field, size, definitions)
    definitions["sphere"]["required"] = []  # of a field that names no kind
    definitions["Effect"] = _by_value("kind", {name: name for name in EFFECTS})
    for name, kinds in (("ClientMessage", IN), ("BridgeMessage", OUT)):
        definitions[name] = _by_value("type", {kind.model_fields["type"].default: kind.__name__ for kind in kinds})
    return {
        "$schema": DIALECT,
        "title": f"Messages of the tensionlab bridge, version {PROTOCOL}",
        "description": ABOUT,
        **_by_value("type", {each.model_fields["type"].default: each.__name__ for each in (*IN, *OUT)}),
        "$defs": _without_titles(definitions),
    }


def schema_text(rig: Rig | None = None) -> str:
    """Return the JSON Schema of all messages, as the text of a file."""
    return json_text(message_schema(rig)) + "\n"


def json_text(value: Any) -> str:
    """Return a value as JSON to read: indented, but with a list of numbers or words on one line."""
    text = json.dumps(value, indent=2, ensure_ascii=False)
    return SHORT_LIST.sub(lambda found: " ".join(found[0].split()).replace("[ ", "[").replace(" ]", "]"), text)


def first_line(kind: type) -> str:
    """Return what a class is, in one line of Markdown."""
    return (inspect.getdoc(kind) or "").partition("\n")[0].replace("``", "`")


def _reference(name: str) -> dict[str, Any]:
    return {"$ref": REFERENCE + name}


def _by_value(key: str, names: Mapping[str, str], default: str | None = None) -> dict[str, Any]:
    """Return the schema of one of several definitions, by a key: validators name what is wrong, unlike oneOf's."""
    cases = []
    for value, name in names.items():
        case: dict[str, Any] = {"properties": {key: {"const": value}}}
        cases.append({"if": case if value == default else case | {"required": [key]}, "then": _reference(name)})
    union = {"type": "object", "properties": {key: {"enum": list(names)}}, "allOf": cases}
    return union if default else union | {"required": [key]}


def _by_default(given: dict[str, Any], kind: type, rig: Rig | None) -> Any:
    """Return an effect that has its defaults on a rig; None where some vector has none there."""
    if rig is None:
        return kind(*(SOLIDS[field["kind"]]() for field in [given.get("field")] if field))
    try:
        return effect_of("", given, rig)
    except EffectError:
        return None


def _define(
    name: str | None, kind: type, by_default: Any, size: Mapping[str, int], definitions: dict[str, Any]
) -> None:
    """Add the schema of an effect or a solid, by its name, or of a part of one, and those of its parts."""
    meanings = {
        each["name"]: " ".join(CLAUSE_END.split(each["text"])[0].split())
        for each in PARAMETER.finditer(inspect.getdoc(kind) or "")
    }
    properties: dict[str, Any] = {} if name is None else {"kind": {"const": name}}
    for each in fields(kind):
        value = getattr(kind() if by_default is None else by_default, each.name)
        if each.name == "field":
            properties[each.name] = _by_value("kind", {solid: solid for solid in SOLIDS}, "sphere")
        elif is_dataclass(value):
            part = type(value)
            _define(None, part, None if by_default is None else value, size, definitions)
            properties[each.name] = _reference(part.__name__)
            meanings.setdefault(each.name, first_line(part).rstrip("."))
        else:
            bound = bounds(kind)[each.name]
            properties[each.name] = _bounded(bound, size)
            if isinstance(value, tuple):
                if by_default is not None or not isinstance(bound, Vector):
                    properties[each.name]["default"] = value
            elif math.isfinite(value):
                properties[each.name]["default"] = value
        meaning = meanings[each.name].replace(MOTION_CLOCK, STATE_CLOCK)
        for python, instead in IN_PYTHON:
            meaning = meaning.replace(python, instead)
        properties[each.name]["description"] = meaning
    schema: dict[str, Any] = {"description": first_line(kind), "type": "object", "properties": properties}
    if name is not None:
        schema["required"] = ["kind"]
        if by_default is not None:
            schema["examples"] = [_example(name, by_default)]
    definitions[kind.__name__ if name is None else name] = schema | {"additionalProperties": False}


def _bounded(bound: Bound, size: Mapping[str, int]) -> dict[str, Any]:
    """Return the schema of a parameter. JSON has no infinity: an end that is infinite is left out."""
    if isinstance(bound, Many):
        return {"type": "array", "items": _bounded(bound.each, size), "maxItems": MAX_COUNT}
    low = "exclusiveMinimum" if isinstance(bound, Range) and bound.positive else "minimum"
    ends = {key: end for key, end in ((low, bound.low), ("maximum", bound.high)) if math.isfinite(end)}
    if isinstance(bound, Range):
        return {"type": "number", **ends}
    vector = {"type": "array", "items": {"type": "number", **ends}, **size}
    return vector | ({"contains": {"not": {"const": 0}}} if bound.shortest else {})


def _example(name: str, by_default: Any) -> dict[str, Any]:
    """Return an effect or a solid as a client writes it, with all that JSON can say of its defaults."""
    table = {"kind": name, **asdict(by_default)}
    if "field" in table:
        table["field"] = {"kind": "sphere", **table["field"]}
    return {key: value for key, value in table.items() if not isinstance(value, float) or math.isfinite(value)}


def _without_titles(schema: Any) -> Any:
    """Return a schema without the titles that pydantic makes of names."""
    if isinstance(schema, Mapping):
        kept = {key: each for key, each in schema.items() if key != "title" or not isinstance(each, str)}
        return {key: _without_titles(each) for key, each in kept.items()}
    return [_without_titles(each) for each in schema] if isinstance(schema, list | tuple) else schema
