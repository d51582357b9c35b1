"""Table of which solver serves which need, with what the committed benchmark measured of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from tensionlab.benchmark.report import table
from tensionlab.benchmark.results import Results, summaries
from tensionlab.solvers import make
from tensionlab.support.formatting import format_duration, format_share


class Choice(NamedTuple):
    """What somebody wants of the tensions, and the solver for it."""

    need: str
    solver: str


CHOICES = (
    Choice("the least tension, proofs, no slow cases", "newton"),
    Choice("the algorithm of the publication", "dykstra"),
    Choice("clear of all limits, and smooth", "analytic-centre"),
    Choice("the largest margin to all limits", "safe"),
    Choice("the centroid, for redundancy up to two", "polygon:centroid"),
    Choice("the least largest tension", "minimax"),
    Choice("the least sum of tensions", "least-sum"),
    Choice("a fixed number of steps, no search", "closed-form"),
    Choice("rounded kinks, a soft edge", "slack"),
    Choice("a little error for less tension", "spidar"),
)
COLUMNS: dict[str, Callable[[Any], str]] = {
    "renders": lambda line: format_share(line.solved_1e6),
    "best if infeasible": lambda line: format_share(line.elsewhere),
    "typical call": lambda line: format_duration(line.sgm_s),
    "99.9 % within": lambda line: format_duration(line.p999_s),
}


def choice(found: Results) -> str:
    """Return the table in Markdown."""
    by_label = {line.label: line for line in summaries(found)}
    rows = []
    for need, solver in CHOICES:
        policies = ", ".join(make(solver).policies) or "no promise"
        rows.append([need, f"`{solver}`", policies, *(cell(by_label[solver]) for cell in COLUMNS.values())])
    heads = ["you want", "solver", "infeasible wrenches", *COLUMNS]
    processor = found.manifest["processor"]
    about = (
        "*Renders*: the share of feasible problems rendered to 1e-6 N; what a solver refuses (for "
        "`polygon` more than two redundant cables) counts as missed. *Best if infeasible*: the share of "
        "problems, in sets with infeasible wrenches, whose error is the least possible one to 1e-6 N. "
        f"Times are of one call, verification included, on one thread of {processor}."
    )
    return f"{table(heads, rows, left=3)}\n\n{about}"
