"""``tensionlab new``: files to start from, with a comment for each key."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.model.module import require_name
from tensionlab.support.files import writing

FOLDER = Path(__file__).parent / "templates"
KINDS = ("rig", "space", "scenario", "program")


def new(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="|".join(KINDS), help="What to start.", autocompletion=options.complete(lambda: KINDS)
        ),
    ],
    out: Annotated[Path | None, options.writes("Write the file here, not to stdout.", ".toml")] = None,
) -> None:
    """Write a rig, a space, a scenario or a program to start from.

    The file has a comment for each key, and can be used as it is: its first lines say how.
    """
    if kind not in KINDS:
        raise typer.BadParameter(f"{kind!r} is none of {', '.join(KINDS)}")
    text = (FOLDER / f"{kind}.toml").read_text(encoding="utf-8")
    if out is None:
        typer.echo(text, nl=False)
        return
    require_name(out.stem, str(out), "name", "give the file a name")
    writing.require_new(out, f"the {kind}")
    writing.write_text(out, text.replace(f"my-{kind}.toml", str(out)).replace(f"my-{kind}", out.stem))
    output.print_line(f"{kind}: {out}; its first lines say how to use it")
