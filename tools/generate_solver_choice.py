"""Table of which solver serves which need, with what the committed benchmark measured of each."""

from __future__ import annotations

from tensionlab.benchmark.results import Results
from tensionlab.solvers import make
from tensionlab.support.formatting import format_duration, format_share
from tensionlab.support.table import Column, Table
from tools.generate_benchmark_table import age

# Needs of a user, and the solver for each.
CHOICES = (
    ("the least tension, with proofs, and never slow", "newton"),
    ("the algorithm of the publication", "dykstra"),
    ("tensions away from all limits, smooth", "analytic-centre"),
    ("the largest margin to all limits", "safe"),
    ("the centroid, for redundancy up to two", "polygon:centroid"),
    ("the smallest maximum tension", "minimax"),
    ("the least sum of tensions", "least-sum"),
    ("a fixed number of steps, no search", "closed-form"),
    ("rounded kinks, a gradual edge", "slack"),
    ("a small error for less tension", "spidar"),
)
COLUMNS = {
    "solved_1e6": Column("renders", format=format_share),
    "elsewhere": Column("best if infeasible", format=format_share),
    "batch_s": Column("in a batch", format=format_duration),
    "sgm_s": Column("one call", format=format_duration),
    "p999_s": Column("99.9 % within", format=format_duration),
}


def choice(found: Results) -> str:
    """Return the table in Markdown."""
    summary = found.summary().set_index("label")
    rows = []
    for need, solver in CHOICES:
        policies = ", ".join(make(solver).policies) or "no promise"
        rows.append([need, f"`{solver}`", policies, *summary.loc[solver, [*COLUMNS]]])
    columns = ["you want", "solver", "infeasible wrenches", *COLUMNS.values()]
    about = found.manifest
    notes = (
        "*Renders*: the share of feasible problems rendered to 1e-6 N; problems that a solver refuses (for "
        "`polygon` those with more than two redundant cables) count as missed. *Best if infeasible*: the share of "
        "problems, in sets with infeasible wrenches, whose error is the least possible to 1e-6 N. "
        f"Times are with verification, on one thread of {about['processor']}, {about['date'][:10]}{age(about)}"
    )
    return f"{Table(columns, rows).to_markdown()}\n\n{notes}"
