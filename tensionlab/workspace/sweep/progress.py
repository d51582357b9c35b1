"""A bar that says how far a sweep is, how fast it goes and how long it will take."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from datetime import timedelta

PATIENCE = 2.0
"""Seconds before the bar shows up."""


@contextlib.contextmanager
def bar(total: int, done: int, shown: bool) -> Iterator[Callable[[int], None]]:
    """Show a bar on stderr while the work lasts, if that is a terminal; it vanishes when done.

    Parameters
    ----------
    total, done : int
        Poses of all the work, and those that were finished before.
    shown : bool
        False for no bar at all.

    Yields
    ------
    callable
        To be told of more finished poses.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        TextColumn("Sweep"),
        BarColumn(),
        TextColumn("{task.completed:,.0f} of {task.total:,.0f} poses, {task.fields[speed]}"),
    )
    progress = Progress(*columns, console=Console(file=sys.stderr), transient=True)
    shown = shown and progress.console.is_terminal
    task = progress.add_task("", total=total, completed=done, speed="")
    start, new = time.monotonic(), 0

    def advance(count: int) -> None:
        nonlocal new
        new += count
        elapsed = time.monotonic() - start
        left = timedelta(seconds=round((total - done - new) * elapsed / new))
        progress.update(task, completed=done + new, speed=f"{new / elapsed:,.0f}/s, {left} left")
        if shown and elapsed > PATIENCE and not progress.live.is_started:
            progress.start()

    try:
        yield advance
    finally:
        if progress.live.is_started:
            progress.stop()
