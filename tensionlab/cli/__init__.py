"""The command ``tensionlab``: one verb per job.

Exit status 0: done. 1: the answer is no, or something went wrong with a module. 2: bad input, or a file or stdout
that cannot be written, with one line on stderr that says what to do. 130: ended by Ctrl-C; verbs that are meant to
be ended so (``run``, ``serve``, ``simulate``, ``module monitor``, ``module ping``) and stop in good order have 0.
Everything slow to import is imported by the verb that needs it, so that ``--help`` stays quick.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from tensionlab import __version__
from tensionlab.cli import ending
from tensionlab.cli.allocate import allocate
from tensionlab.cli.bench import bench
from tensionlab.cli.compare import compare
from tensionlab.cli.estop import estop
from tensionlab.cli.layout import layout
from tensionlab.cli.log import log
from tensionlab.cli.module import module
from tensionlab.cli.problems import problems
from tensionlab.cli.rig import rig
from tensionlab.cli.run import run
from tensionlab.cli.scenario import scenario
from tensionlab.cli.serve import serve
from tensionlab.cli.simulate import simulate
from tensionlab.cli.solvers import solvers
from tensionlab.cli.validate import validate
from tensionlab.cli.workspace import workspace

NUMBER_OPTIONS = ("--at", "--force", "--orbit", "--wrench", "--reference", "--box", "--step")
NUMBERS = re.compile(r"[-+]?\.?\d[\d.eE+,-]*,?|[-+]?(nan|inf),?", re.IGNORECASE)

app = typer.Typer(
    help="Tension allocation for modular cable systems: every solver, one interface, answers proved.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help, 0.2 s sooner
)
app.command()(compare)
app.command()(allocate)
app.command()(solvers)
app.command()(workspace)
app.command()(bench)
app.command()(run)
app.command()(scenario)
app.command()(serve)
app.command()(simulate)
app.command()(validate)
app.command()(estop)
app.add_typer(module, name="module")
app.add_typer(rig, name="rig")
app.add_typer(layout, name="layout")
app.add_typer(log, name="log")
app.add_typer(problems, name="problems")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tensionlab {__version__}")
        raise typer.Exit()


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and stop.")
    ] = False,
) -> None:
    """Options that come before the verb."""


def join_numbers(words: Sequence[str]) -> list[str]:
    """Which words to parse, with the numbers after ``--at`` and the like joined to one word.

    ``--at 0 -0.1 0.3`` becomes ``--at 0,-0.1,0.3``: the parser knows neither how many components a rig has
    nor that ``-0.1`` is a number and not an option.
    """
    joined: list[str] = []
    start: int | None = None
    for word in words:
        name, equals, _ = word.partition("=")
        if name in NUMBER_OPTIONS:
            joined.append(word)
            start = len(joined) - bool(equals)
        elif start is not None and NUMBERS.fullmatch(word):
            joined[start:] = [",".join([*joined[start:], word])]
        else:
            joined.append(word)
            start = None
    return joined


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; leaves through `SystemExit`, as a program does."""
    words = sys.argv[1:] if arguments is None else arguments
    raise SystemExit(ending.run(_invoke, join_numbers(words)))


def _invoke(words: Sequence[str]) -> None:
    """Carry out the verb; errors are let through, which the parser's own way of running it would not do."""
    with typer.main.get_command(app).make_context("tensionlab", list(words)) as context:
        context.command.invoke(context)
