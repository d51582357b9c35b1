"""JSON Schema of the bridge's messages, with every effect and its parameters, for clients in any language."""

from __future__ import annotations

import copy
import inspect
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, models_json_schema

from tensionlab.errors import EffectError
from tensionlab.haptics.bridge.messages import HAND, IN, KINDS, OUT, PROTOCOL
from tensionlab.haptics.effects import EFFECTS, SOLIDS, Friction, Plane, Ripples, VirtualCoupling, Wall
from tensionlab.haptics.effects.parsing import parse_effect
from tensionlab.model.rig import Rig

ABOUT = (
    "A client gets a welcome first. Each message of the client in command is answered with exactly one state or "
    "refused, in order; events come between the answers: read on until the type is not event. Times are in s: "
    "that of a frame by the client's own clock, all others by the clock of the run, which is `time` of the state. "
    "Lengths are in m, forces in N. No number is infinite or NaN."
)  # instructions for clients, besides the messages
DIALECT = "https://json-schema.org/draft/2020-12/schema"
REFERENCE = "#/$defs/"
# A complete message of each type.
EXAMPLES: dict[str, dict[str, Any]] = json.loads(
    Path(__file__).with_name("examples.json").read_text(encoding="utf-8")
)
SHORT_LIST = re.compile(r"\[[^\[\]{}]{0,200}\]")
# Effects, solids and parts of both.
PARAMETERS: tuple[type[Any], ...] = (*EFFECTS.values(), *SOLIDS.values(), Plane, Ripples, VirtualCoupling)


class Untitled(GenerateJsonSchema):
    """Generator of schemas without titles of keys, which only repeat their names."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Return False."""
        return False


def message_schema(rig: Rig | None = None) -> dict[str, Any]:
    """Return the JSON Schema of all messages, with the bodies, dimension and default directions of a rig.

    ``$defs`` has each by the name of its class, such as ``Frame``, and effects and solids by their kinds, such as
    ``wall``; ``Effect`` is any effect, ``ClientMessage`` and ``BridgeMessage`` any message of one side. Without a
    rig: any bodies, vectors in the plane or in space, and the defaults for Z up.
    """
    models: list[Any] = [
        *((kind, "validation") for kind in (*IN, *PARAMETERS)),
        *((kind, "serialization") for kind in OUT),
    ]
    template = REFERENCE + "{model}"
    definitions = models_json_schema(models, ref_template=template, schema_generator=Untitled)[1]["$defs"]
    for kind in (*IN, *OUT):
        message = definitions[kind.__name__]
        message["required"] = ["type", *(key for key in message.get("required", ()) if key != "type")]
        if rig is None or kind in OUT:
            message["examples"] = [EXAMPLES[kind.model_fields["type"].default]]
    definitions["BridgeEvent"]["properties"]["kind"]["enum"] = list(KINDS)
    frame = definitions["Frame"]["properties"]
    frame["effects"]["anyOf"][0]["additionalProperties"] = _reference("Effect")
    size = {"minItems": 2, "maxItems": 3}
    if rig is not None:
        size = {"minItems": rig.dimension, "maxItems": rig.dimension}
        bodies = dict.fromkeys((HAND, *rig.frames), frame["bodies"]["additionalProperties"])
        frame["bodies"] |= {"properties": bodies, "additionalProperties": False}
    definitions["BodyPose"]["properties"]["position"] |= size
    _tidy(definitions, size)
    solids = _by_value("kind", {name: name for name in SOLIDS}, "sphere")
    definitions["Shape"]["properties"]["field"] |= solids
    for name, effect in EFFECTS.items():
        _add_kind(name, effect, _by_default({"kind": name}, effect, rig), definitions)
    for name, solid in SOLIDS.items():
        field = {"kind": name} if rig is not None else solid()
        shape = _by_default({"kind": "shaped", "field": field}, EFFECTS["shaped"], rig)
        _add_kind(name, solid, None if shape is None else shape.field, definitions)
    for kind in {*EFFECTS.values(), *SOLIDS.values()} - {Wall, Friction}:  # those are also parts of effects
        del definitions[kind.__name__]
    definitions["sphere"]["required"] = []  # of a field that names no kind
    definitions["Effect"] = _by_value("kind", {name: name for name in EFFECTS})
    for name, kinds in (("ClientMessage", IN), ("BridgeMessage", OUT)):
        definitions[name] = _by_value("type", {kind.model_fields["type"].default: kind.__name__ for kind in kinds})
    return {
        "$schema": DIALECT,
        "title": f"Messages of the tensionlab bridge, version {PROTOCOL}",
        "description": ABOUT,
        **_by_value("type", {kind.model_fields["type"].default: kind.__name__ for kind in (*IN, *OUT)}),
        "$defs": json.loads(json.dumps(definitions)),  # lists in place of tuples
    }


