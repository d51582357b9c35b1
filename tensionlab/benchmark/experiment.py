"""A benchmark from its plan to its results.

Numerical libraries read how many threads they may use when they are loaded: `tensionlab bench` sets one
before that (`ONE_THREAD`), while `run` measures with the threads that the process has.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from tensionlab.benchmark import results
from tensionlab.benchmark.entries import entries
from tensionlab.benchmark.evaluation import evaluate_set
from tensionlab.benchmark.problem_files import find_problem_set
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, checksum
from tensionlab.benchmark.speed import INSTRUCTION_SET, using_threads
from tensionlab.errors import InputError
from tensionlab.solvers import Solver, name_solvers
from tensionlab.support import provenance
from tensionlab.support.files import writing
from tensionlab.support.operating_system import ONE_THREAD


@dataclass(frozen=True)
class BenchmarkPlan:
    """Problem sets, entries and effort of a benchmark."""

    sets: tuple[str, ...]  # as in `find_problem_set`
    solvers: tuple[str | Solver, ...] | None = None  # as in `entries`
    count: int = 1000  # problems in each set
    seed: int = 0
    seconds: float = 3.0  # for an entry in each set, or else fewer problems
    repeats: int = 3  # timed calls of each problem

    def __post_init__(self) -> None:
        if not self.sets:
            raise InputError(f"no problem set is named; choose one of {', '.join(PROBLEM_SETS)}")
        if self.count < 1 or self.seed < 0:
            raise InputError(f"count {self.count} must be 1 or more, and seed {self.seed} not negative")
        for name in self.sets:
            find_problem_set(name, 1)
        entries("none", self.solvers)


def plan(
    sets: Sequence[str] | None = None,
    solvers: Sequence[str | Solver] | None = None,
    count: int | None = None,
    seed: int = 0,
    quick: bool = False,
) -> BenchmarkPlan:
    """Return the plan of a full benchmark, or of a quick one of two minutes."""
    names = tuple(PROBLEM_SETS) if sets is None else tuple(dict.fromkeys(sets))
    chosen = None if solvers is None else tuple(solvers) if name_solvers(solvers) else ()
    if quick:
        return BenchmarkPlan(names, chosen, 60 if count is None else count, seed, seconds=0.1, repeats=2)
    return BenchmarkPlan(names, chosen, 1000 if count is None else count, seed)


def run(
    solvers: Sequence[str | Solver] | None = None,
    sets: Sequence[str] | None = None,
    *,
    count: int | None = None,
    seed: int = 0,
    quick: bool = False,
    out: str | PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> results.Results:
    """Measure accuracy, speed and the worst case of solvers on sets of problems.

    Parameters
    ----------
    solvers : sequence of str or Solver, optional
        Names, as ``tensionlab solvers`` lists them, ``"module:Class"``, baselines, such as "daqp" or
        "qpsolvers:osqp", and instances; left out: all solvers and baselines by name.
    sets : sequence of str, optional
        Names, as ``tensionlab datasets problems`` has them, and paths, as
        `tensionlab.benchmark.problem_files.read_problem_set` reads; left out: all by name.
    count : int, optional
        Problems in each set; left out: 1000, or 60 if quick.
    seed : int
        Seed of the problems and their order.
    quick : bool
        Spend 0.1 s on each solver and set, instead of 3 s.
    out : path, optional
        Folder for the results; created if missing.
    progress : callable, optional
        Called with the share that is done.

    Raises
    ------
    InputError, UnknownSolver, PluginError, DataError
        Before any work: solvers, sets or numbers that cannot be used.
    MissingDependency
        If pyarrow (extra ``data``), which stores the results, is not installed.

    Examples
    --------
    >>> import tensionlab as tl
    >>> results = tl.benchmark.run([tl.solvers.Newton(), "closed-form"], ["edge"], count=12, quick=True)
    >>> results.rows[["label", "solved_1e6"]].values.tolist()
    [['newton', 1.0], ['closed-form', 1.0]]
    """
    what = plan(sets, solvers, count, seed, quick)
    return measure(what, None if out is None else Path(out), sys.orig_argv, progress or (lambda _: None))


def measure(
    what: BenchmarkPlan, folder: Path | None, call: Sequence[str], progress: Callable[[float], None]
) -> results.Results:
    """Run a benchmark, and write its results into the folder; ``call`` is the command line, for the manifest."""
    if folder is not None:
        writing.require_folder(folder, parents=True)
        writing.make_folder(folder)
    wall, processor = time.perf_counter(), time.process_time()
    rng = np.random.default_rng(what.seed)
    rows: list[dict[str, Any]] = []
    measurements: list[dict[str, Any]] = []
    sets = {}
    for done, name in enumerate(what.sets):

        def report(share: float, done: int = done) -> None:
            progress((done + share) / len(what.sets))

        problems = find_problem_set(name, what.count, what.seed)
        with using_threads(1), _stdout_to_stderr():
            chosen = entries(problems.reachable, what.solvers)
            evaluation = evaluate_set(problems, chosen, what.seconds, what.repeats, rng, report)
        rows += evaluation.rows
        measurements += evaluation.measurements
        sets[name] = {
            "title": problems.title,
            "reachable": problems.reachable,
            "groups": [[group.label, len(group.structure)] for group in problems.groups],
            "problems": len(problems),
            "verified": evaluation.verified,
            "checksum": checksum(problems),
        }
    names = None if what.solvers is None else list(name_solvers(what.solvers))
    manifest = provenance.manifest(call, what.seed)
    manifest["bench"] = {
        "sets": sets,
        "plan": {**vars(what), "sets": list(what.sets), "solvers": names},
        "instruction_set": INSTRUCTION_SET,
        "processor_share": (time.process_time() - processor) / (time.perf_counter() - wall),
        "threads": {name: os.environ.get(name) for name in ONE_THREAD},
    }
    columns = {
        name: np.concatenate([np.broadcast_to(part[name], len(part["problem"])) for part in measurements])
        for name in (measurements[0] if measurements else ())
    }
    table = provenance.data_frame(columns) if columns else None
    outcome = results.Results(provenance.data_frame(rows), manifest, table)
    if folder is not None:
        results.write(folder, outcome)
    return outcome


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Send what backends print to stderr: only results belong on stdout."""
    saved = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
