"""What the verbs share: numbers from words, refusals, words from numbers, tables, JSON and progress."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

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
    from tensionlab.experiments.lineup import lineup

    try:
        lineup(names, nearest, (rig.n, rig.m))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def output_file(path: Path | None) -> Path | None:
    """Whether a file can be written there; asked before the work, as a callback of the option.

    Raises
    ------
    BadParameter
        If the folder does not exist.
    """
    if path is not None and not path.absolute().parent.is_dir():
        raise typer.BadParameter(f"no folder {path.absolute().parent}; make it first")
    return path


def picture_file(path: Path | None) -> Path | None:
    """Whether a picture can be written there; asked before the work, as a callback of the option.

    Raises
    ------
    BadParameter
        If the folder does not exist, or the suffix is that of no picture.
    """
    from tensionlab.plots import METADATA

    if path is not None and path.suffix.lower() not in METADATA:
        raise typer.BadParameter(f"{path} is no picture; it must end in {', '.join(METADATA)}")
    return output_file(path)


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


def console() -> Console:
    """Where tables are printed: as wide as the terminal, or 120 columns in a pipe or file."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False)


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
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)