def schema_text(rig: Rig | None = None) -> str:
    """Return `message_schema` as the text of a file."""
    return json_text(message_schema(rig)) + "\n"


def json_text(value: Any) -> str:
    """Return a value as indented JSON, with each list of numbers or words on one line."""
    text = json.dumps(value, indent=2, ensure_ascii=False)
    return SHORT_LIST.sub(lambda found: " ".join(found[0].split()).replace("[ ", "[").replace(" ]", "]"), text)


def first_line(kind: type) -> str:
    """Return the first line of a class's docstring, as Markdown."""
    return (inspect.getdoc(kind) or "").partition("\n")[0].replace("``", "`")


def _reference(name: str) -> dict[str, Any]:
    return {"$ref": REFERENCE + name}


def _by_value(key: str, names: Mapping[str, str], default: str | None = None) -> dict[str, Any]:
    """Return the schema of a union, by a key: validators name the problem, unlike with oneOf."""
    cases = []
    for value, name in names.items():
        case: dict[str, Any] = {"properties": {key: {"const": value}}}
        cases.append({"if": case if value == default else case | {"required": [key]}, "then": _reference(name)})
    union = {"type": "object", "properties": {key: {"enum": list(names)}}, "allOf": cases}
    return union if default else union | {"required": [key]}


def _by_default(table: dict[str, Any], kind: type, rig: Rig | None) -> Any:
    """Return an effect with its defaults on a rig; None if some vector has none there."""
    if rig is None:
        return kind(**{key: value for key, value in table.items() if key != "kind"})
    try:
        return parse_effect("", table, rig)
    except EffectError:
        return None


def _set_defaults(name: str, defaults: Any, definitions: dict[str, Any]) -> None:
    """Set the defaults of an effect or a solid, and of its parts; those of vectors only if they are known."""
    properties = definitions[name]["properties"]
    for key, schema in properties.items():
        if "$ref" in schema:
            part = schema["$ref"].removeprefix(REFERENCE)
            schema.pop("default", None)
            _set_defaults(part, getattr(defaults, key, None), definitions)
        elif key == "field" or (defaults is None and "minItems" in schema):
            schema.pop("default", None)
        elif defaults is not None:
            schema["default"] = getattr(defaults, key)
        if isinstance(schema.get("default"), float) and not math.isfinite(schema["default"]):
            del schema["default"]


def _add_kind(name: str, kind: type, defaults: Any, definitions: dict[str, Any]) -> None:
    _set_defaults(kind.__name__, defaults, definitions)
    definition = copy.deepcopy(definitions[kind.__name__])
    definition["properties"] = {"kind": {"const": name}, **definition["properties"]}
    definition["required"] = ["kind"]
    if defaults is not None:
        definition["examples"] = [_example(name, defaults)]
    definitions[name] = definition


def _tidy(definitions: dict[str, Any], size: Mapping[str, int]) -> None:
    """Shorten descriptions to one line, and give vectors their number of components."""
    for kind in PARAMETERS:
        definition = definitions[kind.__name__]
        definition["description"] = first_line(kind)
        for schema in definition["properties"].values():
            if "description" in schema:
                schema["description"] = " ".join(schema["description"].split()).rstrip(".")
            if "minItems" in schema:
                schema.update(size)


def _example(name: str, by_default: Any) -> dict[str, Any]:
    """Return an effect or a solid as a client writes it, with its finite defaults."""
    table = {"kind": name, **asdict(by_default)}
    if "field" in table:
        table["field"] = {"kind": "sphere", **table["field"]}
    return {key: value for key, value in table.items() if not isinstance(value, float) or math.isfinite(value)}
