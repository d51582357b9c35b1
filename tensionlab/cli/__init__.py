"""The command ``tensionlab``: its verbs, and how a command ends.

Exit status 0: done. 1: the answer is no, or something went wrong with a module. 2: bad input, or a file or stdout
that cannot be written, with one line on stderr that says what to do. 130: ended by Ctrl-C; verbs that are meant to
be ended so (``run``, ``serve``, ``simulate``, ``module monitor``, ``module ping``) and stop in good order have 0.
141: whoever reads stdout has gone. Everything slow to import is imported by the verb that needs it, so that
``--help`` stays quick.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab import __version__
from tensionlab.cli.allocate import allocate
from tensionlab.cli.bench import bench, problems
from tensionlab.cli.common.output import INTERRUPTED, clip, print_error
from tensionlab.cli.compare import compare
from tensionlab.cli.layout import layout
from tensionlab.cli.log import log
from tensionlab.cli.module import estop_all, module
from tensionlab.cli.rig import rig
from tensionlab.cli.run import run
from tensionlab.cli.scenario import scenario
from tensionlab.cli.serve import serve
from tensionlab.cli.simulate import simulate
from tensionlab.cli.solvers import solvers
from tensionlab.cli.validate import validate
from tensionlab.cli.workspace import workspace
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, TensionlabError

if TYPE_CHECKING:
    from typing import TextIO

BAD_INPUT = 2
"""Exit status where input is bad, or a file or stdout cannot be written."""
STDOUT_CLOSED = 141
"""Exit status where whoever reads stdout has gone: 128 + SIGPIPE."""
NUMBER_OPTIONS = ("--at", "--force", "--orbit", "--wrench", "--reference", "--box", "--step")
NUMBERS = re.compile(r"[-+]?\.?\d[\d.eE+,-]*,?|[-+]?(nan|inf),?", re.IGNORECASE)
PARSER_WORDS = {
    r"Value error, ": "",
    r"Input should be a valid integer.*": "give a whole number",
    r"Input should be a valid number.*": "give a number",
    r"Input should be ": "it must be ",
}
"""What the parser's messages say, and what they say here."""
PRINTERS = {"click", "typer", "rich"}
"""Packages that write to stdout. All else that writes names its file."""
ClickException: type[Any] = typer.BadParameter.__mro__[2]  # later versions of typer bring a click of their own

app = typer.Typer(
    help="Tension allocation for modular cable systems: every solver behind one interface, each answer verified.",
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
app.command("estop")(estop_all)
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
    """Take the options that come before the verb."""


def join_numbers(words: Sequence[str]) -> list[str]:
    """Join the numbers after ``--at`` and the like to one word, and return all words.

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
    """Run the command line, and leave through `SystemExit`; what goes wrong is one line on stderr.

    Errors that are a defect of this program, such as a `TypeError`, are let through with their traceback.
    """
    words = sys.argv[1:] if arguments is None else arguments
    _open_streams()
    status = _status(join_numbers(words))
    try:
        sys.stdout.flush()
    except OSError as error:
        status = _without_stdout(error)
    raise SystemExit(status)


@cache
def _parser() -> Any:
    """Return the parser of all verbs, which takes 0.1 s to make."""
    return typer.main.get_command(app)


def _invoke(words: Sequence[str]) -> None:
    """Carry out the verb; errors are let through, which the parser's own way of running it would not do."""
    with _parser().make_context("tensionlab", list(words)) as context:
        context.command.invoke(context)


def _status(words: Sequence[str]) -> int:
    """Carry out the verb, print what goes wrong, and return the exit status."""
    try:
        _invoke(words)
        return 0
    except typer.Exit as leaving:
        return leaving.exit_code
    except KeyboardInterrupt:
        print_error("interrupted")
        return INTERRUPTED
    except typer.Abort:
        print_error("stdin ended before it was answered; run this in a terminal")
        return BAD_INPUT
    except ClickException as error:
        for theirs, ours in PARSER_WORDS.items():
            error.message = re.sub(theirs, ours, error.message)
        if len(error.message) > MAX_MESSAGE_CHARACTERS and type(error).__name__ != "NoArgsIsHelpError":
            error.message = clip(error.message)
        with suppress(OSError):
            error.show()
        return int(error.exit_code)
    except TensionlabError as error:
        print_error(str(error))
    except OSError as error:
        return _system_refused(error)
    except MemoryError:
        print_error("out of memory; try fewer modules, poses or forces at once")
    except RecursionError as error:
        print_error(f"nested too deeply ({_where(error)}); give input that is less nested")
    except ValueError as error:
        print_error(f"{error} ({_where(error)})")
    return BAD_INPUT


def _system_refused(error: OSError) -> int:
    """Print what the system refused; it may be that nobody reads stdout."""
    innermost = traceback.extract_tb(error.__traceback__)[-1].filename
    if error.filename is None and PRINTERS & set(Path(innermost).parts):
        return _without_stdout(error)
    place = "" if error.filename is None else f"{error.filename}: "
    print_error(f"{place}{error.strerror or error} ({_where(error)})")
    return BAD_INPUT


def _without_stdout(error: OSError) -> int:
    """Throw away what stdout does not take, lest the interpreter tries again at its end."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    if isinstance(error, BrokenPipeError):
        return STDOUT_CLOSED
    print_error(f"stdout cannot be written ({error.strerror or error})")
    return BAD_INPUT


def _where(error: BaseException) -> str:
    """Return where in the code an error came up, for who wants to report it."""
    frames = traceback.extract_tb(error.__traceback__)
    frame = next((each for each in reversed(frames) if "tensionlab" in each.filename), frames[-1])
    return f"{type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}"


def _open_streams() -> None:
    """Have stdout and stderr, even where they were closed, and write all characters, even where they are ASCII."""
    for name in ("stdout", "stderr"):
        stream: TextIO | None = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - until the end
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
