"""The command ``tensionlab``: its verbs, and its exit status.

0: done. 1: the answer is no, or something went wrong with a module. 2: bad input, or a file or stdout that cannot
be written, with one line on stderr that says what to do. 130: ended by Ctrl-C, with one line on stderr that says
what was saved and how to continue. 141: the reader of stdout has gone. A verb is imported when it is used, so that
``--help`` stays quick.
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

from tensionlab import __version__
from tensionlab.cli.common.output import NOTHING_KEPT, print_error
from tensionlab.cli.common.verbs import EXAMPLES, ClickException, VerbGroup, Verbs
from tensionlab.errors import TensionlabError
from tensionlab.support.operating_system import ONE_THREAD, reader_has_gone

if TYPE_CHECKING:
    from typing import TextIO

BAD_INPUT, INTERRUPTED, STDOUT_CLOSED = 2, 130, 141  # the latter two as shells have it: 128 + SIGINT or SIGPIPE
PROGRAM = "tensionlab"
COMPLETION_VARIABLE = f"_{PROGRAM.upper()}_COMPLETE"  # set by a shell that asks for completions
NUMBER_OPTIONS = (*EXAMPLES, "--frame")
# Numbers, also with a unit: the message on it then says how to write them.
NUMBERS = re.compile(r"[-+]?\.?\d[\d.eE+,-]*([a-z°]{1,3}|N·m)?,?|[-+]?(nan|inf),?", re.IGNORECASE)
PARSER_WORDS = {
    r"^Invalid value for '([^']+)'.*?: ": r"\1: ",
    r"^Invalid value: ": "",
    r"^Missing \w+ '([^']+)'.*": r"\1 is missing",
    r"^No such": "no such",
    r"^Option '([^']+)'": r"\1",
    r"^Got unexpected extra arguments? ?\(?s?\)? \((.*)\)": r"too many words: \1",
    r" requires an argument$": " needs a value",
    r" requires (\d) arguments$": r" needs \1 values",
}  # messages of the parser, and ours
PRINTERS = {"click", "typer", "rich"}  # packages that write to stdout; errors of all other writers name a file

PANELS = {
    "Try": {
        "allocate": ("allocate", "Choose the cable tensions that render one wrench."),
        "compare": ("compare", "Compare solvers on one set of forces."),
        "solvers": ("catalogue", "List the solvers, with what each minimises, and its policies."),
        "bench": ("bench", "Benchmark all solvers and baselines."),
        "problems": ("bench", "Write one of the benchmark's problem sets as quadratic programs."),
    },
    "Design": {
        "new": ("catalogue", "Write a rig, a space, a scenario or a program to start from."),
        "rig": ("rig", "Show, check, import and export rigs."),
        "layout": ("layout", "Find out where to put the modules."),
        "workspace": ("workspace", "Evaluate where, and how well, rigs can pull."),
        "trajectory": ("trajectory", "Check whether a rig can carry its platform along a trajectory."),
        "certify": ("workspace", "Prove where a rig renders what is required."),
        "view": ("view", "Design a rig in the browser, or watch a run there."),
    },
    "Run": {
        "simulate": ("simulate", "Simulate the modules of a rig, with their firmware."),
        "module": ("module", "Find, inspect, set up and stop modules."),
        "estop": ("estop", "Stop modules at once, also those of other processes."),
        "run": ("run", "Render forces on the modules of a rig."),
        "scenario": ("scenario", "Play a haptic scenario and judge its forces."),
        "serve": ("serve", "Let a game engine drive a rig over a WebSocket."),
        "validate": ("validate", "Repeat the published validation and compare with it."),
        "characterise": ("validate", "Measure a rig as a haptic device, and compare it with published ones."),
    },
    "Data": {
        "log": ("log", "Show, export, draw and play logs of runs."),
        "datasets": ("catalogue", "List the rigs and other data sets that are known by name."),
    },
}  # module of each verb, and its line in `--help`
VERBS = {name: verb for verbs in PANELS.values() for name, verb in verbs.items()}


class AllVerbs(VerbGroup):
    """Group of all verbs, each imported when it is used."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: dict[str, Any] = dict.fromkeys(VERBS)

    def get_command(self, context: Any, name: str) -> Any:
        """Return a verb; None if there is none of that name."""
        if name not in VERBS:
            return None
        verb = getattr(import_module(f"tensionlab.cli.{VERBS[name][0]}"), name)
        group = Verbs()
        if isinstance(verb, typer.Typer):
            group.add_typer(verb, name=name)
        else:
            group.command(name)(verb)
        return typer.main.get_group(group).commands[name]

    def format_commands(self, context: Any, formatter: Any) -> None:
        """Write the verbs, without importing them."""
        width = max(map(len, VERBS))
        for panel, verbs in PANELS.items():
            with formatter.section(panel):
                formatter.write_dl([(name.ljust(width), about) for name, (_, about) in verbs.items()])


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
def read_options(
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
    """Read the options before the verb."""


def join_numbers(words: Sequence[str]) -> list[str]:
    """Join the numbers after ``--at`` and the like to one word, and return all words.

    ``--at 0 -0.1 0.3`` becomes ``--at 0,-0.1,0.3``: the parser knows neither how many components a rig has nor
    that ``-0.1`` is a number and not an option. A word that is not a number is joined where one follows: the name
    in ``--frame hip 0 0 1``, and ``one`` in ``--wrench one 0 0``, which is refused later.
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
    """Run the command line, and leave through `SystemExit`, after one line on stderr if something went wrong.

    An error that is a defect of this program, such as a `TypeError`, keeps its traceback.
    """
    words = sys.argv[1:] if arguments is None else arguments
    if COMPLETION_VARIABLE in os.environ:
        typer.main.get_command(app)(prog_name=PROGRAM)  # answers the shell, and leaves
    _open_streams()
    if words[:1] == ["bench"] and "numpy" not in sys.modules:
        os.environ.update(ONE_THREAD)
    if Path("matplotlibrc").exists():
        from tensionlab.plots.style import import_matplotlib

        import_matplotlib()
    status = _run(join_numbers(words))
    try:
        sys.stdout.flush()
    except OSError as error:
        status = _without_stdout(error)
    raise SystemExit(status)


def _invoke(words: Sequence[str]) -> None:
    """Carry out the verb, without the parser's own handling of errors."""
    with typer.main.get_command(app).make_context(PROGRAM, list(words)) as context:
        context.command.invoke(context)


def _run(words: Sequence[str]) -> int:
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
        return _report_usage(error)
    except TensionlabError as error:
        text = str(error)
    except OSError as error:
        return _report_system(error)
    except MemoryError:
        text = "out of memory; try fewer modules, poses or forces at once"
    except RecursionError as error:
        text = f"nested too deeply ({_where(error)}); give input that is less nested"
    except ValueError as error:
        text = f"{error} ({_where(error)})"
    print_error(text)
    return BAD_INPUT


def _report_usage(error: Any) -> int:
    """Print what the parser refused: the option, the problem, and where to read about it."""
    if type(error).__name__ == "NoArgsIsHelpError":
        with suppress(OSError):
            error.show()
        return BAD_INPUT
    text: str = error.format_message().rstrip(".")
    for pattern, replacement in PARSER_WORDS.items():
        text = re.sub(pattern, replacement, text)
    if type(error.__cause__).__name__ == "ValidationError":
        from tensionlab.support.validation import explain

        text = f"{text.partition(':')[0]}: {explain(error.__cause__)}"
    complete = error.ctx is None or (isinstance(error, typer.BadParameter) and not text.endswith("is missing"))
    end = "" if text.endswith("?") else ";"
    print_error(text if complete else f"{text}{end} see `{error.ctx.command_path} -h`")
    return BAD_INPUT


def _report_system(error: OSError) -> int:
    """Print what the system refused, which may be to write to stdout."""
    innermost = traceback.extract_tb(error.__traceback__)[-1].filename
    if error.filename is None and PRINTERS & set(Path(innermost).parts):
        return _without_stdout(error)
    place = "" if error.filename is None else f"{error.filename}: "
    print_error(f"{place}{error.strerror or error} ({_where(error)})")
    return BAD_INPUT


def _without_stdout(error: OSError) -> int:
    """Discard what stdout does not take: the interpreter would try again at its end."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
    if reader_has_gone(error):
        return STDOUT_CLOSED
    print_error(f"stdout cannot be written ({error.strerror or error})")
    return BAD_INPUT


def _where(error: BaseException) -> str:
    """Return the place in the code where an error was raised, for a report of it."""
    frames = traceback.extract_tb(error.__traceback__)
    frame = next((frame for frame in reversed(frames) if "tensionlab" in frame.filename), frames[-1])
    return f"{type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}"


def _open_streams() -> None:
    """Open stdout and stderr where they are closed, and let ASCII ones write all characters."""
    for name in ("stdout", "stderr"):
        stream: TextIO | None = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - until the end
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
