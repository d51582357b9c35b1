"""Numbers as words, and tables in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence


def percent(share: float) -> str:
    """A share that reads 100 % only if it is all, and 0 % only if it is nothing."""
    if math.isnan(share):
        return "–"
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    return f"{min(99.9, max(0.1, 100 * share)):.1f} %"


def newton(value: float) -> str:
    """A force in N with two digits, small ones as powers of ten."""
    if math.isnan(value):
        return "–"
    if value == 0:
        return "0"
    if 0.01 <= abs(value) < 1e4:
        return f"{value:.2g}" if abs(value) < 10 else f"{value:.0f}"
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def duration(seconds: float) -> str:
    """A time with three digits at most, and the unit that suits it."""
    if math.isnan(seconds):
        return "–"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.9995 * size:
            value = seconds / size
            return f"{value:.0f} {unit}" if value >= 99.5 else f"{value:.2g} {unit}"
    return f"{seconds / 1e-9:.0f} ns"


def times(ratio: float) -> str:
    """How many times as much."""
    return "–" if math.isnan(ratio) else f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


def count(number: int) -> str:
    """A number of things, with thin groups of thousands; a dash for none told."""
    return f"{number:,}"


def listed(names: Sequence[str]) -> str:
    """Names with commas, and an "and" before the last one."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Make a table in Markdown; the first ``left`` columns to the left, the others to the right."""
    rules = [":--" if column < left else "--:" for column in range(len(headings))]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (headings, rules, *rows))
