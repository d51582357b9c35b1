"""Tables of the firmware's documents, made from the firmware; `make generated` writes them.

Run that after a change to messages, parameters, plant or supervisor. A test fails while a document says something
else than the code.
"""

from __future__ import annotations

import json
import math
import re
import struct
from binascii import crc_hqx
from collections.abc import Iterable
from inspect import get_annotations, getdoc
from pathlib import Path
from typing import get_type_hints

from firmware.model.check import PROPERTIES
from tensionlab.hardware.protocol import codes
from tensionlab.hardware.protocol.codes import EVENTS, PARAMETERS, DescribedCode, Fault
from tensionlab.hardware.protocol.messages import CHECKSUM_BYTES, DELIMITER, MESSAGES, Message, SetTension
from tensionlab.hardware.simulation.simulated_module import PLANT, TRANSITIONS

FOLDER = Path("firmware")
PROCESSORS = {"cortex-m4f": "Cortex-M4F", "xtensa": "Xtensa (ESP32)"}
# How a field's layout is written in the document.
LETTERS = {"B": "u8", "H": "u16", "I": "u32", "Q": "u64", "f": "f32", "?": "flag", "": "text"}


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table in Markdown."""
    lines = [list(head), *([str(cell) for cell in row] for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def messages(from_module: bool) -> str:
    """Return the table of messages, with their bytes."""
    rows = [
        (f"`0x{number:02X}`", message.type.name, payload(message), described(message))
        for number, message in sorted(MESSAGES.items())
        if (number >= 0x80) is from_module
    ]
    return table(("Type", "Message", "Payload", "Meaning"), rows)


def payload(message: type[Message]) -> str:
    """Return the fields of a message, in their order, and its size."""
    hints = get_type_hints(message, include_extras=True)
    letters = {name: hints[name].__metadata__[0] for name in get_annotations(message)}
    if not letters:
        return "none"
    fields = ", ".join(f"{name} {LETTERS[letter]}" for name, letter in letters.items())
    size = struct.calcsize("<" + "".join(letters.values()))
    return fields if "" in letters.values() else f"{fields} ({size} byte{'' if size == 1 else 's'})"


def described(message: type[Message]) -> str:
    """Return the description of a message."""
    text = " ".join((getdoc(message) or "").split()).replace("``", "`")
    for other in MESSAGES.values():
        text = text.replace(f"`{other.__name__}`", other.type.name)
    return text


def words(kind: type[DescribedCode | Fault]) -> str:
    """Return the table of an enumeration."""
    return table(("Number", "Name", "Meaning"), [(f"`{each.value}`", each.name, each.meaning) for each in kind])


def example() -> str:
    """Return the table of a frame, from its fields to the wire."""
    command, sequence = SetTension(session=0x1234, tension=3.0, ttl_ms=250), 7
    frame = command.frame(sequence)
    body = bytes([frame.type, frame.sequence]) + frame.payload
    packed = frame.pack()
    checksum = packed[-CHECKSUM_BYTES - len(DELIMITER) : -len(DELIMITER)]
    stuffed = packed[: -CHECKSUM_BYTES - len(DELIMITER)]
    crc = crc_hqx(stuffed, 0xFFFF)
    rows = [
        ("type, sequence number", spaced(body[:2])),
        ("session 0x1234", spaced(body[2:4])),
        ("tension 3.0", spaced(body[4:8])),
        ("brake 0", spaced(body[8:9])),
        ("ttl_ms 250", spaced(body[9:])),
        ("stuffed, upper bits set", spaced(stuffed)),
        (f"CRC 0x{crc:04X}: {crc >> 9:07b} {crc >> 2 & 0x7F:07b} {crc & 3:02b}", spaced(checksum)),
        ("on the wire", spaced(packed)),
    ]
    return table(("Part", "Bytes"), rows)


def spaced(content: bytes) -> str:
    """Return bytes in hexadecimal."""
    return f"`{content.hex(' ').upper()}`"


def parameters() -> str:
    """Return the table of parameters."""
    rows = [
        (row.index, f"`{name}`", row.unit, f"{row.lower:g}", f"{row.upper:g}", f"{row.default:g}", row.meaning)
        for name, row in PARAMETERS.items()
    ]
    return table(("", "Parameter", "Unit", "Minimum", "Maximum", "Default", "Meaning"), rows)


def plant() -> str:
    """Return the table of the simulated hardware."""
    rows = [(f"`{name}`", row.unit, f"{row.default:g}", row.about) for name, row in PLANT.items()]
    return table(("Parameter", "Unit", "Value", "Meaning and source"), rows)


def shields() -> str:
    """Return the table of what the shields change: constants, and where their wires go."""
    declaration = re.compile(r"^constexpr \w+ (k\w+) = (.*?);(?: +// (header pad \w+|own divider)\b)?", re.M)
    head, columns = ["Constant"], []
    for path in sorted((FOLDER / "esp32" / "boards").glob("shield_*.hpp")):
        text = path.read_text(encoding="utf-8")
        head.append(" ".join(re.findall(r"shield (v[\w.]+): (\w+)", text)[0]))
        columns.append({name: (value, where) for name, value, where in declaration.findall(text)})
    rows = []
    for name in dict.fromkeys(name for column in columns for name in column):
        found = [column.get(name, ("", "")) for column in columns]
        rows.append([f"`{name}`", *(re.sub(r"f\b", "", f"{v}: {where}" if where else v) for v, where in found)])
    return table(head, rows)


def transitions() -> str:
    """Return the table of the supervisor's transitions."""
    rows = []
    for event, row in zip(EVENTS, TRANSITIONS, strict=True):
        rows.append([event, *(to.name.lower() if accepted else "refused" for accepted, to in row)])
    return table(("Event", *(state.name.lower() for state in codes.State)), rows)


