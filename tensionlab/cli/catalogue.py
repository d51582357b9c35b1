"""``tensionlab solvers``, ``datasets`` and ``new``: what is known by name, and files to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tensionlab import datasets as stored
from tensionlab.benchmark.problem_sets import problem_set
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json
from tensionlab.errors import DataError
from tensionlab.model.module import require_name
from tensionlab.solvers import every_solver, find_plugins, make
from tensionlab.support.files import writing
from tensionlab.support.files.named import SUFFIXES
from tensionlab.support.files.reading import read_toml
from tensionlab.support.table import Table

TITLES = {
    "vectors": "directions of the published validation",
    "recordings": "desired, rendered and measured forces of a validation",
    "what-if": "validations of many simulated rigs",
    "benchmarks": "results of the benchmark of solvers",
    "tracks": "problems of the benchmark's leaderboard",
}  # what the files of numbers of each kind are; other files have a description
HINT = """\
Verbs that take a rig or a space take its name: tensionlab compare ipanema-2. A path ends in .toml or has a "/".
In Python: tl.load_rig("ipanema-2"), tl.datasets.load("vectors/grid18")."""
TEMPLATES = Path(__file__).parent / "templates"
TEMPLATE_KINDS = ("rig", "space", "scenario", "program")


def solvers(json: Json = False) -> None:
    """List the solvers, with what each minimises, and its policies.

    A policy says which tensions replace those of an infeasible wrench.
    """
    broken = {name: str(plugin) for name, plugin in find_plugins().items() if not isinstance(plugin, type)}
    entries: list[dict[str, Any]] = []
    for name, installed in every_solver().items():
        if name not in broken:
            solver = make(name)
            about = {"policy": list(solver.policies), "objective": solver.objective}
            entries.append({"solver": name, "installed": installed, **about})
    if json:
        output.print_json(solvers=entries, broken=broken)
        return
    legend = {
        "policies": "in what the substitute of an infeasible wrench may be nearest",
        "minimises": "among the tensions that render the wrench",
    }
    rows = [
        [entry["solver"], entry["installed"], ", ".join(entry["policy"]) or None, entry["objective"]]
        for entry in entries
    ]
    notes = ['To install all of them: pip install "tensionlab[solvers,reference]"']
    notes += [f"Left out: {problem}" for problem in broken.values()]
    output.print_table(Table(["solver", "installed", "policies", "minimises"], rows, notes=notes, legend=legend))


def datasets(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND",
            help=f"Only this kind: {', '.join(stored.KINDS)}.",
            autocompletion=options.complete(lambda: stored.KINDS),
        ),
    ] = None,
    json: Json = False,
) -> None:
    """List the rigs and other data sets that are known by name."""
    rows = [(*(parts := name.split("/")), _title(*parts)) for name in stored.names(kind)]
    if json:
        output.print_json(datasets=[dict(zip(("kind", "name", "title"), row, strict=True)) for row in rows])
    else:
        shown = [
            ("" if index and row[0] == rows[index - 1][0] else row[0], *row[1:]) for index, row in enumerate(rows)
        ]
        output.print_table(Table(["kind", "name", "description"], shown, notes=[HINT]))


def _title(kind: str, name: str) -> str:
    if kind == stored.PROBLEMS:
        return problem_set(name, 1).title
    if kind in TITLES:
        return TITLES[kind]
    content = read_toml(stored.folder() / kind / f"{name}{SUFFIXES[kind]}", "a data set", DataError)
    return str(content.get("description") or content["source"])


def new(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="|".join(TEMPLATE_KINDS),
            help="What to start.",
            autocompletion=options.complete(lambda: TEMPLATE_KINDS),
        ),
    ],
    out: Annotated[Path | None, options.writes("Write the file here, not to stdout.", ".toml")] = None,
) -> None:
    """Write a rig, a space, a scenario or a program to start from.

    The file has a comment for each key, and can be used as it is: its first lines say how.
    """
    if kind not in TEMPLATE_KINDS:
        raise typer.BadParameter(f"{kind!r} is none of {', '.join(TEMPLATE_KINDS)}")
    text = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    if out is None:
        typer.echo(text, nl=False)
        return
    require_name(out.stem, str(out), "name", "give the file a name")
    writing.require_new(out, f"the {kind}")
    writing.write_text(out, text.replace(f"my-{kind}.toml", str(out)).replace(f"my-{kind}", out.stem))
    output.print_line(f"{kind}: {out}; its first lines say how to use it")
