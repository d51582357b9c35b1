"""docs/reference/bridge.md from the code: ``make generated``."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tensionlab.haptics.bridge.admission import (
    COMMAND_PATH,
    EVENTS_PATH,
    MAX_CLIENTS,
    PAGE_PATH,
    SCHEMA_PATH,
    STATE_PATH,
)
from tensionlab.haptics.bridge.command import (
    BYTES_AT_ONCE,
    BYTES_PER_S,
    MESSAGES_AT_ONCE,
    MESSAGES_PER_S,
    READ_SHARE,
    SILENCE_S,
)
from tensionlab.haptics.bridge.messages import (
    IN,
    KINDS,
    MAX_MESSAGE_BYTES,
    OUT,
    PROTOCOL,
    BodyPose,
    BridgeMessage,
)
from tensionlab.haptics.bridge.osc import MAX_MESSAGES
from tensionlab.haptics.bridge.schema import (
    EXAMPLES,
    REFERENCE,
    first_line,
    json_text,
    message_schema,
    schema_text,
)
from tensionlab.haptics.bridge.server import MAX_REFUSED, STATE_PERIOD_S
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S
from tensionlab.haptics.rendering.renderer import FADE_DELAY_S, FADE_S

HEAD = f"""# The bridge

The bridge lets game engines drive a rig: `tensionlab serve RIG` opens a WebSocket. Version {PROTOCOL} of the
messages. This page is generated from the code, by `make generated`.

- `ws://127.0.0.1:8765{COMMAND_PATH}` takes frames, 50 to 120 a second, and answers each with exactly one message:
  the state, or why the frame was refused. Between the answers come events: read on until `type` is not `event`.
  One client commands, by WebSocket or OSC; a second one is refused.
  A client in command that sends nothing valid for {SILENCE_S:g} s loses its place.
- `ws://127.0.0.1:8765{EVENTS_PATH}` sends events, and takes nothing; `{STATE_PATH}` sends the state as well,
  every {STATE_PERIOD_S:g} s. A limiter of a module, or a softer effect, is an event when it
  begins, and again only after it has been absent for 1 s. There are at most {MAX_CLIENTS} clients.
- `http://127.0.0.1:8765{PAGE_PATH}` is a page that shows the state live, and `{SCHEMA_PATH}` beside it is the JSON
  Schema of all messages for this rig, with its bodies, its dimension and its defaults. The one for all rigs is
  `examples/bridge/schema.json`.
