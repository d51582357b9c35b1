"""docs/reference/bridge.md from the code: ``make generated``."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

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
from tensionlab.haptics.bridge.server import (
    COMMAND_PATH,
    EVENTS_PATH,
    MAX_CLIENTS,
    MAX_REFUSED,
    PAGE_PATH,
    SCHEMA_PATH,
    STATE_PATH,
    STATE_PERIOD_S,
)
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S
from tensionlab.haptics.rendering.renderer import FADE_DELAY_S, FADE_S

HEAD = f"""# The bridge

The bridge lets game engines and other programs drive a rig: `tensionlab serve RIG` opens a WebSocket. This
page specifies its messages, version {PROTOCOL}. It is generated from the code, by `make generated`. [Drive a
rig from a game engine](../how-to/drive-it-from-a-game-engine.md) is a tutorial.

## Connections

- `ws://127.0.0.1:8765{COMMAND_PATH}` takes frames, 50 to 120 per second, and answers each with exactly one
  message: the state, or the reason of a refusal. Events come between the answers: read on until `type` is not
  `event`. One client commands, by WebSocket or OSC; a second one is refused. A commanding client that sends
  nothing valid for {SILENCE_S:g} s loses its place.
- `ws://127.0.0.1:8765{EVENTS_PATH}` only sends events; `{STATE_PATH}` also sends the state, every
  {STATE_PERIOD_S:g} s. There are at most {MAX_CLIENTS} clients. A limiter of a module, or a softened effect,
  is an event when it begins, and again only after an absence of 1 s.
- `http://127.0.0.1:8765{PAGE_PATH}` is a page that shows the state live, and `{SCHEMA_PATH}` is the JSON
  Schema of all messages for this rig, with its bodies, dimension and defaults. `examples/bridge/schema.json`
  is valid for all rigs.
- Connections, disconnections and refusals are printed on stderr and sent as `client` events.

Every message is one JSON object of at most {MAX_MESSAGE_BYTES // 1024} KiB. The first one to every client is
a `welcome`. Units are SI; axes are those of the rig. The welcome says which axis is up; Unity's axes are
left-handed.

Times are in s. The time of a frame is on the client's own clock, with any origin; it never decreases, unless
no frame has come for 1 s. All other times are on the clock of the run, `time` of the state.

## Rendering

- The rig renders at its own rate, and interpolates the hand between frames, one frame behind. Motions of the
  hand faster than {MAX_HAND_SPEED_M_S:g} m/s are taken for jumps of the tracker, and the hand for resting.
- Modules render stiff and vibrating effects, if their cables lie within 45 degrees of them, and
  vibrations by several cables together. The host renders
  the others, no stiffer than `ceiling` in the state. If that is less than desired, `softened` in the state
  has the rendered stiffness, and a `stiff` event reports the begin.
- `--scenario NAME` repeats a scenario. Hand and bodies are where the client says, and the client's effects
  replace those of the scenario with the same names; the others are rendered all the time.
- The force fades from {FADE_DELAY_S:g} s after the latest frame on, and is 0 after {FADE_DELAY_S + FADE_S:g}
  s. When frames come again, it returns in {FADE_S:g} s.
- The force demanded of the modules is at most twice what all cables together pull. Effects that fail during
  rendering are removed, their force fades, and their client is disconnected with the reason; the loop
  continues.

## Refusals

A refusal has a reason, and changes nothing. Refused are wrong types and dimensions, values outside the ranges
below, unknown names, and floods: more than {MESSAGES_PER_S:g} messages per second (beyond
{MESSAGES_AT_ONCE:g} at once), {1e-3 * BYTES_PER_S:g} kB per second (beyond {1e-3 * BYTES_AT_ONCE:g} kB), or
{100 * READ_SHARE:g} % of a processor's time for reading. {MAX_REFUSED} refusals in a row end the connection;
in a flood, so do as many without a pause.

## Who may connect

- Programs and pages of this machine may connect; other pages only with `--page`. A URL must name this machine
  as `127.0.0.1`, `localhost` or `[::1]`, so that no foreign page can point its own name here.
- Beyond this machine (`--host 0.0.0.0`) clients need a token: `?token=...` or `Authorization: Bearer ...`.
  The server reads it from `--token-file FILE` or the environment variable `TENSIONLAB_BRIDGE_TOKEN`.
- On Linux, programs of another user of this machine are refused without a token. OSC and other systems cannot
  tell users apart.

## OSC

With `--osc PORT` the bridge takes the same over OSC: `/body/hand x y z`, `/effect/NAME KIND parameter value
...`, `/effect/NAME` alone to end it, `/stop`. Parameters have the names of the tables below, such as
`/effect/floor wall plane.point 0 0.32 0 plane.normal 0 1 0 stiffness 100`, and `field.kind` a word. There are
no answers: a refusal is a line on stderr and a `refused` event, with the reason. All messages of one machine
are one client's. A datagram has at most {MAX_MESSAGES} messages, in one bundle. OSC has no token, so only
this machine is listened to, unless `--osc-host` says otherwise.

`examples/bridge/` has clients in Python, JavaScript and Python over OSC, `examples/unity/` a package for
Unity, and `examples/web/` a page.
"""


EFFECTS_ABOUT = """An effect is an object with its `kind` and parameters; each example has all of them at
their defaults. Default directions (`normal`, `axis`, `direction`, `gravity`) are for Z up, and are turned
with the rig's `up`: with Y up, the default normal of a wall is `[0, 1, 0]`. Vectors have as many components
as the rig has axes: on a planar rig, give two, even for defaults. Times (`shots`, `grasped`, `loosed`) are on
the clock of the run, `time` of the state.
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
    parts += ["## Solids\n", "Values of `field` of a shaped effect: `kind`, sphere if left out, and parameters.\n"]
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
