"""A table of solvers and how they did, a row each: what `compare` and `log replay` print."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from tensionlab.cli.common import output

if TYPE_CHECKING:
    from tensionlab.comparison.scores import Score

RowType = TypeVar("RowType", bound="Score")
Column = tuple[str, Callable[[RowType], str], bool]
"""Heading, how to write it, and whether a narrow terminal shows it too."""

STATUSES: list[Column[Score]] = [
    ("solver", lambda row: row.solver, True),
    ("nearest", lambda row: row.nearest or "–", True),
    ("exact", lambda row: str(row.exact), True),
    ("near", lambda row: str(row.nearest_count), True),
    ("limit", lambda row: str(row.iteration_limit), True),
    ("fail", lambda row: str(row.failed), False),
]
"""The columns that each such table begins with."""


def print_scores(
    title: str,
    rows: Sequence[RowType],
    columns: Sequence[Column[RowType]],
    missing: Mapping[str, str],
    legend: str,
    *,
    first_apart: bool = False,
) -> None:
    """Print the table, what its words mean, and which solvers are left out, and why.

    Parameters
    ----------
    title, legend : str
    rows : sequence of Score
    columns : sequence of Column
        Those that follow `STATUSES`.
    missing : mapping of str to str
        Reasons by the names of solvers.
    first_apart : bool
        Whether to draw a line below the first row.
    """
    console = output.console()
    narrow = console.width < output.WIDTH
    shown = [column for column in (*STATUSES, *columns) if column[2] or not narrow]
    grid = output.table(title, gap=1)
    for index, (heading, _, _) in enumerate(shown):
        grid.add_column(heading, justify="left" if index < 2 else "right", no_wrap=True)
    for index, row in enumerate(rows):
        grid.add_row(*(write(row) for _, write, _ in shown), end_section=first_apart and index == 0)
    for name in missing:
        grid.add_row(name, "left out", style="dim")
    console.print(grid)
    console.print()
    console.print(legend, style="dim")
    for name, reason in missing.items():
        console.print(f"left out: {name}, {reason}", style="dim", soft_wrap=True)
    if narrow:
        console.print(f"A terminal of {output.WIDTH} columns shows more of them; --json has all.", style="dim")
