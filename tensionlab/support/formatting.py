"""Numbers as text: short numbers, durations, shares, vectors, counts and ranges; and lines of a width."""

from __future__ import annotations

import math
import re
import textwrap
from typing import Any

from tensionlab.errors import MAX_MESSAGE_CHARACTERS

MAX_COMPONENTS = 8  # components of a vector; of more, those in the middle are left out


def format_number(value: float) -> str:
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


def format_duration(seconds: float) -> str:
    """Return a time with at most three digits and the unit that suits it; a dash for NaN."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.9995 * size:
            value = seconds / size
            return f"{value:.0f} {unit}" if value >= 99.5 else f"{value:.2g} {unit}"
    return "–" if math.isnan(seconds) else f"{round(seconds / 1e-9)} ns"  # round: no minus zero


def format_share(share: float) -> str:
    """Write a share, with 100 % only for all and 0 % only for nothing."""
    if math.isnan(share):
        return "–"
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    return f"{min(99.9, max(0.1, 100 * share)):.1f} %"


def format_vector(values: Any) -> str:
    """Return components in brackets, without trailing zeros or rounding errors; a long one without its middle."""
    known = [float(value) for value in values]
    small = 1e-12 * max(map(abs, known), default=0.0)
    words = [f"{0.0 if abs(value) <= small else value:.4g}" for value in known]
    if len(words) > MAX_COMPONENTS:
        words[MAX_COMPONENTS // 2 : -2] = ["…"]
    return f"({', '.join(words)})"


def format_count(number: int, word: str) -> str:
    """Return a number with the word for what is counted, such as "1 cable" or "12,000 cables"."""
    return f"{number:,} {word}{'s' * (number != 1)}"


def format_range(*arrays: Any) -> str:
    """Return the range of all finite numbers, such as "0.5" or "0.5 to 6"; a dash if there is none."""
    import numpy as np  # a stop formats no range

    known = np.concatenate([np.ravel(values) for values in arrays])
    known = known[np.isfinite(known)]
    ends = dict.fromkeys(f"{end:.4g}" for end in (known.min(), known.max())) if known.size else ["–"]
    return " to ".join(ends)


def keep_together(text: str) -> str:
    """Return a text with no-break spaces between numbers and units, and in vectors."""
    text = re.sub(r"(?<=\d) (?=\S)|(?<=\bN) (?=s/m\b)", "\N{NO-BREAK SPACE}", text)
    return re.sub(
        r"\([-\d][^a-z()]*\)( (?=\S))?", lambda vector: vector[0].replace(" ", "\N{NO-BREAK SPACE}"), text
    )


def words_of(text: str) -> list[str]:
    """Return what lines may break between: words, numbers with their units, and vectors."""
    return keep_together(text).replace("\n", " ").split(" ")


def wrap(text: str, width: int) -> list[str]:
    """Return a text in lines of a width, broken between words; each number is on one line with its unit."""
    paragraphs = keep_together(text).split("\n")
    lines = [line for paragraph in paragraphs for line in textwrap.wrap(paragraph, width, break_on_hyphens=False)]
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines] or [""]


def one_line(text: str, length: int = MAX_MESSAGE_CHARACTERS) -> str:
    """Return a text as one line without control characters; the middle of a longer one is left out."""
    lines = "; ".join(" ".join(part.split()) for part in text.splitlines() if part.strip()).replace(":; ", ": ")
    line = "".join(character if character.isprintable() else repr(character)[1:-1] for character in lines)
    if len(line) <= length:
        return line
    end = length // 3
    return f"{line[: length - end - 5]} ... {line[-end:]}"
