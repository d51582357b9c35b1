"""Tables of results, for terminals, notebooks, Markdown and pandas."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.support.colours import GREEN, RED
from tensionlab.support.formatting import format_vector, words_of, wrap

if TYPE_CHECKING:
    import pandas

WIDE = 120  # characters per line of a terminal that shows all columns
MAX_HTML_ROWS = 40  # longer tables are shown without their middle
MAX_HEADING_LINES = 3
MIN_TEXT_WIDTH, COMFORTABLE_WIDTH = 12, 30  # text columns: never narrower; narrower only with narrow gaps


class Mark(NamedTuple):
    """Word with a coloured shape before it."""

    shape: str
    colour: str
    word: str

    def __str__(self) -> str:
        return f"{self.shape} {self.word}"


STATUS_MARKS = (
    Mark("●", "#5A5A5A", "exact"),
    Mark("○", "#BBBBBB", "certified infeasible"),
    Mark("▲", RED, "unproven"),
    Mark("✗", "#000000", "failed"),
)  # in the order of `Status`; shapes serve readers who do not see the colours


def met_mark(met: bool, words: tuple[str, str] = ("yes", "no")) -> Mark:
    """Return the mark of a check."""
    return Mark("✓", GREEN, words[0]) if met else Mark("✗", RED, words[1])


@dataclass(frozen=True)
class Column:
    """Column of a table, with a heading such as "tension (N)"."""

    name: str
    unit: str = ""
    format: str | Callable[[Any], str] = ".4g"  # specification, or function of the number
    wide: bool = False  # whether terminals of fewer than `WIDE` characters leave it out

    @property
    def heading(self) -> str:
        """Name with the unit in parentheses."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    def text(self, value: Any) -> str:
        """Return a value as text: None and NaN as a dash, vectors in brackets."""
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return "–"
        if getattr(value, "ndim", 0):
            return format_vector(value)
        if not isinstance(value, (int, float, np.number)):
            return str(value)
        if callable(self.format):
            return self.format(value)
        return format(value, "," if isinstance(value, (int, np.integer)) else self.format)


