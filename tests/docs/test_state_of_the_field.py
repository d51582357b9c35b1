"""The page that compares other software has a source for each cell, and no source is unused."""

from __future__ import annotations

import re
from pathlib import Path

TEXT = (Path(__file__).parents[2] / "docs" / "project" / "state-of-the-field.md").read_text(encoding="utf-8")
SOURCES = dict(re.findall(r"^\[([\w-]+)\]: (\S+)$", TEXT, re.MULTILINE))
NO_SOURCE = {"no"}  # what we do not have is in no document
OWN = ("language", "licence", "last change", "problems", "devices", "graphics")


def tables() -> list[list[list[str]]]:
    """Return the cells of each table of the page, without its rule."""
    found = re.findall(r"(?:^\|.*\|\n)+", TEXT, re.MULTILINE)
    rows = [[line.strip("|").split("|") for line in table.splitlines()] for table in found]
    return [[[cell.strip() for cell in row] for row in table if set(row[0]) != {"-"}] for table in rows]


def test_each_cell_has_its_source() -> None:
    assert len(tables()) == 3
    for head, *rows in tables():
        for feature, own, *others in rows:
            assert len(others) == len(head) - 2, feature
            assert "](" in own or own in NO_SOURCE or feature.lower() in OWN, f"{feature}: {own}"
            for name, cell in zip(head[2:], others, strict=True):
                assert not cell or re.search(r"\]\[[\w-]+\]", cell), f"{name}, {feature}: {cell}"


def test_each_source_is_public_and_used() -> None:
    used = set(re.findall(r"\]\[([\w-]+)\]", TEXT))
    assert used == set(SOURCES)
    assert all(address.startswith("https://") for address in SOURCES.values())
    assert len(set(SOURCES.values())) == len(SOURCES)
