"""What verbs print and write: tables, JSON, numbers as text, progress, files, and messages on stderr."""

from __future__ import annotations

import contextlib
import json
import math
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import typer

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, InputError, WriteError
from tensionlab.support import provenance
from tensionlab.support.files import writing
from tensionlab.support.formatting import format_number, format_vector

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from tensionlab.model.rig import Rig
    from tensionlab.support.table import Finding
    from tensionlab.viewer.server import PageServer


PIPE_WIDTH = 120
"""Columns of a table where stdout is no terminal."""
GAP = 2
"""Spaces between the columns of a table."""
NOTHING_KEPT = "nothing is kept"
"""What Ctrl-C leaves to say, unless a verb has other words."""
short, vector = format_number, format_vector
"""Numbers, as notebooks show them too."""


def print_error(text: str) -> None:
    """Print one line about what went wrong on stderr: of limited length, with nothing that moves a cursor."""
    with contextlib.suppress(OSError, ValueError):
        print(clip(f"tensionlab: {text}"), file=sys.stderr, flush=True)


@contextlib.contextmanager
def if_interrupted(*words: str) -> Iterator[None]:
    """Say what is kept, and how to go on, where Ctrl-C ends this context; after what was said inside it."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt("; ".join([*map(str, error.args), *words])) from None


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


def clip(text: str, length: int = MAX_MESSAGE_CHARACTERS) -> str:
    """Return a text as one line of so many characters at most; what is left out is in its middle."""
    lines = "; ".join(" ".join(each.split()) for each in text.splitlines() if each.strip()).replace(":; ", ": ")
    line = "".join(each if each.isprintable() else repr(each)[1:-1] for each in lines)
    if len(line) <= length:
        return line
    end = length // 3
    return f"{line[: length - end - 5]} ... {line[-end:]}"


class ResultWriter:
    """Writer of result files, which prints where they are after the results, which its block shows.

    It raises `WriteError` for the first that could not be written. A quiet one prints nothing: stdout is JSON.
    Where Ctrl-C ends its block, it says which files are there.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._lines: list[str] = []
        self._failed: list[WriteError] = []

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Print where files are; raise the first error."""
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
        """Write a text like `write`; what cannot be written is printed, so that it is not lost."""
        if self.write(name, path, lambda place: writing.write_text(place, text)):
            return True
        if not self._quiet:
            self._lines.append(text)
            self._failed[-1] = WriteError(f"{self._failed[-1]}; it is printed on stdout instead")
        return False


def components(rig: Rig) -> list[str]:
    """Return names and units of the components of a rig's wrench."""
    axes = "xyz"[: rig.dimension]
    torques = axes if rig.n == 6 else "z" if rig.n > rig.dimension else ""
    return [f"F{axis} (N)" for axis in axes] + [f"M{axis} (N·m)" for axis in torques]


def console(*, stderr: bool = False) -> Console:
    """Return where tables are printed: as wide as the terminal, or 120 columns in a pipe or file.

    Names are printed as they are: no brackets in them are markup, no colons emoji.
    """
    from rich.console import Console

    class Screen(Console):
        def on_broken_pipe(self) -> None:
            """Let `tensionlab.cli.main` see it."""
            raise  # noqa: PLE0704 - rich calls this where it has caught the error

    width = None if sys.stdout.isatty() or stderr else PIPE_WIDTH
    return Screen(stderr=stderr, width=width, highlight=False, markup=False, emoji=False)


def table(headings: Sequence[str], rows: Iterable[Sequence[Any]] = (), *, gap: int = GAP) -> Table:
    """Return a table in the style of all verbs.

    Columns are for numbers, to the right and on one line; those whose heading begins with ``<`` are for text, to
    the left and on several lines where there is no room. Texts are printed as they are, numbers without trailing
    zeros, vectors in brackets, None as a dash. The gap is in spaces.
    """
    from rich import box
    from rich.table import Table

    grid = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, gap - 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    for heading in headings:
        text = heading.startswith("<")
        grid.add_column(
            heading.removeprefix("<"), justify="left" if text else "right", overflow="fold", no_wrap=not text
        )
    for row in rows:
        grid.add_row(*map(_cell, row))
    return grid


def _cell(value: Any) -> Any:
    """Return what a table shows for a value."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "–"}[value]
    if getattr(value, "ndim", 0):
        return vector(value)
    return (
        f"{value:g}" if isinstance(value, float) else value if hasattr(value, "__rich_console__") else str(value)
    )


def print_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[Any]], *, gap: int = GAP) -> None:
    """Print a title, unless it is empty, and a table, whose parameters are those of `table`."""
    if title:
        print_title(title)
    console().print(table(headings, rows, gap=gap))


def print_findings(title: str, findings: Iterable[Finding]) -> None:
    """Print what was checked, each with yes, no or, where it is neither, note; no line ends before a unit."""
    from rich.text import Text

    words = {True: Text("yes", "green"), False: Text("no", "red"), None: Text("note")}
    listed = list(findings)
    before = 2 * GAP + max((len(words[each.passed]) for each in listed), default=0)
    width = console().width - GAP - before - max((len(each.name) for each in listed), default=0)
    rows = [(words[each.passed], each.name, _wrapped(each.text, max(width, 20))) for each in listed]
    print_table(title, ("<", "<check", "<finding"), rows)


def _wrapped(text: str, width: int) -> str:
    """Return a text in lines of a width, each number on one line with its unit."""
    held = re.sub(r"(?<=\d) (?=\S)", "\N{NO-BREAK SPACE}", text)
    return textwrap.fill(held, width, break_on_hyphens=False).replace("\N{NO-BREAK SPACE}", " ")


def print_title(title: str) -> None:
    """Print the title of a table, on one line however narrow the table is."""
    console().print(title, style="bold", soft_wrap=True)


def print_json(value: Any = None, **keys: Any) -> None:
    """Print a value, or keys with their values, as JSON and nothing else; NaN and infinity become null."""
    typer.echo(json.dumps(plain(keys or value), indent=2, ensure_ascii=False))


def plain(value: Any) -> Any:
    """Return the same in lists, dicts, strings, whole numbers and finite floats, as JSON has them."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # NumPy's arrays and numbers
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def manifest(seed: int | None = None) -> dict[str, Any]:
    """Return where and how a result was made, with the command line."""
    return provenance.manifest(["tensionlab", *sys.argv[1:]], seed)


def fields(thing: object, *names: str) -> dict[str, Any]:
    """Return some attributes of a thing by their names, for JSON."""
    return {name: getattr(thing, name) for name in names}


@contextlib.contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr while the work lasts, if that is a terminal; yield what takes the share done."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)
