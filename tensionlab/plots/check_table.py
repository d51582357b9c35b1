"""What was expected, and what was measured: a table with a mark and a gauge for each line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from tensionlab.plots.style import GREEN, GREY, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARK, NAME, LOW, HIGH, MEASURED, UNIT = 0.0, 0.025, 0.52, 0.59, 0.66, 0.67
"""Where the columns are, as shares of the width: marks, names and units begin there, numbers end."""
GAUGE = (0.77, 1.0)
"""Where gauges are; what is expected takes the middle half."""


class Judged(Protocol):
    """A number that was to be between two others, and was, or was not."""

    @property
    def name(self) -> str:
        """What it is."""

    @property
    def unit(self) -> str:
        """In what."""

    @property
    def low(self) -> float:
        """At least so much."""

    @property
    def high(self) -> float:
        """At most so much."""

    @property
    def measured(self) -> float:
        """So much it was."""


def draw_verdicts(axes: Axes, rows: Sequence[Judged]) -> None:
    """Write a line for each number, below their headings."""
    axes.axis("off")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(len(rows) + 0.5, -0.5)
    met = [row.low <= row.measured <= row.high for row in rows]
    for x, heading in ((LOW, "from"), (HIGH, "to"), (MEASURED, "felt")):
        axes.text(x, 0.0, heading, ha="right", va="center", color=GREY)
    axes.text(MARK, 0.0, "What it was to feel like", va="center", fontweight="bold")
    said = "all as expected" if all(met) else f"{met.count(False)} of {len(met)} not as expected"
    axes.text(GAUGE[0], 0.0, said, va="center", fontweight="bold", color=GREEN if all(met) else RED)
    for number, (row, good) in enumerate(zip(rows, met, strict=True), start=1):
        colour, mark = (GREEN, "\N{CHECK MARK}") if good else (RED, "\N{BALLOT X}")
        axes.axhline(number - 0.5, color="#E4E4E4", linewidth=0.7)
        axes.text(MARK, number, mark, color=colour, va="center", fontsize=11)
        axes.text(NAME, number, row.name, va="center")
        for x, value in ((LOW, row.low), (HIGH, row.high)):
            axes.text(x, number, _word(value), ha="right", va="center")
        axes.text(MEASURED, number, _word(row.measured), ha="right", va="center", fontweight="bold", color=colour)
        axes.text(UNIT, number, row.unit.removeprefix("1"), va="center", color=GREY)
        _draw_gauge(axes, number, row, colour)


def _word(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "\N{EN DASH}"


def _draw_gauge(axes: Axes, number: int, row: Judged, colour: str) -> None:
    """Draw where a number is between its bounds, or how far beyond."""
    begin, end = GAUGE
    quarter = (end - begin) / 4
    axes.plot(GAUGE, [number, number], color="#ECECEC", linewidth=9.0, solid_capstyle="butt")
    axes.plot(
        [begin + quarter, end - quarter], [number, number], color="#BFDDD2", linewidth=9.0, solid_capstyle="butt"
    )
    if row.high > row.low and math.isfinite(row.high - row.low) and math.isfinite(row.measured):
        share = (row.measured - row.low) / (row.high - row.low)
        place = begin + quarter * min(max(1.0 + 2.0 * share, 0.0), 4.0)
        axes.plot([place], [number], marker="o", markersize=6.5, color=colour)
