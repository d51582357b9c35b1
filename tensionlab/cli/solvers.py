"""``tensionlab solvers``: which ways to choose there are."""

from __future__ import annotations

import inspect
import re
from typing import Annotated, Any

import typer

from tensionlab.cli.common import output

# How the docstrings of solvers name their publications: "Source: ...", or a section "References".
SOURCE = re.compile(r"(?:Sources?:\s|References\n-+\n)(.+?)(?:\n\s*\n|\Z)", re.DOTALL)


def solvers(
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """List the solvers: what each minimises, which policies it honours, where it was published."""
    from tensionlab.solvers import SOLVERS, make, plugins
    from tensionlab.solvers.selection import every_solver

    broken = {name: str(found) for name, found in plugins.find_all(SOLVERS).items() if not isinstance(found, type)}
    entries: list[dict[str, Any]] = []
    for name, installed in every_solver().items():
        if name in broken:
            continue
        solver = make(name)
        found = SOURCE.search(inspect.getdoc(type(solver)) or "")
        entries.append(
            {
                "solver": name,
                "nearest": list(solver.policies),
                "objective": solver.objective,
                "source": " ".join(found[1].split()) if found else "",
                "installed": installed,
            }
        )
    if json:
        output.print_json({"solvers": entries, "broken": broken})
        return
    grid = output.table()
    for heading in ("solver", "installed", "nearest", "minimises, among tensions that render the wrench"):
        grid.add_column(heading, no_wrap=heading == "solver")
    for entry in entries:
        grid.add_row(
            entry["solver"],
            "yes" if entry["installed"] else "no",
            ", ".join(entry["nearest"]) or "–",
            entry["objective"],
        )
    from rich.text import Text

    console = output.console()
    console.print(grid)
    console.print()
    families: dict[str, str] = {}
    for entry in entries:
        families.setdefault(entry["solver"].partition(":")[0], entry["source"])
    for family, source in families.items():
        if source:
            console.print(Text.assemble((family, "bold"), f": {source}"))
    console.print('\nA missing one: pip install "tensionlab[solvers]" brings every QP backend.', style="dim")
    for fault in broken.values():
        console.print(f"Left out: {fault}", style="red", soft_wrap=True)
