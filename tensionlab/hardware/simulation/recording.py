"""What did the cables of simulated modules really pull with? A table in a file, as it happens."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from tensionlab.files import writing
from tensionlab.hardware.simulation.simulated_module import SimulatedModule

PERIOD = 5e-3
"""Time from one row to the next of a module, in s, at least."""
COLUMNS = ("time", "module", "tension", "commanded", "distance", "state", "own_time")
"""Time of day in s since 1970, name, N, N, m, the state's name, and the module's own time in s, which passes more
slowly on a busy machine."""


class Recording:
    """Writes how modules are, again and again. A context manager.

    Parameters
    ----------
    path : Path
        A CSV file, with the columns `COLUMNS`.
    names : sequence of str
        Of the modules, in the order in which `take` gets them.

    Raises
    ------
    WriteError
        Here and in `take`, if the file cannot be written.
    """

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self._names = names
        self._path = path
        self._file = io.TextIOWrapper(
            writing.open_stream(path), encoding="utf-8", newline="", line_buffering=True, write_through=True
        )
        self._rows = csv.writer(self._file)
        self._write(COLUMNS)
        self._due = 0.0

    def __enter__(self) -> Self:
        """Keep the file open."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        with suppress(OSError):  # that a row could not be written has been said
            self._file.close()

    def take(self, modules: Sequence[SimulatedModule]) -> None:
        """Write how the modules are, if it is time to."""
        now = time.time()
        if now < self._due:
            return
        self._due = now + PERIOD
        for name, module in zip(self._names, modules, strict=True):
            sample = module.sample
            numbers = (f"{value:.4f}" for value in (sample.tension, sample.commanded, sample.distance))
            self._write([f"{now:.4f}", name, *numbers, sample.state.name, f"{sample.seconds:.4f}"])

    def _write(self, row: Sequence[str]) -> None:
        try:
            self._rows.writerow(row)
        except OSError as error:
            raise writing.unwritable(self._path, error) from None
