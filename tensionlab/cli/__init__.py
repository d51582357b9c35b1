"""The command ``tensionlab``: its verbs, and how a command ends.

Exit status 0: done. 1: the answer is no, or something went wrong with a module. 2: bad input, or a file or stdout
that cannot be written, with one line on stderr that says what to do. 130: ended by Ctrl-C, with one line on stderr
that says what is kept and how to go on. 141: whoever reads stdout has gone. A verb is imported when it is used, so
that ``--help`` stays quick.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from tensionlab import __version__
from tensionlab.cli.common.output import NOTHING_KEPT, print_error
from tensionlab.cli.common.verbs import Verbs
from tensionlab.errors import TensionlabError
from tensionlab.support.operating_system import reader_has_gone

if TYPE_CHECKING:
    from typing import TextIO

BAD_INPUT = 2  # exit status where input is bad, or a file or stdout cannot be written
INTERRUPTED = 130  # exit status after Ctrl-C: 128 + SIGINT, as a shell has it
STDOUT_CLOSED = 141  # exit status where whoever reads stdout has gone: 128 + SIGPIPE
PROGRAM = "tensionlab"
# Variable of the environment in which a shell asks how an unfinished command may go on.
COMPLETION_VARIABLE = f"_{PROGRAM.upper()}_COMPLETE"
NUMBER_OPTIONS = ("--at", "--force", "--wrench", "--reference", "--box", "--step", "--frame")
# Numbers, with a unit as well: whoever reads them says that it is left out.
NUMBERS = re.compile(r"[-+]?\.?\d[\d.eE+,-]*([a-z°]{1,3}|N·m)?,?|[-+]?(nan|inf),?", re.IGNORECASE)
PARSER_WORDS = {
    r"^Invalid value for '([^']+)'.*?: ": r"\1: ",
    r"^Invalid value: ": "",
    r"^Missing \w+ '([^']+)'.*": r"\1 is missing",
    r"^No such": "no such",
    r"^Option '([^']+)'": r"\1",
    r"^Got unexpected extra arguments? ?\(?s?\)? \((.*)\)": r"too many words: \1",
    r"Value error, ": "",
    r"Input should be a valid integer.*": "give a whole number",
    r"Input should be a valid number.*": "give a number",
    r"Input should be ": "it must be ",
}  # what the parser's messages say, and what they say here
PRINTERS = {"click", "typer", "rich"}  # packages that write to stdout. All else that writes names its file.
ClickException: type[Any] = typer.BadParameter.__mro__[2]  # later versions of typer bring a click of their own

VERBS = {
    "compare": ("compare", "Compare solvers on one set of forces, or along a trajectory."),
    "allocate": ("allocate", "Choose the cable tensions that render one wrench."),
    "solvers": (
        "solvers",
        "List the solvers, with what each minimises, its policies for infeasible wrenches, and its source.",
    ),
    "workspace": ("workspace", "Evaluate where, and how well, rigs can pull."),
    "certify": ("certify", "Prove where a rig renders what is required."),
    "bench": ("bench", "Benchmark all solvers and baselines."),
    "regressions": (
        "regressions",
        "Tell which solvers became slower or less accurate from one benchmark to another.",
    ),
    "run": ("run", "Render forces on the modules of a rig."),
    "scenario": ("scenario", "Play a haptic scenario and check its forces."),
    "serve": ("serve", "Let a game engine drive a rig over a WebSocket."),
    "simulate": ("simulate", "Simulate the modules of a rig, with their firmware."),
    "validate": ("validate", "Repeat the published validation and compare with it."),
    "estop": ("estop", "Stop modules at once, also those of other processes."),
    "module": ("module", "Find modules, show how they are, set them up and stop them."),
    "new": ("new", "Write a rig, a space, a scenario or a program to start from."),
    "view": ("view", "Design a rig in the browser, or watch a run there."),
    "rig": ("rig", "Show, check, import and export rigs."),
    "layout": ("layout", "Find out where to put the modules."),
    "log": ("log", "Show, export, draw, play and replay logs of runs."),
    "problems": ("bench", "List, show and export the benchmark's problem sets."),
    "datasets": ("datasets", "List the rigs and other data sets that are known by name."),
}  # module of each verb, and what `--help` says of it


class AllVerbs(TyperGroup):
    """All verbs, each imported when it is used."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: dict[str, Any] = dict.fromkeys(VERBS)

    def get_command(self, context: Any, name: str) -> Any:
        """Return a verb; None if there is none of that name."""
        if name not in VERBS:
            return None
        verb = getattr(import_module(f"tensionlab.cli.{VERBS[name][0]}"), name)
        alone = Verbs()
        if isinstance(verb, typer.Typer):
            alone.add_typer(verb, name=name)
        else:
            alone.command(name)(verb)
        return typer.main.get_group(alone).commands[name]

    def format_commands(self, context: Any, formatter: Any) -> None:
        """Write the verbs, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in VERBS.items()])


app = typer.Typer(
    cls=AllVerbs,
    help="Tension allocation for modular cable systems: every solver behind one interface, each answer verified.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help, 0.2 s sooner
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from tensionlab.benchmark.speed import describe_kernels

        typer.echo(f"tensionlab {__version__}\n{describe_kernels()}")
        raise typer.Exit()


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            "-v",
            callback=_version,
            is_eager=True,
            help="Show the version and how the kernels were compiled, and stop.",
        ),
    ] = False,
) -> None:
    """Take the options that come before the verb."""


def join_numbers(words: Sequence[str]) -> list[str]:
    """Join the numbers after ``--at`` and the like to one word, and return all words.

    ``--at 0 -0.1 0.3`` becomes ``--at 0,-0.1,0.3``: the parser knows neither how many components a rig has
    nor that ``-0.1`` is a number and not an option. What is no number but has one after it is joined, too: the
    name in ``--frame hip 0 0 1``, and ``one`` in ``--wrench one 0 0``, which whoever reads the numbers refuses.
    """
    joined: list[str] = []
    start: int | None = None
    for word, after in zip_longest(words, words[1:], fillvalue=""):
        option, equals, _ = word.partition("=")
        if option in NUMBER_OPTIONS:
            joined.append(word)
            start = len(joined) - bool(equals)
        elif start is not None and (
            NUMBERS.fullmatch(word) or (not word.startswith("-") and NUMBERS.fullmatch(after))
        ):
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
    if COMPLETION_VARIABLE in os.environ:
        typer.main.get_command(app)(prog_name=PROGRAM)  # answers the shell, and leaves
    _open_streams()
    if Path("matplotlibrc").exists():
        from tensionlab.plots.style import import_matplotlib

        import_matplotlib()
    status = _status(join_numbers(words))
    try:
        sys.stdout.flush()
    except OSError as error:
        status = _without_stdout(error)
    raise SystemExit(status)


def _invoke(words: Sequence[str]) -> None:
    """Carry out the verb; errors are let through, which the parser's own way of running it would not do."""
    with typer.main.get_command(app).make_context(PROGRAM, list(words)) as context:
        context.command.invoke(context)


def _status(words: Sequence[str]) -> int:
    """Carry out the verb, print what goes wrong, and return the exit status."""
    try:
        _invoke(words)
        return 0
    except typer.Exit as leaving:
        return leaving.exit_code
    except KeyboardInterrupt as error:
        print_error(f"interrupted: {str(error) or NOTHING_KEPT}")
        return INTERRUPTED
    except ClickException as error:
        return _parser_refused(error)
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


def _parser_refused(error: Any) -> int:
    """Print what the parser refused: the option, what is wrong with it, and where to read how it is called."""
    if type(error).__name__ == "NoArgsIsHelpError":
        with suppress(OSError):
            error.show()
        return BAD_INPUT
    text: str = error.format_message().rstrip(".")
    for theirs, ours in PARSER_WORDS.items():
        text = re.sub(theirs, ours, text)
    told = error.ctx is None or (isinstance(error, typer.BadParameter) and not text.endswith("is missing"))
    after = "" if text.endswith("?") else ";"
    print_error(text if told else f"{text}{after} see `{error.ctx.command_path} -h`")
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
    if reader_has_gone(error):
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