def drawing() -> str:
    """Return a diagram of the supervisor, without transitions that change nothing."""
    arrows: dict[tuple[str, str], list[str]] = {}
    for event, row in zip(EVENTS, TRANSITIONS, strict=True):
        for state, (accepted, to) in zip(codes.State, row, strict=True):
            if accepted and to is not state:
                arrows.setdefault((state.name.lower(), to.name.lower()), []).append(event)
    lines = [f"    {begin} --> {end}: {', '.join(events)}" for (begin, end), events in arrows.items()]
    return "\n".join(["```mermaid", "stateDiagram-v2", "    [*] --> idle", *lines, "```"])


def figures() -> str:
    """Return the table of what `firmware/check.py --write` measured."""
    measured = json.loads((FOLDER / "figures.json").read_text())
    arm, esp32, flips = (measured[name] for name in ("arm", "esp32", "flips"))
    emulated = json.loads((FOLDER / "emulated.json").read_text())["core"]
    stacks = ", ".join(f"{emulated[processor]['stack']} bytes on {name}" for processor, name in PROCESSORS.items())
    rows = (
        ("Core, Cortex-M4F, -Os: text", f"{arm['text_bytes']} bytes; below 16384 is required"),
        (
            "Core: data and bss, one module",
            f"{arm['data_bytes'] + arm['bss_bytes']} bytes; below 2048 is required",
        ),
        ("Core: library functions", f"{', '.join(arm['asks_for'])}: no heap, nothing in double precision"),
        ("Core: stack", f"{stacks}; largest frame {arm['deepest_frame_bytes']} bytes"),
        ("Core, ESP32", f"{esp32['core_instructions']} instructions; calls {', '.join(esp32['core_calls'])}"),
        (
            "One and two bits flipped, frames of all lengths",
            f"{flips['flips']:,} flips, {flips['passed']} passed",
        ),
        ("Fuzzing under sanitizers", f"{measured['fuzzing']['chunks']:,} chunks of bytes, no finding"),
    )
    return table(("What", "Measured"), rows)


def core() -> str:
    """Return the table of the core's instructions that `firmware/emulate.py --write` counted."""
    measured = json.loads((FOLDER / "emulated.json").read_text())["core"]
    kinds = {"step": "step", "turn": "turn of the loop", "restart": "start, with stored parameters"}
    kinds |= {message.type.name.lower(): message.type.name for kind, message in MESSAGES.items() if kind < 0x80}
    quantiles = [(processor, share) for processor in PROCESSORS for share in ("median", "p999", "worst")]
    rows = [
        (label, *(f"{measured[processor][f'{kind}_{share}']:,}" for processor, share in quantiles))
        for kind, label in kinds.items()
    ]
    shares = [share for name in PROCESSORS.values() for share in (f"{name}: median", "99.9 %", "worst")]
    return table(("Instructions", *shares), rows)


