"""The JSON Schema says what the bridge takes and sends: no less, and as little more as a schema can say."""

import dataclasses
import json
import re
from contextlib import suppress
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from tensionlab.errors import TensionlabError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.messages import IN, KINDS, OUT, parse_message
from tensionlab.haptics.bridge.schema import EXAMPLES, message_schema, schema_text
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.parsing import parse_effect
from tensionlab.hardware.protocol.codes import BrakeState, Limit
from tensionlab.model.files import load_rig
from tensionlab.scenarios import load_scenario
from tests.haptics.bridge.test_bridge import BAD, CYCLE_S, FLOOR, HAND, push
from tests.helpers.examples import many
from tests.helpers.simulated_bridge import SimulatedServe
from tests.stress.hostile_messages import draw, texts

ROOT = Path(__file__).parents[3]
RIG = load_rig("bartels2026-validation")
SHOULDERS = load_scenario("collision").rig
FLAT = load_rig("kntu-planar")
WHOLE = message_schema()


def validator(schema, name):
    """That of one definition of a schema."""
    return Draft202012Validator({"$ref": f"#/$defs/{name}", "$defs": schema["$defs"]})


CLIENT, BRIDGE = (validator(WHOLE, name) for name in ("ClientMessage", "BridgeMessage"))


@pytest.mark.parametrize("rig", [None, RIG, FLAT, SHOULDERS], ids=lambda rig: rig and rig.name)
def test_it_is_a_schema_without_infinity(rig):
    Draft202012Validator.check_schema(message_schema(rig))
    assert "nfinity" not in schema_text(rig)


@pytest.mark.parametrize("kind", [*IN, *OUT], ids=lambda kind: kind.__name__)
def test_the_examples_are_messages(kind):
    example = EXAMPLES[kind.model_fields["type"].default]
    (CLIENT if kind in IN else BRIDGE).validate(example)
    assert set(example) >= {name for name, each in kind.model_fields.items() if each.is_required()}
    kind.model_validate_json(json.dumps(example))


@pytest.mark.parametrize("rig", [dataclasses.replace(RIG, up="z"), RIG], ids=lambda rig: rig.up)
@pytest.mark.parametrize("name", EFFECTS)
def test_the_example_of_an_effect_has_all_its_defaults_on_a_rig(name, rig):
    (example,) = message_schema(rig)["$defs"][name]["examples"]
    CLIENT.validate({"type": "frame", "time": 0.0, "effects": {"mine": example}})
    effect = EFFECTS[name]
    kept = {each.name for each in dataclasses.fields(effect)} - set(example)
    assert kept <= {"grasped", "loosed"}, "JSON has no infinity"
    assert parse_effect("mine", json.loads(json.dumps(example)), rig) == parse_effect("mine", {"kind": name}, rig)


@pytest.mark.parametrize(("up", "gravity"), [("y", [0.0, -9.81, 0.0]), ("-z", [0.0, 0.0, 9.81])])
def test_the_defaults_know_what_is_up(up, gravity):
    weight = message_schema(dataclasses.replace(RIG, up=up))["$defs"]["weight"]["properties"]
    assert list(weight["gravity"]["default"]) == gravity
    unknown = message_schema(dataclasses.replace(RIG, up=None))["$defs"]["weight"]["properties"]
    assert "default" not in unknown["gravity"]


@pytest.mark.parametrize("kind", [*EFFECTS.values(), *SOLIDS.values()])
def test_every_parameter_has_a_meaning_and_its_unit(kind):
    names = {each: name for name, each in (*EFFECTS.items(), *SOLIDS.items())}
    definition = WHOLE["$defs"][names[kind]]
    assert {*definition["properties"]} == {"kind", *(each.name for each in dataclasses.fields(kind))}
    for name, parameter in definition["properties"].items():
        if "unit" in parameter:
            assert f"in {parameter['unit']}" in parameter["description"], name
        assert name == "kind" or "$ref" in parameter or len(parameter["description"]) > 5, name


def test_words_of_the_state_are_those_of_the_modules():
    words = WHOLE["$defs"]["BridgeState"]["properties"]
    for name, codes in (("limiters", Limit), ("brakes", BrakeState)):
        assert [*re.findall(r"\b[A-Z]{4,}\b", words[name]["description"])][: len(codes)] == [
            each.name for each in codes
        ]
    assert WHOLE["$defs"]["BridgeEvent"]["properties"]["kind"]["enum"] == list(KINDS)


def message(text):
    """That in a text, or None if it is not strict JSON."""

    def refuse(constant):
        raise ValueError(constant)

    with suppress(ValueError, RecursionError):
        return json.loads(text, parse_constant=refuse)


SEEN = [text for text, _ in BAD if message(text) is not None]


@pytest.mark.parametrize("text", SEEN)
def test_what_the_bridge_refuses_is_not_of_its_schema(text):
    assert not validator(message_schema(RIG), "ClientMessage").is_valid(message(text))


def test_a_schema_knows_bodies_and_dimension_of_its_rig():
    def valid(rig, **bodies):
        frame = {"type": "frame", "time": 0.0, "bodies": {name: {"position": at} for name, at in bodies.items()}}
        return validator(message_schema(rig), "ClientMessage").is_valid(frame)

    assert valid(SHOULDERS, hand=[0, 0, 0], torso=[0, 0, 0])
    assert not valid(RIG, torso=[0, 0, 0])
    assert valid(FLAT, hand=[0, 0])
    assert not valid(FLAT, hand=[0, 0, 0])
    assert valid(None, anything=[0, 0])
    for kind in IN:
        assert "examples" in WHOLE["$defs"][kind.__name__]
        assert "examples" not in message_schema(RIG)["$defs"][kind.__name__], "of the bodies of another rig"


@pytest.mark.parametrize("rig", [RIG, SHOULDERS, FLAT], ids=lambda rig: rig.name)
def test_whatever_the_bridge_takes_is_of_its_schema(rig):
    schema, box, taken = validator(message_schema(rig), "ClientMessage"), ClientState(rig), 0
    for number, text in enumerate(
        draw(texts(rig.dimension, ["hand", *rig.frames], rig.home.tolist()), many(600), 3)
    ):
        found = message(text)
        try:
            box.put(parse_message(found), 2.0 * number)
        except (TensionlabError, ValueError):
            continue
        taken += 1
        schema.validate(found)
    assert taken > 20


def test_all_that_a_client_and_the_bridge_say_is_of_the_schema(monkeypatch):
    with SimulatedServe((ROOT / "datasets/rigs/bartels2026-validation.toml", "--port", 0), monkeypatch) as bridge:
        from tensionlab.haptics.bridge.client import BridgeClient

        with BridgeClient(bridge.url) as client, bridge.connect(f"{bridge.url}/state") as watch:
            said = client._socket
            push(bridge, client, 1.2, FLOOR, HAND)
            bridge.sleep(1.0)
            kinds = {json.loads(watch.recv())["type"] for _ in range(10)}
            assert kinds == {"welcome", "state", "event"}
    for text in said.sent:
        CLIENT.validate(json.loads(text))
    for text in (*said.received, *watch.received):
        BRIDGE.validate(json.loads(text))
    assert {json.loads(text)["type"] for text in said.received} == {"welcome", "state", "event"}
    assert len(said.sent) > 1.0 / CYCLE_S
