"""BRIDGE.md from the code: ``python -m tensionlab.haptics.bridge.documents``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from tensionlab.haptics.bridge.messages import IN, KINDS, LARGEST, OUT, PROTOCOL, Body, Message
from tensionlab.haptics.bridge.server import BURST, COMMAND, EVENTS, FASTEST, PATIENCE
from tensionlab.haptics.effects import EFFECTS, SOLIDS
from tensionlab.haptics.effects.compose import FADE
from tensionlab.haptics.effects.compose import PATIENCE as SILENCE
from tensionlab.haptics.effects.effect import LEAP

HEAD = f"""# The bridge

A door to a rig for game engines: `tensionlab serve RIG` opens a WebSocket. Version {PROTOCOL}. This page comes
from the code: `python -m tensionlab.haptics.bridge.documents` writes it.

- `ws://127.0.0.1:8765{COMMAND}` takes frames, 50 to 120 a second, and answers each with exactly one message: the
  state, or why the frame was refused. One client commands; a second one is refused.
- `ws://127.0.0.1:8765{EVENTS}` tells what happens, to any number of clients, and takes nothing.
- Every message is one JSON object, {LARGEST // 1024} KiB at most. The first one to every client is a `welcome`.
  Units are SI; axes are those of the rig (its file says which one is up; Unity's are left-handed: turn one round).
- The rig renders at its own rate, and moves the hand evenly from one frame to the next, a frame behind. One that
  would have to be faster than {LEAP:g} m/s has been put elsewhere, and is at rest there.
- What is stiff or vibrates runs on the modules whose cables lie within 45 degrees of it. The rest is the host's,
  no stiffer than `ceiling` in the state; a `stiff` event names an effect that asks for more.
- `--scenario NAME` plays a scenario over and over: hand and bodies are where the client says, and its effects take
  the place of the scenario's that have their names. Others are felt all the time.
- {SILENCE:g} s after the latest frame the force begins to fade, and {SILENCE + FADE:g} s after it there is none,
  until frames come again. Then it comes back in {FADE:g} s.
- More than {FASTEST:g} messages a second, beyond {BURST} at once, end the connection, and so do {PATIENCE} in a
  row that are refused.
- Pages of this machine may connect, and programs; other pages only with `--page`. Beyond this machine
  (`--host 0.0.0.0`) a token is needed: `?token=...` or `Authorization: Bearer ...`.
- The same comes in over OSC (`--osc PORT`): `/body/hand x y z`, `/effect/NAME KIND parameter value ...`,
  `/effect/NAME` alone to take it away, `/stop`. Nothing is answered.

`examples/bridge/` has clients in Python, JavaScript and C#; the C# one is not run by the tests.
"""


CLIENTS: tuple[type[Message], ...] = (*IN, Body)


def document() -> str:
    """What does BRIDGE.md say?"""
    parts = [HEAD, "## What a client says\n"]
    parts += [_message(kind) for kind in CLIENTS]
    parts += ["## What the bridge says\n", *(_message(kind) for kind in OUT)]
    parts += ["## Kinds of events\n", "| Kind | What it tells |", "| --- | --- |"]
    parts += [*(f"| `{kind}` | {told} |" for kind, told in KINDS.items()), ""]
    parts += ["## Effects\n", "Parameters that are left out have their default.\n"]
    parts += [_effect(name, kind) for name, kind in EFFECTS.items()]
    parts += ["## Solids\n", "What `field` of a shaped effect is: `kind`, sphere if left out, and parameters.\n"]
    parts += [_effect(name, kind) for name, kind in SOLIDS.items()]
    return "\n".join(parts)


def _message(kind: type[Message]) -> str:
    name = kind.model_fields["type"].default if "type" in kind.model_fields else kind.__name__.lower()
    rows = [f"### {name}\n", f"{_first_line(kind)}\n", "| Key | What it is |", "| --- | --- |"]
    for key, field in kind.model_fields.items():
        if key == "type":
            rows.append(f'| `type` | `"{field.default}"` |')
            continue
        said = "left out" in (field.description or "")
        needed = "" if said or field.is_required() or kind not in CLIENTS else "; may be left out"
        rows.append(f"| `{key}` | {field.description or 'text'}{needed} |")
    return "\n".join(rows) + "\n"


def _effect(name: str, kind: type) -> str:
    rows = [f"### {name}\n", f"{_first_line(kind)}\n", "| Parameter | Default |", "| --- | --- |"]
    rows += [f"| `{key}` | `{default}` |" for key, default in _defaults(kind)]
    return "\n".join(rows) + "\n"


def _defaults(kind: type, above: str = "") -> Iterator[tuple[str, Any]]:
    """Parameters by their names, those of parts after a dot, and their defaults."""
    for each in fields(kind):
        default = each.default_factory() if each.default_factory is not MISSING else each.default
        if is_dataclass(default) and not isinstance(default, type):
            yield from _defaults(type(default), f"{each.name}.")
        else:
            yield f"{above}{each.name}", "must be given" if default is MISSING else default


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").strip().split("\n")[0].replace("``", "`")


if __name__ == "__main__":
    Path("BRIDGE.md").write_text(document(), encoding="utf-8")
