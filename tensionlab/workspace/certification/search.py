"""Resumable search, level by level, for the cells of a region that are inside or outside."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import DataError, InputError
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.files import writing
from tensionlab.support.files.tables import read_npz
from tensionlab.workspace.certification.problem import CellProblem, Verdicts
from tensionlab.workspace.certification.subdivision import Subdivision

CHUNK_CELLS = 16_384  # number of cells in a task, which then takes a fraction of a second
MAX_CELLS = 50_000_000  # largest number of cells of a level that fits in memory
SAVE_INTERVAL_S = 10.0  # time between two writes of the cells, in s


class Cells(NamedTuple):
    """Finished cells, as in `CertifiedWorkspace`."""

    level: NDArray[np.int8]
    place: Integers
    verdict: NDArray[np.int8]
    shares: Floats


@dataclass(frozen=True, eq=False)
class CellTask:
    """Cells of one level (k, d), and the problem to prove of them."""

    problem: CellProblem
    cells: Subdivision
    level: int
    places: Integers

    def evaluate(self) -> Verdicts:
        """Return what is proved."""
        centres = self.cells.centres(self.level, self.places)
        return self.problem.prove(centres, self.cells.edges(self.level) / 2, self.level == self.cells.levels)


class CellSearch:
    """Finished cells of a region, and those that are still to be examined."""

    def __init__(self, problem: CellProblem, cells: Subdivision) -> None:
        self.evaluations = 0
        self.settled = 0.0  # volume
        self._problem, self._cells = problem, cells
        self._found: list[Cells] = []
        self._waiting: list[tuple[int, Integers]] = [(0, cells.first())]

    @property
    def finished(self) -> bool:
        """Whether no cell remains to be examined."""
        return not self._waiting

    def tasks(self) -> Iterator[CellTask]:
        """Yield the tasks of the coarsest level that has any; `settle` each before the next level."""
        level = min(level for level, _ in self._waiting)
        places = np.concatenate([each for own, each in self._waiting if own == level])
        if len(places) > MAX_CELLS:
            raise InputError(
                f"resolution: {len(places):,} cells are undecided at {self._cells.edges(level).max():.2g} m; give "
                "a longer one, or a smaller region"
            )
        chunks = [(level, places[start : start + CHUNK_CELLS]) for start in range(0, len(places), CHUNK_CELLS)]
        self._waiting = [each for each in self._waiting if each[0] != level] + chunks
        for _, chunk in chunks:
            yield CellTask(self._problem, self._cells, level, chunk)

    def settle(self, task: CellTask, verdicts: Verdicts) -> None:
        """Store what is proved of a task's cells; undecided ones are divided, and examined later."""
        self._waiting = [each for each in self._waiting if each[1] is not task.places]
        self.evaluations += len(task.places)
        open_cells = (verdicts.verdict == 0) & (task.level < self._cells.levels)
        done = ~open_cells
        level = np.full(int(done.sum()), task.level, np.int8)
        self._found.append(Cells(level, task.places[done], verdicts.verdict[done], verdicts.shares[done]))
        self.settled += len(level) * self._cells.cell_volume(task.level)
        if open_cells.any():
            self._waiting.append((task.level + 1, self._cells.children(task.places[open_cells])))

    def found(self) -> Cells:
        """Return the finished cells."""
        return Cells(*(np.concatenate(each) for each in zip(*self._found, strict=True)))

    def save(self, path: Path) -> None:
        """Write finished and remaining cells to a file that `load` reads."""
        d = self._cells.dimension
        empty = Cells(np.zeros(0, np.int8), np.zeros((0, d), np.int64), np.zeros(0, np.int8), np.zeros((0, 2)))
        self._found = [Cells(*(np.concatenate(each) for each in zip(empty, *self._found, strict=True)))]
        waiting = [np.zeros((0, d), np.int64), *(each for _, each in self._waiting)]
        with writing.replacing(path) as file:
            np.savez_compressed(
                file,
                identity=self._identity(),
                evaluations=self.evaluations,
                waiting_level=np.repeat(
                    [level for level, _ in self._waiting], [len(each) for each in waiting[1:]]
                ),
                waiting_place=np.concatenate(waiting),
                **self._found[0]._asdict(),
            )

    def load(self, path: Path) -> None:
        """Resume from a file; DataError if it is damaged, or of another search."""
        what = "what an earlier call with the same arguments wrote"
        arrays = read_npz(path, what, DataError)
        expected = {"identity", "evaluations", "waiting_level", "waiting_place", *Cells._fields}
        if set(arrays) != expected or not np.array_equal(arrays["identity"], self._identity()):
            raise DataError(f"{path}: holds something else, or the proof of another region; give another place")
        self.evaluations = int(arrays["evaluations"])
        types = (np.int8, np.int64, np.int8, np.float64)
        self._found = [
            Cells(*(arrays[name].astype(kind) for name, kind in zip(Cells._fields, types, strict=True)))
        ]
        volumes = np.array([self._cells.cell_volume(level) for level in range(self._cells.levels + 1)])
        self.settled = float(volumes[self._found[0].level].sum())
        levels, places = arrays["waiting_level"].astype(int), arrays["waiting_place"].astype(np.int64)
        self._waiting = [(int(level), places[levels == level]) for level in np.unique(levels)]

    def _identity(self) -> NDArray[np.uint8]:
        """Return what tells this search from every other."""
        from tensionlab import __version__

        digest = hashlib.sha256(__version__.encode())
        for each in _arrays((self._problem, self._cells)):
            digest.update(repr((each.dtype, each.shape)).encode())
            digest.update(np.ascontiguousarray(each).tobytes())
        return np.frombuffer(digest.digest(), np.uint8)


def run(
    search: CellSearch,
    evaluate: Callable[[Iterable[CellTask]], Iterable[tuple[CellTask, Verdicts]]],
    out: Path | None,
    report: Callable[[], None],
) -> None:
    """Search to the end; with a file, cells are written at intervals, and at the end."""
    written = time.perf_counter()
    while not search.finished:
        for task, verdicts in evaluate(search.tasks()):
            search.settle(task, verdicts)
            report()
            if out is not None and time.perf_counter() - written > SAVE_INTERVAL_S:
                search.save(out)
                written = time.perf_counter()
    if out is not None:
        search.save(out)


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    """Yield every number in a tuple or a dataclass, and in what it holds."""
    if is_dataclass(value):
        value = tuple(getattr(value, each.name) for each in fields(value))
    if isinstance(value, tuple):
        for each in value:
            yield from _arrays(each)
    else:
        yield np.asarray(np.nan if value is None else value)
