"""How results show themselves: words and colours of statuses, numbers as text, and tables in HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.support.arrays import Floats

if TYPE_CHECKING:
    pass

BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#777777"
"""Of figures and marks: Okabe and Ito 2008, "Color universal design"."""
RAMP = (BLUE, PURPLE, RED)
"""Colours of tensions from the lower limit to the upper one."""
FORCE_COLOURS = {"desired": ORANGE, "commanded": BLUE, "measured": GREEN}
"""Colour of the arrow of each force of a run."""
Colours = NDArray[np.uint8]
STATUS_LOOK = [
    ("exact", "#5A5A5A"),
    ("certified infeasible", "#BBBBBB"),
    ("unproven", RED),
    ("failed", "#000000"),
]
"""Word and colour of each `Status`, in its order."""
STATUS_MARKS = "●○▲✗"
"""Shape of each `Status`, for those who do not see the colours."""
MAX_ROWS = 40
"""Rows of a table; of more, those in the middle are left out."""
MAX_COMPONENTS = 8
"""Components of a vector; of more, those in the middle are left out."""


def rgb(colour: str) -> Colours:
    """Return the colour of a text such as "#0072B2" as numbers (3,)."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.uint8)


def ramp(tensions: Floats, lower: Floats, upper: Floats) -> Colours:
    """Return colours (m, 3) by where tensions (m,) are between their limits (m,); grey for NaN."""
    share = (tensions - lower) / np.where(upper > lower, upper - lower, 1.0)
    stops = np.stack([rgb(colour) for colour in RAMP]).astype(np.float64)
    at = np.linspace(0.0, 1.0, len(stops))
    found = np.stack([np.interp(np.nan_to_num(share), at, channel) for channel in stops.T], axis=-1)
    return np.where(np.isnan(share)[:, None], rgb(GREY), np.round(found)).astype(np.uint8)


class Mark(NamedTuple):
    """Word with a coloured shape before it."""

    shape: str
    colour: str
    word: str

    @property
    def text(self) -> str:
        """Both without the colour."""
        return f"{self.shape} {self.word}"


@dataclass(frozen=True)
class Finding:
    """Check with what was found, and what to do where it failed.

    ``passed`` is None for a note that is neither good nor bad.
    """

    name: str
    passed: bool | None
    text: str


def status_mark(status: int) -> Mark:
    """Return the mark of a `Status`."""
    word, colour = STATUS_LOOK[status]
    return Mark(STATUS_MARKS[status], colour, word)


def met_mark(met: bool, words: tuple[str, str] = ("yes", "no")) -> Mark:
    """Return the mark of what is as it should be, or is not."""
    return Mark("✓", GREEN, words[0]) if met else Mark("✗", RED, words[1])


def short(value: float) -> str:
    """Return a number with two significant digits in at most six characters; a dash for NaN."""
    if math.isnan(value):
        return "–"
    size = abs(value)
    if size == 0:
        return "0"
    if size < 5e-4:
        return f"{value:.0e}".replace("e-0", "e-")
    if size >= 99.5:
        return f"{value:.0f}"
    return f"{value:.{1 if size >= 9.95 else 2 if size >= 0.0995 else 3}f}"


def duration(seconds: float) -> str:
    """Return a time with at most three digits and the unit that suits it; a dash for NaN."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.9995 * size:
            value = seconds / size
            return f"{value:.0f} {unit}" if value >= 99.5 else f"{value:.2g} {unit}"
    return "–" if math.isnan(seconds) else f"{round(seconds / 1e-9)} ns"  # round: no minus zero


def percent(share: float) -> str:
    """Write a share, with 100 % only for all and 0 % only for nothing."""
    if math.isnan(share):
        return "–"
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    return f"{min(99.9, max(0.1, 100 * share)):.1f} %"


def vector(values: Any) -> str:
    """Return components in brackets, without trailing zeros or rounding errors; a long one without its middle."""
    known = np.asarray(values, dtype=np.float64)
    small = 1e-12 * np.abs(known).max(initial=0.0)
    words = [f"{0.0 if abs(value) <= small else value:.4g}" for value in known.tolist()]
    if len(words) > MAX_COMPONENTS:
        words[MAX_COMPONENTS // 2 : -2] = ["…"]
    return f"({', '.join(words)})"


def count(number: int, word: str) -> str:
    """Return a number with the word for what is counted, such as "1 cable" or "12,000 cables"."""
    return f"{number:,} {word}{'s' * (number != 1)}"


def extent(*arrays: Any) -> str:
    """Return the range of all finite numbers, such as "0.5" or "0.5 to 6"; a dash if there is none."""
    known = np.concatenate([np.ravel(values) for values in arrays])
    known = known[np.isfinite(known)]
    ends = dict.fromkeys(f"{end:.4g}" for end in (known.min(), known.max())) if known.size else ["–"]
    return " to ".join(ends)


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
        value = status_mark(value)
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
        return short(value)
    return _escape(vector(value) if getattr(value, "ndim", 0) else str(value))


def _escape(text: str) -> str:
    return html.escape(text, quote=False)