class Table:
    """Rows of values under headings, with a title above and notes below.

    Columns of text are left-aligned, columns of numbers right-aligned; empty columns are left out. Cells are
    numbers, texts, vectors, truth values, members of `Status` or marks; None where there is no value. The
    ``legend`` says what words mean: text has a note for those in a heading or a cell that it shows.

    Examples
    --------
    >>> from tensionlab.support.table import Column, Table
    >>> print(Table(["module", Column("tension", "N")], [["left", 1.5], ["right", 0.5]]))
    module  tension (N)
    ───────────────────
    left            1.5
    right           0.5
    """

    def __init__(
        self,
        columns: Sequence[Any],
        rows: Iterable[Sequence[Any]],
        title: str | Mark = "",
        notes: Sequence[str] = (),
        legend: Mapping[str, str] | None = None,
    ) -> None:
        listed = [[_marked(value) for value in row] for row in rows]
        known = [Column(column) if isinstance(column, str) else column for column in columns]
        shown = [i for i in range(len(known)) if not listed or any(_has_value(row[i]) for row in listed)]
        self.columns = [known[i] for i in shown]
        self.rows = [[row[i] for i in shown] for row in listed]
        self.title, self.notes, self.legend = title, list(notes), legend or {}

    def __repr__(self) -> str:
        return self.to_text()

    def _is_text(self, column: int) -> bool:
        values = [row[column] for row in self.rows if row[column] is not None]
        return bool(values) and all(isinstance(value, (str, Mark)) for value in values)

    def _texts(self) -> list[list[str]]:
        return [[column.text(value) for column, value in zip(self.columns, row, strict=True)] for row in self.rows]

    def to_text(self, width: int = WIDE) -> str:
        """Return the table as text for a terminal of a width in characters; long texts have several lines."""
        shown = [i for i, column in enumerate(self.columns) if width >= WIDE or not column.wide]
        cells = [[row[i] for i in shown] for row in self._texts()]
        text = [self._is_text(i) for i in shown]
        widths = [max((len(row[j]) for row in cells), default=0) for j in range(len(shown))]
        headings = [_wrap_heading(self.columns[i].heading, widths[j]) for j, i in enumerate(shown)]
        widths = [max(size, *map(len, lines)) for size, lines in zip(widths, headings, strict=True)]
        narrowest = [min(size, COMFORTABLE_WIDTH) if text[j] else size for j, size in enumerate(widths)]
        gap = 2 if sum(narrowest) + 2 * len(narrowest) - 2 <= width else 1
        widths = _narrowed(cells, headings, widths, text, width - gap * (len(widths) - 1))
        headings = [
            lines if max(map(len, lines)) <= size else wrap(" ".join(lines), size)
            for lines, size in zip(headings, widths, strict=True)
        ]
        lines = wrap(str(self.title), width) if self.title else []
        if any(self.columns[i].name for i in shown):
            lines += _lines(headings, widths, text, gap, last=True)
            lines.append("─" * (sum(widths) + gap * (len(widths) - 1)))
        for row in cells:
            lines += _lines([wrap(*cell) for cell in zip(row, widths, strict=True)], widths, text, gap)
        words = {word for i in shown for word in self.columns[i].name.split()}
        words.update(word for row in cells for cell in row for word in cell.split())
        notes = [f"{term}: {meaning}" for term, meaning in self.legend.items() if words.issuperset(term.split())]
        notes += self.notes
        lines += [""] * bool(notes)
        for note in notes:
            lines += wrap(note, width)
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        sides = ["left" if self._is_text(i) else "right" for i in range(len(self.columns))]
        rows = [[*map(_html, row, self.columns)] for row in self.rows]
        if len(rows) > MAX_HTML_ROWS:
            hidden = f"… {len(rows) - MAX_HTML_ROWS:,} more"
            rows[MAX_HTML_ROWS // 2 : -MAX_HTML_ROWS // 2] = [[hidden, *[""] * (len(sides) - 1)]]
        title = f'<div style="font-weight:bold;margin-bottom:2px">{_html(self.title)}</div>' if self.title else ""
        notes = "".join(f'<div style="font-size:90%;opacity:0.75">{_escape(note)}</div>' for note in self.notes)
        head = [_escape(column.heading) for column in self.columns]
        body = _html_row("th", head, sides) if any(head) else ""
        body += "".join(_html_row("td", row, sides) for row in rows)
        style = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0 0 4px 0"
        return f'<div>{title}<table style="{style}">{body}</table>{notes}</div>'

    def to_markdown(self) -> str:
        """Return the table in Markdown, with its notes below."""
        ruler = [":--" if self._is_text(i) else "--:" for i in range(len(self.columns))]
        rows = [[column.heading for column in self.columns], *self._texts()]
        rows = [[cell.replace("|", "\\|") for cell in row] for row in rows]
        lines = ["| " + " | ".join(row) + " |" for row in (rows[0], ruler, *rows[1:])]
        return "\n\n".join(["\n".join(lines), *self.notes])

    def to_pandas(self) -> pandas.DataFrame:
        """Return the values as a data frame; MissingDependency if pandas is not installed."""
        from tensionlab.support.provenance import data_frame

        headings = [column.heading for column in self.columns]
        return data_frame([dict(zip(headings, row, strict=True)) for row in self.rows])


@dataclass(frozen=True)
class Finding:
    """Check with what was found, and what to do where it failed.

    ``passed`` is None for a note that is neither good nor bad.
    """

    name: str
    passed: bool | None
    text: str


def findings_table(title: str, findings: Iterable[Finding]) -> Table:
    """Return the table of what was checked: each with yes, no or note."""
    rows = [
        ["note" if finding.passed is None else finding.passed, finding.name, finding.text] for finding in findings
    ]
    return Table(["", "check", "finding"], rows, title)


def _has_value(value: Any) -> bool:
    return value is not None and not (isinstance(value, str) and not value)


def _marked(value: Any) -> Any:
    """Return the mark of a status or truth value; anything else as it is."""
    if isinstance(value, IntEnum):
        return STATUS_MARKS[value]
    return met_mark(bool(value)) if isinstance(value, (bool, np.bool_)) else value


def _narrowed(
    cells: Sequence[Sequence[str]],
    headings: Sequence[Sequence[str]],
    widths: Sequence[int],
    text: Sequence[bool],
    available: int,
) -> list[int]:
    """Return the widths of columns with those of text narrowed to fit the available width.

    Names, which are in the first column of text under a heading, keep their width; words are split only where
    they do not fit otherwise.
    """
    narrowed, columns = list(widths), range(len(widths))
    for words in (True, False):
        floor = [MIN_TEXT_WIDTH] * len(narrowed)
        if words and sum(narrowed) > available:
            parts = [[*headings[j], *(row[j] for row in cells)] for j in columns]
            floor = [max(len(word) for part in column for word in words_of(part)) for column in parts]
            for j in [j for j in columns if text[j] and any(headings[j])][:1]:
                floor[j] = max(floor[j], min(narrowed[j], COMFORTABLE_WIDTH))
        while sum(narrowed) > available:
            able = [j for j in columns if text[j] and narrowed[j] > max(floor[j], MIN_TEXT_WIDTH)]
            if not able:
                break
            narrowed[max(able, key=narrowed.__getitem__)] -= 1
    return narrowed


def _wrap_heading(text: str, width: int) -> list[str]:
    """Return a heading in few lines, as narrow as its words and at least as wide as the cells below."""
    width = max([width, 1, *map(len, words_of(text))])
    while len(lines := wrap(text, width)) > MAX_HEADING_LINES:
        width += 1
    return lines


def _lines(
    cells: Sequence[Sequence[str]], widths: Sequence[int], text: Sequence[bool], gap: int, *, last: bool = False
) -> list[str]:
    """Return the lines of a row of cells that have several lines each; they end together if ``last``."""
    height = max(map(len, cells), default=0)
    lines = []
    for line in range(height):
        parts = []
        for cell, width, is_text in zip(cells, widths, text, strict=True):
            index = line - (height - len(cell)) * last
            part = cell[index] if 0 <= index < len(cell) else ""
            parts.append(part.ljust(width) if is_text else part.rjust(width))
        lines.append((" " * gap).join(parts).rstrip())
    return lines


def _html(value: Any, column: Column = Column("")) -> str:
    if isinstance(value, Mark):
        look = f"color:{value.colour};text-shadow:0 0 1px #999"  # black has an edge on a dark page, too
        return f'<span style="{look}">{value.shape}</span> {_escape(value.word)}'
    return _escape(column.text(value))


def _html_row(tag: str, cells: Iterable[str], sides: Sequence[str]) -> str:
    look = "padding:2px 12px 2px 0;vertical-align:" + (
        "bottom;border-bottom:1px solid #999" if tag == "th" else "top"
    )
    numbers = ";white-space:nowrap" if tag == "td" else ""
    content = "".join(
        f'<{tag} style="text-align:{side};{look}{numbers if side == "right" else ""}">{cell}</{tag}>'
        for cell, side in zip(cells, sides, strict=True)
    )
    return f"<tr>{content}</tr>"


def _escape(text: str) -> str:
    return html.escape(text, quote=False)
