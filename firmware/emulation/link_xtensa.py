"""Linker for the emulated Xtensa: relocatable objects of LLVM into one ELF file that QEMU's machine `sim` starts.

No linker of Debian knows both this processor's windowed calls and its floating point unit. Sections lie from
0x4000 on in the order of the objects, writable ones last and on pages of their own: else QEMU would look for
changed code at every write, which takes ten times as long. Vectors lie at 0x1000 and the start at 0x2000. Two
relocations occur: a word, and the offset of a call, a jump or the load of a literal.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

FIRST, PLACES = 0x4000, {".text.vectors": 0x1000, ".text.start": 0x2000}
RESET = 0xFE000000  # where the processor begins
TO_START = bytes([0x22, 0xA0, 0x01, 0x30, 0x22, 0x11, 0xA0, 0x02, 0x00])  # movi a2, 1; slli a2, a2, 13; jx a2
WRITABLE, ALLOCATED, NO_BITS, SYMBOLS, RELOCATIONS = 1, 2, 8, 2, 4  # flags and types of sections of ELF
PAGE = 4096
WORD, SLOT = 1, 20  # R_XTENSA_32, R_XTENSA_SLOT0_OP
UNDEFINED, RESERVED = 0, 0xFF00


@dataclass
class Section:
    """Part of a program, and where it lies."""

    name: str
    data: bytearray
    alignment: int
    writable: bool
    address: int = 0


@dataclass(frozen=True)
class Symbol:
    """Place in a section; without one, to be found by name."""

    name: str
    offset: int
    section: Section | None


def read(path: Path) -> tuple[list[Section], dict[str, Symbol], list[tuple[Section, int, int, Symbol, int]]]:
    """Return the sections of an object file, its global symbols, and its relocations."""
    content = path.read_bytes()
    (start,) = struct.unpack_from("<I", content, 32)
    count, names = struct.unpack_from("<HH", content, 48)
    headers = [struct.unpack_from("<10I", content, start + 40 * i) for i in range(count)]

    def text(table: int, offset: int) -> str:
        begin = headers[table][4] + offset
        return content[begin : content.index(0, begin)].decode()

    sections: dict[int, Section] = {}
    symbols: list[Symbol] = []
    exported: dict[str, Symbol] = {}
    for i, (name, kind, flags, _, offset, size, _, _, alignment, _) in enumerate(headers):
        if flags & ALLOCATED and size:
            data = bytearray(size) if kind == NO_BITS else bytearray(content[offset : offset + size])
            sections[i] = Section(text(names, name), data, max(alignment, 4), bool(flags & WRITABLE))
    for _, kind, _, _, offset, size, link, *_ in headers:
        if kind == SYMBOLS:
            for entry in struct.iter_unpack("<IIIBBH", content[offset : offset + size]):
                here = entry[5]
                symbol = Symbol(text(link, entry[0]), entry[1], sections.get(here) if here < RESERVED else None)
                symbols.append(symbol)
                if entry[3] >> 4 and symbol.section:
                    exported[symbol.name] = symbol
    relocations = [
        (sections[info], place, what & 255, symbols[what >> 8], addend)
        for _, kind, _, _, offset, size, _, info, *_ in headers
        if kind == RELOCATIONS and info in sections
        for place, what, addend in struct.iter_unpack("<IIi", content[offset : offset + size])
    ]
    return list(sections.values()), exported, relocations


def set_offset(section: Section, place: int, target: int) -> None:
    """Write the distance to a target into the instruction at a place."""
    here, data = section.address + place, section.data
    word = int.from_bytes(data[place : place + 3], "little")
    match word & 15:
        case 5:  # call
            word = word & 0x3F | ((target - (here & ~3) - 4) >> 2 & 0x3FFFF) << 6
        case 1:  # load of a literal
            word = word & 0xFF | ((target - (here + 3 & ~3)) >> 2 & 0xFFFF) << 8
        case 6 if not word & 0x30:  # jump
            word = word & 0x3F | (target - here - 4 & 0x3FFFF) << 6
        case _:
            raise ValueError(f"{section.name}+{place:#x}: the instruction {word:06x} cannot be relocated")
    data[place : place + 3] = word.to_bytes(3, "little")


def link(objects: list[Path], program: Path) -> int:
    """Link objects into a program; return the bytes of its code and constants."""
    parts = [read(path) for path in objects]
    sections = sorted((section for part in parts for section in part[0]), key=lambda section: section.writable)
    next(section for section in sections if section.writable).alignment = PAGE
    symbols = {name: symbol for part in parts for name, symbol in part[1].items()}
    end = FIRST
    for section in sections:
        if section.name in PLACES:
            section.address = PLACES[section.name]
        else:
            section.address = -(-end // section.alignment) * section.alignment
            end = section.address + len(section.data)
    for section, place, kind, symbol, addend in (relocation for part in parts for relocation in part[2]):
        found = symbol if symbol.section else symbols.get(symbol.name)
        if found is None or found.section is None:
            raise ValueError(f"nothing defines {symbol.name}")
        target = found.section.address + found.offset + addend
        if kind == WORD:
            (before,) = struct.unpack_from("<I", section.data, place)
            struct.pack_into("<I", section.data, place, (target + before) & 0xFFFFFFFF)
        elif kind == SLOT:
            set_offset(section, place, target)
        else:
            raise ValueError(f"{section.name}+{place:#x}: relocation {kind} is unknown")
    image = bytearray(end)
    for section in sections:
        image[section.address : section.address + len(section.data)] = section.data
    first = 52 + 2 * 32
    header = struct.pack(
        "<16sHHIIIIIHHHHHH", b"\x7fELF\x01\x01\x01", 2, 94, 1, RESET, 52, 0, 0, 52, 32, 2, 40, 0, 0
    )
    for offset, address, size in ((first, RESET, len(TO_START)), (first + len(TO_START), 0, len(image))):
        header += struct.pack("<8I", 1, offset, address, address, size, size, 7, 1)
    program.write_bytes(header + TO_START + image)
    return sum(len(section.data) for section in sections if section.name.startswith((".text", ".rodata")))
