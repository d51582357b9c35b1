"""Table of which solver serves which need, with what the committed benchmark measured of each."""

from __future__ import annotations

from tensionlab.benchmark.results import Results
from tensionlab.solvers import make
from tensionlab.support.formatting import format_duration, format_share
from tensionlab.support.table import Column, Table

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
    "sgm_s": Column("typical call", format=format_duration),
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
    processor = found.manifest["processor"]
    about = (
        "*Renders*: the share of feasible problems rendered to 1e-6 N; problems that a solver refuses (for "
        "`polygon` those with more than two redundant cables) count as missed. *Best if infeasible*: the share of "
        "problems, in sets with infeasible wrenches, whose error is the least possible to 1e-6 N. "
        f"Times are of one call with verification, on one thread of {processor}."
    )
    return f"{Table(columns, rows).to_markdown()}\n\n{about}"
