"""Output of the verbs: tables, JSON, progress, files, messages on stderr, and what Ctrl-C leaves."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from enum import Enum, Flag
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import typer

from tensionlab.errors import InputError, WriteError
from tensionlab.support import provenance
from tensionlab.support.files import writing
from tensionlab.support.formatting import one_line, wrap
from tensionlab.support.operating_system import INTERRUPT_SIGNALS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from tensionlab.support.table import Table
    from tensionlab.viewer.server import PageServer


NOTHING_KEPT = "nothing is kept"  # message after Ctrl-C, unless a verb has its own
BAR_AFTER_S = 2.0  # work that takes longer shows a bar


def print_message(text: str) -> None:
    """Print a line on stderr, above a bar of progress; a terminal shows it in lines of its width."""
    with contextlib.suppress(OSError, ValueError):
        if sys.stderr.isatty():
            text = "\n".join(wrap(text, shutil.get_terminal_size().columns))
        print(text, file=sys.stderr, flush=True)


def print_error(text: str) -> None:
    """Print what went wrong as one line on stderr: of limited length, with nothing that moves a cursor."""
    print_message(one_line(f"tensionlab: {text}"))


@contextlib.contextmanager
def if_interrupted(*words: str) -> Iterator[None]:
    """Print what was saved, and how to continue, if Ctrl-C ends this context; after what was printed inside it."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt("; ".join([*map(str, error.args), *words])) from None


@contextlib.contextmanager
def until_interrupted(kept: str) -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C or SIGTERM end the work in good order; yield a function that tells whether one has come.

    At the end, a Ctrl-C is raised, with what was saved.
    """
    came: list[int] = []
    previous = [signal.signal(number, lambda number, _: came.append(number)) for number in INTERRUPT_SIGNALS]
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in zip(INTERRUPT_SIGNALS, previous, strict=True):
            signal.signal(number, handler)
    if signal.SIGINT in came:
        raise KeyboardInterrupt(kept)


def open_page(server: PageServer, shown: str, *, browser: bool) -> None:
    """Print where a page is, and open a browser there."""
    typer.echo(f"{server.url} shows {shown}; Ctrl-C ends it")
    if browser:
        server.open_browser()


def wait_for_enter(text: str) -> None:
    """Print what to do, and wait until it is done."""
    print(f"{text}; then press Enter", end=" ", file=sys.stderr, flush=True)
    if sys.stdin is None or not sys.stdin.readline():
        raise InputError("stdin ended before Enter was pressed; run this in a terminal")


class ResultWriter:
    """Context that writes result files, and prints where they are after the results, which its block prints.

    Leaving it raises the first `WriteError`. With ``quiet`` it prints nothing: stdout is JSON. After Ctrl-C the
    message names the files that are written.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._lines: list[str] = []
        self._failed: list[WriteError] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind in (None, typer.Exit) and not self._quiet:
            for line in self._lines:
                typer.echo(line)
        if self._failed:
            raise self._failed[0]
        if kind is KeyboardInterrupt and self._lines:
            raise KeyboardInterrupt(f"written: {', '.join(self._lines)}; the same command writes the rest")

    def write(self, name: str, path: Path, write: Callable[[Path], object]) -> bool:
        """Write a file, and return whether that went well. Without a name, its place is not printed."""
        try:
            write(path)
        except WriteError as error:
            self._failed.append(error)
            return False
        if name:
            self._lines.append(f"{name}: {path}")
        return True

    def write_text(self, name: str, path: Path, text: str) -> bool:
        """Write a text like `write`; print what cannot be written, so that it is not lost."""
        if self.write(name, path, lambda place: writing.write_text(place, text)):
            return True
        if not self._quiet:
            self._lines.append(text)
            self._failed[-1] = WriteError(f"{self._failed[-1]}; it is printed on stdout instead")
        return False

    def draw(self, path: Path | None, kind: str, *results: Any, **options: Any) -> None:
        """Draw results by the function ``plot_KIND`` of `tensionlab.plots`, if there is a path."""
        if path is not None:
            from tensionlab import plots

            figure = getattr(plots, f"plot_{kind}")(*results, **options)
            self.write("plot", path, lambda place: plots.save_figure(figure, place))


def console(*, stderr: bool = False) -> Console:
    """Return where tables are printed: as wide as the terminal, or 120 columns in a pipe or file.

    Names are printed as they are: no brackets in them are markup, no colons emoji.
    """
    from rich.console import Console

    from tensionlab.support.table import WIDE

    class Screen(Console):
        def on_broken_pipe(self) -> None:
            """Let `tensionlab.cli.main` see it."""
            raise  # noqa: PLE0704 - rich calls this where it has caught the error

    width = None if sys.stdout.isatty() or stderr else WIDE
    return Screen(stderr=stderr, width=width, highlight=False, markup=False, emoji=False)


def styled(table: Table) -> Text:
    """Return a table as text as wide as the terminal, its title bold, its notes dim and its marks coloured."""
    from rich.text import Text

    from tensionlab.support.table import STATUS_MARKS, met_mark

    text = Text(table.to_text(console().width), no_wrap=True, overflow="ignore")
    text.stylize("bold", 0, len(str(table.title)))
    if (end := text.plain.rfind("\n\n")) >= 0:
        text.stylize("dim", end)
    for mark in (*STATUS_MARKS, met_mark(True), met_mark(False)):
        text.highlight_words([mark.shape], {"#000000": "bold red"}.get(mark.colour, mark.colour))
    return text


def print_table(table: Table) -> None:
    """Print a table as wide as the terminal, or 120 columns in a pipe or file."""
    from tensionlab.support.table import WIDE

    if console().width < WIDE and any(column.wide for column in table.columns):
        table.notes.append(f"Wider terminals ({WIDE} columns) show more columns; --json has all.")
    console().print(styled(table), soft_wrap=True)


def print_line(text: str = "") -> None:
    """Print a text on one line, however narrow the terminal: paths can be copied from it."""
    console().print(text, soft_wrap=True)


def print_json(value: Any = None, **keys: Any) -> None:
    """Print a value, or keys with their values, as JSON and nothing else; NaN and infinity become null."""
    typer.echo(json.dumps(plain(keys or value), indent=2, ensure_ascii=False))


def plain(value: Any) -> Any:
    """Return the same as JSON has it: fields by name, members of enumerations by name, finite floats."""
    if isinstance(value, Flag):
        return [member.name for member in value]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # NumPy's arrays and numbers
        return plain(value.tolist())
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if hasattr(value, "_asdict"):  # named tuples
        value = value._asdict()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def manifest(seed: int | None = None) -> dict[str, Any]:
    """Return where and how a result was made, with the command line."""
    return provenance.manifest(["tensionlab", *sys.argv[1:]], seed)


def fields(thing: object, *names: str) -> dict[str, Any]:
    """Return some attributes of a thing by their names, for JSON."""
    return {name: getattr(thing, name) for name in names}


@contextlib.contextmanager
def progress(what: str) -> Iterator[Callable[..., None]]:
    """Show a bar on stderr while long work lasts, if that is a terminal.

    Yield what takes the share done, and what has been found until then, if anything.
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=console(stderr=True), transient=True, disable=not sys.stderr.isatty())
    task, began = bar.add_task(what, total=1.0), time.perf_counter()

    def report(done: float, found: str = what) -> None:
        if time.perf_counter() - began > BAR_AFTER_S:
            bar.start()
        bar.update(task, completed=done, description=found)

    try:
        yield report
    finally:
        if bar.live.is_started:
            bar.stop()
