"""How results show themselves: words and colours of statuses, numbers as text, and tables in HTML."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from tensionlab.support.colours import GREEN, RED
from tensionlab.support.formatting import format_number, format_vector

MAX_ROWS = 40
"""Rows of a table; of more, those in the middle are left out."""


class Mark(NamedTuple):
    """Word with a coloured shape before it."""

    shape: str
    colour: str
    word: str

    @property
    def text(self) -> str:
        """Both without the colour."""
        return f"{self.shape} {self.word}"


STATUS_MARKS = (
    Mark("●", "#5A5A5A", "exact"),
    Mark("○", "#BBBBBB", "certified infeasible"),
    Mark("▲", RED, "unproven"),
    Mark("✗", "#000000", "failed"),
)
"""Mark of each `Status`, in its order; the shapes are for readers who do not see the colours."""


@dataclass(frozen=True)
class Finding:
    """Check with what was found, and what to do where it failed.

    ``passed`` is None for a note that is neither good nor bad.
    """

    name: str
    passed: bool | None
    text: str


def met_mark(met: bool, words: tuple[str, str] = ("yes", "no")) -> Mark:
    """Return the mark of what is as it should be, or is not."""
    return Mark("✓", GREEN, words[0]) if met else Mark("✗", RED, words[1])


def table(
    title: str | Mark, headings: Sequence[str], rows: Iterable[Sequence[Any]], notes: Sequence[str] = ()
) -> str:
    """Return a table in HTML, for notebooks, with its title above and notes below.

    Columns are for numbers, to the right; those whose heading begins with ``<`` are for text, to the left, as in
    the tables on terminals. Numbers have two digits, or are whole; a `Status`, a `Mark` and a truth value have a
    shape and a colour; vectors are in brackets; None is a dash. Without headings, all columns are text.
    """
    lines = [[_cell(value) for value in row] for row in rows]
    sides = ["left" if heading.startswith("<") else "right" for heading in headings]
    sides = sides or ["left"] * max(map(len, lines), default=0)
    if len(lines) > MAX_ROWS:
        left = len(lines) - MAX_ROWS
        lines[MAX_ROWS // 2 : -MAX_ROWS // 2] = [[f"… {left:,} more", *[""] * (len(sides) - 1)]]
    head = (_escape(heading.removeprefix("<")).replace("\n", "<br>") for heading in headings)
    above = f'<div style="font-weight:bold;margin-bottom:2px">{_cell(title)}</div>' if title else ""
    below = "".join(f'<div style="font-size:90%;opacity:0.75">{_escape(note)}</div>' for note in notes)
    body = _row("th", head, sides) if headings else ""
    body += "".join(_row("td", line, sides) for line in lines)
    style = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0 0 4px 0"
    return f'<div>{above}<table style="{style}">{body}</table>{below}</div>'


def _row(tag: str, cells: Iterable[str], sides: Sequence[str]) -> str:
    look = "padding:2px 12px 2px 0;vertical-align:" + (
        "bottom;border-bottom:1px solid #999" if tag == "th" else "top"
    )
    numbers = ";white-space:nowrap" if tag == "td" else ""
    found = "".join(
        f'<{tag} style="text-align:{side};{look}{numbers if side == "right" else ""}">{cell}</{tag}>'
        for cell, side in zip(cells, sides, strict=True)
    )
    return f"<tr>{found}</tr>"


def _cell(value: Any) -> str:
    """Return what a table shows for a value, in HTML."""
    if isinstance(value, IntEnum):
        value = STATUS_MARKS[value]
    if isinstance(value, (bool, np.bool_)):
        value = met_mark(bool(value))
    if isinstance(value, Mark):
        look = f"color:{value.colour};text-shadow:0 0 1px #999"  # black has an edge on a dark page, too
        return f'<span style="{look}">{value.shape}</span> {_escape(value.word)}'
    if value is None:
        return "–"
    if isinstance(value, (int, np.integer)):
        return f"{value:,}"
    if isinstance(value, float):
        return format_number(value)
    return _escape(format_vector(value) if getattr(value, "ndim", 0) else str(value))


def _escape(text: str) -> str:
    return html.escape(text, quote=False)
