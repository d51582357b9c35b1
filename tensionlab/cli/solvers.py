"""``tensionlab solvers``: the solvers, and what each minimises."""

from __future__ import annotations

import inspect
import re
from typing import Any

from tensionlab.cli.common import output
from tensionlab.cli.common.verbs import Json
from tensionlab.solvers import every_solver, find_plugins, make
from tensionlab.support.table import Table

# How the docstrings of solvers name their publications: "Source: ...", or a section "References".
SOURCE = re.compile(r"(?:Sources?:\s|References\n-+\n)(.+?)(?:\n\s*\n|\Z)", re.DOTALL)


def solvers(json: Json = False) -> None:
    """List the solvers, with what each minimises, its policies, and its source.

    A policy says which tensions replace those of an infeasible wrench.
    """
    broken = {name: str(found) for name, found in find_plugins().items() if not isinstance(found, type)}
    entries: list[dict[str, Any]] = []
    for name, installed in every_solver().items():
        if name not in broken:
            solver = make(name)
            found = SOURCE.search(inspect.getdoc(type(solver)) or "")
            source = " ".join(found[1].split()) if found else ""
            entries.append(
                {"solver": name, "policy": list(solver.policies), "objective": solver.objective,
                 "source": source, "installed": installed}
            )  # fmt: skip
    if json:
        output.print_json(solvers=entries, broken=broken)
        return
    from rich.text import Text

    columns = [
        "solver",
        "installed",
        "if infeasible, nearest in",
        "minimises, among tensions that render the wrench",
    ]
    rows = (
        (entry["solver"], entry["installed"], ", ".join(entry["policy"]) or None, entry["objective"])
        for entry in entries
    )
    output.print_table(Table(columns, rows))
    console = output.console()
    console.print()
    sources: dict[str, str] = {}
    for entry in entries:
        sources.setdefault(entry["solver"].partition(":")[0], entry["source"])
    for family, source in sources.items():
        if source:
            console.print(Text.assemble((family, "bold"), f": {source}"))
    output.print_prose('\nTo install all of them: pip install "tensionlab[solvers,reference]"', "dim")
    for fault in broken.values():
        output.print_line(f"Left out: {fault}", "red")
