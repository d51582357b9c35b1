"""What the verbs share: numbers from words, files to write, words from numbers, tables, JSON and progress."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import typer

from tensionlab.errors import WriteError
from tensionlab.files import writing

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from tensionlab.model.rig import Rig

WIDTH = 120
"""Columns of a table where stdout is no terminal."""


def numbers(text: str) -> list[float]:
    """Which numbers a word lists; separated by commas or spaces.

    Raises
    ------
    BadParameter
        If one of them is not a number, or there is none.
    """
    parts = text.replace(",", " ").split()
    try:
        values = [float(part) for part in parts]
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of numbers; write them like 0 -0.1 0.3") from None
    if not values:
        raise typer.BadParameter("no numbers; write them like 0 -0.1 0.3")
    return values


def words(options: list[str] | None) -> list[str] | None:
    """Which words an option lists, given once or repeatedly, each with commas or not; None if left out."""
    if options is None:
        return None
    return [word.strip() for option in options for word in option.split(",") if word.strip()]


def check_solvers(rig: Rig, names: list[str] | None, nearest: str | None) -> None:
    """Whether these solvers serve the rig with that policy; asked before the work.

    Raises
    ------
    BadParameter
        If one does not, or there is no such policy.
    UnknownSolver, MissingDependency, PluginError
        As `lineup`.
    """
    from tensionlab.solvers.selection import lineup

    try:
        lineup(names, nearest, (rig.n, rig.m))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def output_file(*suffixes: str) -> Callable[[Path | None], Path | None]:
    """Return a callback for an option that names a file to write, which is checked before the work.

    Parameters
    ----------
    suffixes : str
        Those that the file may have, in lower case.
    """

    def check(path: Path | None) -> Path | None:
        if path is not None:
            with _as_bad_parameter():
                writing.require_writable(path, suffixes)
        return path

    return check


def output_folder(suffix: str = "", *, parents: bool = False) -> Callable[[Path | None], Path | None]:
    """Return a callback for an option that names a folder to write to; as `output_file`."""

    def check(path: Path | None) -> Path | None:
        if path is not None:
            with _as_bad_parameter():
                if path.suffix.lower() != suffix and suffix:
                    raise WriteError(f"{path}: the name must end in {suffix}")
                writing.require_folder(path, parents=parents)
        return path

    return check


def picture_file(path: Path | None) -> Path | None:
    """Check that a picture can be written there; as the callback of `output_file`."""
    if path is None:
        return None
    from tensionlab.plots import METADATA

    return output_file(*METADATA)(path)


@contextlib.contextmanager
def _as_bad_parameter() -> Iterator[None]:
    """Have the parser say which option it was."""
    try:
        yield
    except WriteError as error:
        raise typer.BadParameter(str(error)) from None


class Keeper:
    """Writes results to files; says where they are, and what could not be written, when they have been shown.

    A context manager: its block shows the results.

    Parameters
    ----------
    quiet : bool
        Whether not to print where files are, because stdout is JSON.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._lines: list[str] = []
        self._failed: list[WriteError] = []

    def __enter__(self) -> Self:
        """Write, and show meanwhile."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Say where files are.

        Raises
        ------
        WriteError
            For the first that could not be written.
        """
        if kind in (None, typer.Exit) and not self._quiet:
            for line in self._lines:
                typer.echo(line)
        if self._failed:
            raise self._failed[0]

    def write(self, name: str, path: Path, write: Callable[[Path], object]) -> bool:
        """Write a file, and return whether that went well. Without a name, it is not shown where."""
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


def short(value: float) -> str:
    """Two significant digits in at most six characters; a dash for NaN."""
    if math.isnan(value):
        return "–"
    size = abs(value)
    if size == 0:
        return "0"
    if size < 5e-4:
        return f"{value:.0e}".replace("e-0", "e-")
    if size >= 99.5:
        return f"{value:.0f}"
    return f"{value:.{1 if size >= 9.95 else 2 if size >= 0.0995 else 3}f}"


def duration(seconds: float) -> str:
    """A time with the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.9995 * size:
            value = seconds / size
            return f"{value:.0f} {unit}" if value >= 99.5 else f"{value:.2g} {unit}"
    return "–" if math.isnan(seconds) else f"{seconds / 1e-9:.0f} ns"


def vector(values: Any) -> str:
    """Components in brackets, without trailing zeros."""
    return "(" + ", ".join(f"{float(value):.4g}" for value in values) + ")"


def components(rig: Rig) -> list[str]:
    """Names and units of the components of a rig's wrench."""
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
            """Let `tensionlab.cli.ending` see it."""
            raise  # noqa: PLE0704 - rich calls this where it has caught the error

    width = None if sys.stdout.isatty() or stderr else WIDTH
    return Screen(stderr=stderr, width=width, highlight=False, markup=False, emoji=False)


def table(title: str = "", gap: int = 2) -> Table:
    """Make an empty table in the house's style, with so many spaces between columns."""
    from rich import box
    from rich.table import Table

    return Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, gap - 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )


def print_json(value: Any) -> None:
    """Print JSON and nothing else; NaN and infinity become null."""
    typer.echo(json.dumps(plain(value), indent=2, ensure_ascii=False))


def plain(value: Any) -> Any:
    """The same in lists, dicts, strings, whole numbers and finite floats."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # NumPy's arrays and numbers
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


@contextlib.contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr while the work lasts, if that is a terminal; it vanishes when done.

    Yields
    ------
    callable
        To be told the share that is done, from 0 to 1.
    """
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
