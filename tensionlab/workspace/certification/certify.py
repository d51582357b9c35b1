"""Proof of where a rig renders what is required: `certify`, a search that can be resumed."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import DataError, InputError, WriteError
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import as_requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.files import writing
from tensionlab.support.files.tables import read_npz
from tensionlab.workspace.certification.problem import (
    CellProblem,
    Required,
    Verdicts,
    cell_problem,
    clearance_problem,
)
from tensionlab.workspace.certification.result import CertifiedWorkspace, Subdivision, subdivide
from tensionlab.workspace.interference import Capsule
from tensionlab.workspace.sweep.executors import evaluate_on_cluster

SUFFIX = ".npz"  # file of a proof
CHUNK_CELLS = 16_384  # cells of a task, which then takes a fraction of a second
MAX_CELLS = 50_000_000  # cells of a level that fit in memory
SAVE_INTERVAL_S = 10.0  # time between two writes of the cells


def certify(
    rig: Rig,
    region: ArrayLike,
    required: Required = None,
    resolution: ArrayLike = 0.05,
    *,
    rotations: ArrayLike | None = None,
    angle: float = 0.0,
    clearance: float | None = None,
    bodies: Sequence[Capsule] = (),
    frames: Frames | None = None,
    out: str | PathLike[str] | None = None,
    scheduler: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> CertifiedWorkspace:
    """Prove where in a region every pose of a rig renders all that is required, and where none does.

    Cells of positions are proved as a whole, or cut in two along all axes, down to the resolution. A cell is
    inside if the tensions pull further than is required in all directions; that is proved of those normal to the
    facets of the available wrench set, as they turn with the pose. It is outside if they do not in one. Of the
    undecided cells, which lie along the border, a share is proved as well, so that the bounds of the volume come
    together as the square of the resolution. Rounding is part of every bound.

    Source: Gouttefarde, Daney and Merlet, "Interval-analysis-based determination of the wrench-feasible workspace
    of parallel cable-driven robots", 2011, for the proof of cells; Bouchard, Gosselin and Moore, "On the ability
    of a cable-driven robot to generate a prescribed set of wrenches", 2010, for the facets. That these may turn is
    shown in ``tensionlab/native/workspace/cell_proof.hpp``.

    InputError, ShapeError or RigError if an argument does not suit the rig, or there are more cells than fit in
    memory; DataError or WriteError if the file holds something else, or cannot be written.

    Parameters
    ----------
    rig : Rig
        Rig whose poses are examined.
    region : (d, 2) array
        Box of positions: where it starts and ends along each axis, in m. It may have no extent along an axis.
    required : Requirement, array, tuple, "wrench-closure" or None
        What the cables must exert at every pose: a wrench, the vertices (k, n) of a set, a ball
        ``(centre, radius)``, or a `tensionlab.Requirement`. "wrench-closure" is that some tensions balance each
        other, whatever the limits. None is `Rig.required`.
    resolution : float, or one for each axis
        Longest edge of the finest cells, in m.
    rotations : array, optional
        Orientations, one or several in a row, as in `Rig.structure_matrix`: a position is inside if it is so in
        all of them, outside if in one. Left out: the identity.
    angle : float
        Angle in rad about each of the rotations, all within which count as well.
    clearance : float, optional
        Distance in m that cables must keep from each other, but for those that share an end, and from the bodies.
        Its part of the border is bounded to first order only.
    bodies : sequence of Capsule
        Bodies in the world, as in `body_distance`.
    frames : mapping of name to Frame or (position, rotation), optional
        Poses of the rig's body frames, one for each.
    out : path, optional
        A file NAME.npz, to which cells are written every ten seconds. Called again, an interrupted proof is
        resumed from there, and a finished one is only read.
    scheduler : str, optional
        Address of a Dask scheduler, as in `tensionlab.sweep`; else the processors of this machine do the work.
    progress : callable, optional
        Called with the share of the region that is settled, from 0 to 1.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> region = [[-0.4, 0.4], [0.0, 1.6], [-0.4, 0.4]]
    >>> proved = tl.workspace.certify(rig, region, ([0.0, 0.0, 0.0], 1.0), 0.02)
    >>> print(f"1 N in every direction in {proved.volume.lower:.3f} to {proved.volume.upper:.3f} m³")
    1 N in every direction in 0.095 to 0.097 m³
    """
    problem = cell_problem(rig, required, rotations, angle, frames, clearance_problem(rig, clearance, bodies))
    cells = subdivide(region, resolution, rig.dimension)
    search = CellSearch(problem, cells)
    file = None if out is None else Path(out)
    if file is not None:
        if file.suffix.lower() != SUFFIX:
            raise WriteError(f"{file}: unsupported format; it must end in {SUFFIX}")
        if file.exists():
            search.load(file)
        writing.require_writable(file)
    written = time.perf_counter()
    while search.waiting:
        tasks = search.tasks()
        here = ((task, task.evaluate()) for task in tasks)
        for task, verdicts in here if scheduler is None else evaluate_on_cluster(scheduler, tasks):
            search.settle(task, verdicts)
            if progress is not None:
                progress(search.settled / cells.volume)
            if file is not None and time.perf_counter() - written > SAVE_INTERVAL_S:
                search.save(file)
                written = time.perf_counter()
    if file is not None:
        search.save(file)
    if isinstance(required, str):
        words = "wrench closure"
    else:
        words = (rig.required if required is None else as_requirement(required)).describe(rig)
    if clearance is not None:
        words += f", cables {clearance:g} m apart"
    return CertifiedWorkspace(rig, problem.anchors[0], words, cells, *search.found(), search.evaluations)


class Cells(NamedTuple):
    """Finished cells, as in `CertifiedWorkspace`."""

    level: NDArray[np.int8]
    place: Integers
    verdict: NDArray[np.int8]
    shares: Floats


class CellTask(NamedTuple):
    """Cells of one level (k, d), and the statement to prove of them."""

    problem: CellProblem
    cells: Subdivision
    level: int
    places: Integers

    def evaluate(self) -> Verdicts:
        """Prove what is inside and outside."""
        centres = self.cells.centres(self.level, self.places)
        return self.problem.prove(centres, self.cells.edges(self.level) / 2, self.level == self.cells.levels)


class CellSearch:
    """Finished cells of a region, and those that wait to be examined: a level and places each."""

    def __init__(self, problem: CellProblem, cells: Subdivision) -> None:
        self.evaluations = 0
        self.settled = 0.0  # volume
        self._problem, self._cells = problem, cells
        self._found: list[Cells] = []
        self.waiting: list[tuple[int, Integers]] = [(0, cells.first())]

    def tasks(self) -> Iterator[CellTask]:
        """Yield the tasks of the coarsest level that has any; `settle` each before the next level."""
        level = min(level for level, _ in self.waiting)
        places = np.concatenate([each for own, each in self.waiting if own == level])
        if len(places) > MAX_CELLS:
            raise InputError(
                f"resolution: {len(places):,} cells are undecided at {self._cells.edges(level).max():.2g} m; give "
                "a longer one, or a smaller region"
            )
        chunks = [(level, places[start : start + CHUNK_CELLS]) for start in range(0, len(places), CHUNK_CELLS)]
        self.waiting = [each for each in self.waiting if each[0] != level] + chunks
        for _, chunk in chunks:
            yield CellTask(self._problem, self._cells, level, chunk)

    def settle(self, task: CellTask, verdicts: Verdicts) -> None:
        """Store the verdicts of a task; undecided cells are divided, and examined later."""
        self.waiting = [each for each in self.waiting if each[1] is not task.places]
        self.evaluations += len(task.places)
        open_cells = (verdicts.verdict == 0) & (task.level < self._cells.levels)
        done = ~open_cells
        level = np.full(int(done.sum()), task.level, np.int8)
        self._found.append(Cells(level, task.places[done], verdicts.verdict[done], verdicts.shares[done]))
        self.settled += len(level) * float(self._cells.cell_volume(task.level))
        if open_cells.any():
            self.waiting.append((task.level + 1, self._cells.children(task.places[open_cells])))

    def found(self) -> Cells:
        """Return the finished cells."""
        return Cells(*(np.concatenate(each) for each in zip(*self._found, strict=True)))

    def save(self, path: Path) -> None:
        """Write finished and remaining cells to a file that `load` reads."""
        nowhere = np.zeros((0, self._cells.dimension), np.int64)
        none = np.zeros(0, np.int8)
        self._found.insert(0, Cells(none, nowhere, none, np.zeros((0, 2))))
        self._found = [self.found()]
        with writing.replacing(path) as file:
            np.savez_compressed(
                file,
                identity=self._identity(),
                evaluations=self.evaluations,
                waiting_level=np.concatenate([none, *(np.full(len(each), level) for level, each in self.waiting)]),
                waiting_place=np.concatenate([nowhere, *(each for _, each in self.waiting)]),
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
        self.settled = float(self._cells.cell_volume(self._found[0].level).sum())
        levels, places = arrays["waiting_level"].astype(int), arrays["waiting_place"].astype(np.int64)
        self.waiting = [(int(level), places[levels == level]) for level in np.unique(levels)]

    def _identity(self) -> NDArray[np.uint8]:
        """Return a digest of the statement and the cells."""
        from tensionlab import __version__

        *statement, clearance = self._problem
        digest = hashlib.sha256(__version__.encode())
        for array in map(np.asarray, (*statement, *(clearance or ()), *self._cells)):
            digest.update(repr((array.dtype, array.shape)).encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return np.frombuffer(digest.digest(), np.uint8)
