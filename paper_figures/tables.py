"""Tables, for people (Markdown) and for papers (LaTeX)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame, Series

from paper_figures import anchor_count
from tensionlab.plots.workspace import read_field, share_above
from tensionlab.validation.data_tables import Recording
from tensionlab.validation.statistics import score
from tensionlab.workspace.shares import describe_step

LATEX = (("%", r"\%"), ("°", r"$^\circ$"), ("–", "--"), ("“", "``"), ("”", "''"))
TAILS = (0.1, 0.5, 0.9)
FORCES = (0.5, 1.0, 1.5, 2.0, 3.0)  # in N
LINES = (
    ("mean angle error (°)", "angle_mean", "angle", 1),
    ("mean size of the measured force (N)", "magnitude_mean", "magnitude", 2),
    ("“magnitude error”, read as the length of the error vector (N)", "magnitude_error_mean", "vector", 2),
    ("“magnitude error”, read as the difference of sizes (N)", "magnitude_error_mean", "magnitude_error", 2),
)  # name here, in the publication and among the statistics, and number of decimals


@dataclass(frozen=True)
class Table:
    """Cells by row, their headings, and a note below."""

    note: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def write_table(table: Table, path: Path) -> None:
    """Write a table as LaTeX (booktabs) or Markdown, by the suffix."""
    text = _latex(table) if path.suffix == ".tex" else _markdown(table)
    path.write_text(text, encoding="utf-8", newline="\n")


def published_and_simulated(published: DataFrame, recording: Recording, rigs: DataFrame) -> Table:
    """Return the table of what the publication measured, beside one simulated rig and many."""
    if not recording.simulated:
        raise ValueError("the table is of simulated rigs; the recording is real")
    one = score(recording.desired, recording.measured)
    rows = [
        (
            name,
            f"{published['value'][key]:.{digits}f}",
            _interval(one.loc[part], digits),
            _quantiles(rigs[part], digits),
        )
        for name, key, part, digits in LINES
    ]
    all_within = 100.0 * np.mean(rigs["within"] == 1.0)
    within = one["mean"]["within"]
    one_within = "yes" if within == 100.0 else f"no, {within:.1f} %"
    rows.insert(1, ("every force within 45°", "yes", one_within, f"{all_within:.1f} % of the rigs"))
    seed, count = recording.manifest["seed"], len(recording.desired)
    note = (
        f"Simulated rigs have errors drawn from the preset paper-like. One rig: seed {seed}, with 95 % bootstrap "
        f"intervals over its {count} forces. {len(rigs)} rigs: median, 10 to 90 %. "
        f"Published: {published.attrs['source']}."
    )
    return Table(note, ("", "published", "one simulated rig", f"{len(rigs)} simulated rigs"), tuple(rows))


def shares_of_room(room: Any) -> Table:
    """Return the share of the room in which so many modules render a force in every direction."""
    rows = []
    field = read_field(room, anchor_count.METRIC)
    for number, name in enumerate(field.names):
        rows.append((name, *(f"{100 * share:.1f} %" for share in share_above(field, number, FORCES))))
    step = describe_step(field.axes.values())
    note = f"Share of the room where so much force (N) can be rendered in every direction, from positions {step}."
    return Table(note, ("modules", *(f"{force:.1f} N" for force in FORCES)), tuple(rows))


def _interval(found: Series, digits: int) -> str:
    return f"{found['mean']:.{digits}f} ({found['mean_lower']:.{digits}f} to {found['mean_upper']:.{digits}f})"


def _quantiles(values: Any, digits: int) -> str:
    low, middle, high = np.quantile(values, TAILS)
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _markdown(table: Table) -> str:
    ruler = ("---", *("---:" for _ in table.headings[1:]))
    lines = ["| " + " | ".join(row) + " |" for row in (table.headings, ruler, *table.rows)]
    return "\n".join([*lines, "", table.note, ""])


def _latex(table: Table) -> str:
    columns = "l" + "r" * (len(table.headings) - 1)
    head, *body = (" & ".join(row) + r" \\" for row in (table.headings, *table.rows))
    lines = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", head, r"\midrule", *body, r"\bottomrule"]
    text = "\n".join([*lines, r"\end{tabular}", ""])
    for plain, word in LATEX:
        text = text.replace(plain, word)
    return f"% {table.note}\n{text}"