- Every message is one JSON object, {MAX_MESSAGE_BYTES // 1024} KiB at most. The first one to every client is a
  `welcome`. Units are SI; axes are those of the rig (the welcome says which one is up; Unity's are left-handed:
  turn one round).
- Times are in s. That of a frame is by the client's own clock, with any origin; it never goes back, unless no
  frame has come for 1 s. All others are on the clock of the run, which is `time` of the state.
- The rig renders at its own rate, and moves the hand evenly from one frame to the next, a frame behind.
  A hand that would be faster than {MAX_HAND_SPEED_M_S:g} m/s was moved by its tracker, and is at rest there.
- Effects that are stiff or vibrate run on modules whose cables lie within 45 degrees of them. The host renders
  the others, no stiffer than `ceiling` in the state; `softened` there has the rendered stiffness where it is less
  than desired, and a `stiff` event names it when it begins.
- `--scenario NAME` plays a scenario over and over: hand and bodies are where the client says, and its effects
  replace the scenario's effects of the same names. Others are rendered all the time.
- {FADE_DELAY_S:g} s after the latest frame the force begins to fade, and {FADE_DELAY_S + FADE_S:g} s after it
  it is 0, until frames come again. Then it comes back in {FADE_S:g} s.
- A refusal has a reason, and changes nothing. Refused are wrong types and dimensions, values outside
  the ranges below, unknown names, and floods: more than {MESSAGES_PER_S:g} messages a second
  (beyond {MESSAGES_AT_ONCE:g} at once), {1e-3 * BYTES_PER_S:g} kB a second (beyond {1e-3 * BYTES_AT_ONCE:g} kB),
  or {100 * READ_SHARE:g} % of a processor's time for reading. {MAX_REFUSED} refusals in a row end the
  connection, and so do as many of a flood without a calm pause in between.
- The force demanded of modules is at most twice what all cables together pull. Effects that fail while
  they are rendered are removed, their force fades, and their client is dismissed with the reason; the loop
  continues.
- Pages of this machine may connect, and programs; other pages only with `--page`. A URL has to call this machine
  `127.0.0.1`, `localhost` or `[::1]`, so that no foreign page can have its own name lead here. Beyond this machine
  (`--host 0.0.0.0`) a token is needed instead: `?token=...` or `Authorization: Bearer ...`. The server has it from
  `--token-file FILE` or the environment, `TENSIONLAB_BRIDGE_TOKEN`.
- On Linux, programs of another user of this machine are refused without a token. OSC and other systems do not tell
  users apart.
- When a client connects, goes or is refused, there is a line on stderr and a `client` event.
- The same comes in over OSC (`--osc PORT`): `/body/hand x y z`, `/effect/NAME KIND parameter value ...`,
  `/effect/NAME` alone to take it away, `/stop`. Parameters have the names of the tables below, such as
  `/effect/floor wall plane.point 0 0.32 0 plane.normal 0 1 0 stiffness 100`, and `field.kind` a word.
  Nothing is answered; what is refused is a line on stderr and a
  `refused` event, with the reason. All that one machine sends is one client's. A datagram has {MAX_MESSAGES}
  messages at most, in one bundle. OSC has no token, so only this machine is listened to, unless
  `--osc-host` says otherwise.

`examples/bridge/` has clients in Python and JavaScript, and one in Python over OSC; `examples/unity/` is a package
for Unity, `examples/web/` a page.
"""


EFFECTS_ABOUT = """An effect is an object with its `kind` and parameters, as in each example, which has all at
their defaults. Directions (`normal`, `axis`, `direction`, `gravity`) have theirs for Z up, and are turned with
the rig's `up`: with Y up, a wall whose normal is left out has `[0, 1, 0]`.
Vectors have as many components as the rig has axes: on a rig in the plane, give two, also in place of defaults.
Times (`shots`, `grasped`, `loosed`) are on the clock of the run, which is the `time` of the state.
"""
CLIENTS: tuple[type[BridgeMessage], ...] = (*IN, BodyPose)
SCHEMA_FILE = "examples/bridge/schema.json"


def document() -> str:
    """Return the text of docs/reference/bridge.md."""
    definitions = message_schema()["$defs"]
    parts = [HEAD, "## Messages of a client\n"]
    parts += [_message(kind) for kind in CLIENTS]
    parts += ["## Messages of the bridge\n", *(_message(kind) for kind in OUT)]
    parts += ["## Kinds of events\n", "| Kind | Meaning |", "| --- | --- |"]
    parts += [*(f"| `{kind}` | {meaning} |" for kind, meaning in KINDS.items()), ""]
    parts += ["## Effects\n", EFFECTS_ABOUT]
    parts += [_effect(name, definitions) for name in EFFECTS]
    parts += ["## Solids\n", "Of the `field` of a shaped effect: `kind`, sphere if left out, and parameters.\n"]
    parts += [_effect(name, definitions) for name in SOLIDS]
    return "\n".join(parts)


def _message(kind: type[BridgeMessage]) -> str:
    name = kind.model_fields["type"].default if "type" in kind.model_fields else kind.__name__.lower()
    rows = [f"### {name}\n", f"{first_line(kind)}\n", "| Key | Meaning |", "| --- | --- |"]
    for key, field in kind.model_fields.items():
        if key == "type":
            rows.append(f'| `type` | `"{field.default}"` |')
            continue
        said = "left out" in (field.description or "")
        needed = "" if said or field.is_required() or kind not in CLIENTS else "; may be left out"
        rows.append(f"| `{key}` | {field.description}{needed} |")
    return "\n".join(rows) + "\n" + (_example(EXAMPLES[name]) if name in EXAMPLES else "")


def _effect(name: str, definitions: Mapping[str, Any]) -> str:
    effect = definitions[name]
    rows = [f"### {name}\n", f"{effect['description']}\n", "| Parameter | Meaning | Default | Range |"]
    rows += ["| --- | --- | --- | --- |", *_rows(effect, definitions)]
    return "\n".join(rows) + "\n" + _example(effect["examples"][0])


def _example(example: Mapping[str, Any]) -> str:
    return f"\n```json\n{json_text(example)}\n```\n"


def _rows(schema: Mapping[str, Any], definitions: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Return the rows of the parameters, those of a part after a dot."""
    for name, each in schema["properties"].items():
        if "$ref" in each:
            yield from _rows(definitions[each["$ref"].removeprefix(REFERENCE)], definitions, f"{above}{name}.")
        elif name != "kind":
            default = f"`{json.dumps(each['default'])}`" if "default" in each else "left out"
            if name == "field":
                default = "a sphere"
            yield f"| `{above}{name}` | {each['description']} | {default} | {_range(each)} |"


def _range(schema: Mapping[str, Any]) -> str:
    """Return in words which values a parameter may have."""
    if "allOf" in schema:
        return "a solid"
    if schema["type"] == "array":
        words = f"list, {schema['maxItems']} at most, " if "minItems" not in schema else "vector, "
        return words + _range(schema["items"]) + (", not 0" if "contains" in schema else "")
    above = "above " if "exclusiveMinimum" in schema else ""
    low = schema.get("exclusiveMinimum", schema.get("minimum", -math.inf))
    high = schema.get("maximum", math.inf)
    if math.isinf(low):
        return f"up to {high:g}"
    return f"{low:g} or more" if math.isinf(high) else f"{above}{low:g} to {high:g}"


if __name__ == "__main__":
    for name, content in (("docs/reference/bridge.md", document()), (SCHEMA_FILE, schema_text())):
        Path(name).write_text(content, encoding="utf-8")
