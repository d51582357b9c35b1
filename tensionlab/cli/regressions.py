"""``tensionlab regressions``: what became slower or less accurate from one benchmark to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensionlab.benchmark import regressions as room
from tensionlab.benchmark.results import read
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json
from tensionlab.support.files.writing import write_text


def regressions(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="Folder of an earlier `tensionlab bench`.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="Folder of a later one, of the same problems.")],
    out: Annotated[Path | None, options.writes("Write the report to this file.", ".md")] = None,
    json: Json = False,
) -> None:
    """Tell which solvers became slower or less accurate from one benchmark to another.

    Only what is beyond noise counts: a change of time beyond 10 %, its 99 % interval and what else changed on the
    machine; problems that were solved and are missed by far. Exit status 1 if there is any.
    """
    found = room.find_regressions(read(old), read(new))
    with output.ResultWriter(quiet=json) as writer:
        if out:
            writer.write("report", out, lambda path: write_text(path, found.report()))
        if json:
            output.print_json(
                regressed=bool(len(found.worse)),
                drift=found.drift,
                changes=found.changes.to_dict("records"),
                manifest=output.manifest(),
            )
        else:
            output.print_table(found.table(found.changes[found.changes["verdict"] != ""]))
    raise typer.Exit(1 if len(found.worse) else 0)
