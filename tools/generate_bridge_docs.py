"""BRIDGE.md from the code: ``make generated``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

from tensionlab.haptics.bridge.command import (
    BYTES_AT_ONCE,
    BYTES_PER_S,
    MESSAGES_AT_ONCE,
    MESSAGES_PER_S,
    READ_SHARE,
    SILENCE_S,
)
from tensionlab.haptics.bridge.messages import IN, KINDS, MAX_MESSAGE_BYTES, OUT, PROTOCOL, Body, Message
from tensionlab.haptics.bridge.osc import MAX_DEPTH, MAX_MESSAGES
from tensionlab.haptics.bridge.server import COMMAND_PATH, EVENTS_PATH, MAX_CLIENTS, MAX_REFUSED
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S
from tensionlab.haptics.effects.parameters import MAX_COUNT, Many, Vector, bounds
from tensionlab.haptics.rendering.filtering import FADE_DELAY_S, FADE_S

HEAD = f"""# The bridge

The bridge lets game engines drive a rig: `tensionlab serve RIG` opens a WebSocket. Version {PROTOCOL} of the
messages. This page is generated from the code, by `make generated`.

- `ws://127.0.0.1:8765{COMMAND_PATH}` takes frames, 50 to 120 a second, and answers each with exactly one message:
  the state, or why the frame was refused. One client commands, by WebSocket or OSC; a second one is refused.
  A client in command that sends nothing valid for {SILENCE_S:g} s loses its place.
- `ws://127.0.0.1:8765{EVENTS_PATH}` sends what happens, and takes nothing. There are at most
  {MAX_CLIENTS} clients.