def allocator() -> str:
    """Return the table of what `firmware/emulate.py --write` measured."""
    measured = json.loads((FOLDER / "emulated.json").read_text())["allocator"]
    kilobytes, thousands = "{:.0f} kB".format, "{:,.0f}k".format
    rows = [
        (
            name,
            shape.replace("x", "·"),
            kilobytes(found["flash"] / 1000),
            f"{found['object']:,} B",
            f"{found['stack']:,} B",
            *(thousands(found[share] / 1000) for share in ("median", "p999", "worst")),
        )
        for processor, name in PROCESSORS.items()
        for shape, found in measured[processor].items()
    ]
    head = ("Processor", "n · m", "flash", "object", "stack", "instructions: median", "99.9 %", "worst")
    return table(head, rows)


def model() -> str:
    """Return what `firmware/model/check.py --write` explored: the properties, and the errors that break them."""
    measured = json.loads((FOLDER / "model" / "model.json").read_text())
    broken_by: dict[str, list[str]] = {}
    for found in measured["errors"]:
        broken_by.setdefault(found["property"], []).append(f"`{found['error']}`")
    searches = {row["environment"]: row for row in measured["properties"]}
    links, service = (
        f"{found['states']:,} states and {found['transitions']:,} transitions"
        for found in (searches["links"], searches["service"])
    )
    rows = [(text, ", ".join(broken_by[name])) for name, text in PROPERTIES.items()]
    return (
        f"All hold in {links} with the host's frames,\nand in {service} with faults, settings and the brake.\n\n"
        + table(("Property", "Errors that break it, all found"), rows)
    )


def ratings() -> str:
    """Return the table of what `firmware/ratings.py --write` computed."""
    measured = json.loads((FOLDER / "ratings.json").read_text())
    rows = []
    for room, amperes in measured["continuous"].items():
        held = measured["hold"][room].items()
        peaks = [
            "; ".join(f"{3.0 * float(amps):.0f} N {seconds[at]:.0f} s" for amps, seconds in held)
            for at in range(3)
        ]
        rows.append((f"{room} °C", f"{amperes:.2f} A: {3.0 * amperes:.1f} N", *peaks))
    head = ("Room", "for good", "peaks from cold", "after an hour at half of that", "after it and a minute's rest")
    return table(head, rows)


def estimate() -> str:
    """Return the sentence on the estimate that `firmware/ratings.py --write` compared."""
    found = json.loads((FOLDER / "ratings.json").read_text())["estimate"]
    return (
        f"Of {found['modules']:,} modules, none had a winding more than {found['warmer_than_estimated']:.1f} K\n"
        f"warmer than estimated. The warmest winding had {found['winding']:.0f} °C, the warmest housing "
        f"{found['housing']:.0f} °C,\nthe warmest driver {found['driver']:.0f} °C."
    )


def dangers() -> str:
    """Return the table of what `firmware/dangers.py --write` measured."""
    measured = json.loads((FOLDER / "dangers.json").read_text())["dangers"]
    rows = [
        (
            found["danger"],
            found["must_happen"],
            " or ".join(fault.name or "" for fault in codes.Fault(found["faults"])),
            "" if found["noticed_s"] < 0.0 else _duration(found["noticed_s"]),
            f"{math.ceil(10.0 * found['tension_n']) / 10.0:.1f} N",
        )
        for found in measured
    ]
    return table(("Danger", "What the module does", "Fault", "Within", "Tension at most"), rows)


def _duration(seconds: float) -> str:
    """Round a time up to two digits."""
    if seconds < 0.1:
        return f"{math.ceil(1e3 * seconds)} ms"
    return f"{math.ceil(100.0 * seconds) / 100.0:.2f} s"


def sections() -> dict[str, dict[str, str]]:
    """Return the tables of each document."""
    kinds = (
        codes.Code,
        codes.State,
        codes.Limit,
        codes.Fault,
        codes.Calibration,
        codes.BrakeState,
        codes.ResetReason,
    )
    return {
        "README.md": {
            "drawing": drawing(),
            "transitions": transitions(),
            "parameters": parameters(),
            "shields": shields(),
            "plant": plant(),
            "figures": figures(),
            "core": core(),
            "allocator": allocator(),
            "dangers": dangers(),
            "model": model(),
            "ratings": ratings(),
            "estimate": estimate(),
        },
        "PROTOCOL.md": {
            "example": example(),
            "commands": messages(from_module=False),
            "answers": messages(from_module=True),
            **{kind.__name__: words(kind) for kind in kinds},
        },
    }