- Every message is one JSON object, {MAX_MESSAGE_BYTES // 1024} KiB at most. The first one to every client is a
  `welcome`. Units are SI; axes are those of the rig (its file says which one is up; Unity's are left-handed: turn
  one round).
- The rig renders at its own rate, and moves the hand evenly from one frame to the next, a frame behind. One that
  would have to be faster than {MAX_HAND_SPEED_M_S:g} m/s has been put elsewhere, and is at rest there.
- What is stiff or vibrates runs on the modules whose cables lie within 45 degrees of it. The rest is the host's,
  no stiffer than `ceiling` in the state; a `stiff` event names an effect that is stiffer.
- `--scenario NAME` plays a scenario over and over: hand and bodies are where the client says, and its effects take
  the place of the scenario's that have their names. Others are rendered all the time.
- {FADE_DELAY_S:g} s after the latest frame the force begins to fade, and {FADE_DELAY_S + FADE_S:g} s after it
  there is none, until frames come again. Then it comes back in {FADE_S:g} s.
- A refusal has a reason, and changes nothing. What is refused: wrong types and dimensions, what lies outside
  the ranges below, names that nobody knows, and what is too much: more than {MESSAGES_PER_S:g} messages a second
  (beyond {MESSAGES_AT_ONCE:g} at once), {1e-3 * BYTES_PER_S:g} kB a second (beyond {1e-3 * BYTES_AT_ONCE:g} kB),
  or {100 * READ_SHARE:g} % of a processor's time for reading it. {MAX_REFUSED} refusals in a row end the
  connection, and so do as many of what is too much without a calm while between.
- The desired force is at most twice what all cables together pull. Effects that fail while they are rendered are
  removed, their force fades, and their client is dismissed with the reason; the loop goes on.
- Pages of this machine may connect, and programs; other pages only with `--page`. Beyond this machine
  (`--host 0.0.0.0`) a token is needed: `?token=...` or `Authorization: Bearer ...`. The server has it from
  `--token-file FILE` or the environment, `TENSIONLAB_BRIDGE_TOKEN`.
- The same comes in over OSC (`--osc PORT`): `/body/hand x y z`, `/effect/NAME KIND parameter value ...`,
  `/effect/NAME` alone to take it away, `/stop`. Nothing is answered; what is ignored is reported on stderr and as
  `ignored` events. All that one machine sends is one client's. A datagram has {MAX_MESSAGES} messages at most, in
  bundles {MAX_DEPTH} deep. OSC has no token, so only this machine is listened to, unless `--osc-host` says
  otherwise.

`examples/bridge/` has clients in Python, JavaScript and C#; the C# one is not run by the tests.
"""


EFFECTS_ABOUT = """Parameters that are left out have their default. Directions (`normal`, `axis`, `direction`,
`gravity`) have theirs for Z up, and are turned with the rig's `up`: with Y up, a wall whose normal is left
out has `[0, 1, 0]`. Vectors have as many components as the rig has axes: on a rig in the plane, give two,
also in place of defaults.
"""
CLIENTS: tuple[type[Message], ...] = (*IN, Body)


def document() -> str:
    """Return the text of BRIDGE.md."""
    parts = [HEAD, "## Messages of a client\n"]
    parts += [_message(kind) for kind in CLIENTS]
    parts += ["## Messages of the bridge\n", *(_message(kind) for kind in OUT)]
    parts += ["## Kinds of events\n", "| Kind | Meaning |", "| --- | --- |"]
    parts += [*(f"| `{kind}` | {meaning} |" for kind, meaning in KINDS.items()), ""]
    parts += ["## Effects\n", EFFECTS_ABOUT]
    parts += [_effect(name, kind) for name, kind in EFFECTS.items()]
    parts += ["## Solids\n", "Of the `field` of a shaped effect: `kind`, sphere if left out, and parameters.\n"]
    parts += [_effect(name, kind) for name, kind in SOLIDS.items()]
    return "\n".join(parts)


def _message(kind: type[Message]) -> str:
    name = kind.model_fields["type"].default if "type" in kind.model_fields else kind.__name__.lower()
    rows = [f"### {name}\n", f"{_first_line(kind)}\n", "| Key | Meaning |", "| --- | --- |"]
    for key, field in kind.model_fields.items():
        if key == "type":
            rows.append(f'| `type` | `"{field.default}"` |')
            continue
        said = "left out" in (field.description or "")
        needed = "" if said or field.is_required() or kind not in CLIENTS else "; may be left out"
        rows.append(f"| `{key}` | {field.description or 'text'}{needed} |")
    return "\n".join(rows) + "\n"


class Row(NamedTuple):
    """Parameter, that of a part after a dot: its name, default, unit and range."""

    name: str
    default: Any
    unit: str
    values: str


def _effect(name: str, kind: type) -> str:
    rows = [f"### {name}\n", f"{_first_line(kind)}\n", "| Parameter | Default | Unit | Range |"]
    rows += ["| --- | --- | --- | --- |"]
    rows += [f"| `{row.name}` | `{row.default}` | {row.unit} | {row.values} |" for row in _rows(kind)]
    return "\n".join(rows) + "\n"


def _rows(kind: type, above: str = "") -> Iterator[Row]:
    for each in fields(kind):
        default = each.default_factory() if each.default_factory is not MISSING else each.default
        if is_dataclass(default) and not isinstance(default, type):
            yield from _rows(type(default), f"{above}{each.name}.")
            continue
        bound = bounds(kind)[each.name]
        number = bound.each if isinstance(bound, Many) else bound
        words = f"{number.low:g} to {number.high:g}"
        if isinstance(bound, Vector):
            words = f"vector, {words}" + (", not 0" if bound.shortest else "")
        elif isinstance(bound, Many):
            words = f"list, {MAX_COUNT} at most, {words}"
        elif bound.positive:
            words = f"above {words}"
        yield Row(f"{above}{each.name}", "must be given" if default is MISSING else default, number.unit, words)


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").strip().split("\n")[0].replace("``", "`")


if __name__ == "__main__":
    Path("BRIDGE.md").write_text(document(), encoding="utf-8")
