"""A benchmark from plan to results, in a process of its own (`main`) whose libraries use one thread.

Numerical libraries read how many threads they may use when they are loaded, and the calling process has loaded
them already. Only instances of solvers are measured in the calling process, because no other has them.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from tensionlab.benchmark import results, speed
from tensionlab.benchmark.entries import entries
from tensionlab.benchmark.evaluation import Repetitions, evaluate_set
from tensionlab.benchmark.problem_files import find_problem_set
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, checksum
from tensionlab.errors import InputError, TensionlabError
from tensionlab.solvers import Solver, name_solvers
from tensionlab.support import provenance
from tensionlab.support.files import writing
from tensionlab.support.operating_system import OWN_GROUP

# Environment of the benchmark's process. The batches on all cores set the first one themselves.
ONE_THREAD = {speed.THREADS: "1"} | {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "RAYON")
} | {"VECLIB_MAXIMUM_THREADS": "1"}  # fmt: skip
BATCH_SHARE = 0.15  # about this share of the time goes to the batches


@dataclass(frozen=True)
class BenchmarkPlan:
    """Problem sets, entries and effort of a benchmark.

    ``sets`` are as in `find_problem_set`, ``solvers`` as in `entries`; ``count`` problems in each set; ``seconds``
    for an entry in each set, or else fewer problems; ``repeats`` timed calls of each problem. ``batch``,
    ``rounds`` and ``calls`` are the problems in a batch, rounds, and single calls of `tensionlab.benchmark.speed`;
    without rounds they are left out.
    """

    sets: tuple[str, ...]
    solvers: tuple[str | Solver, ...] | None = None
    count: int = 1000
    seed: int = 0
    seconds: float = 3.0
    repeats: int = 3
    batch: int = 100_000
    rounds: int = 7
    calls: int = 5000

    def __post_init__(self) -> None:
        if not self.sets:
            raise InputError(f"no problem set is named; choose one of {', '.join(PROBLEM_SETS)}")
        for name in self.sets:
            find_problem_set(name, 1)
        if self.count < 1 or self.seed < 0 or not self.seconds > 0 or self.repeats < 1:
            raise InputError(
                f"count {self.count} and repeats {self.repeats} must be 1 or more, seconds {self.seconds} "
                f"above 0, and seed {self.seed} not negative"
            )
        entries("none", self.solvers)

    @property
    def record(self) -> dict[str, Any]:
        """The plan as JSON has it, with the names of solvers."""
        return {**vars(self), "solvers": None if self.solvers is None else list(name_solvers(self.solvers))}


def plan(
    sets: Sequence[str] | None = None,
    solvers: Sequence[str | Solver] | None = None,
    count: int | None = None,
    seed: int = 0,
    quick: bool = False,
) -> BenchmarkPlan:
    """Return the plan of a full benchmark, or of a quick one of two minutes.

    The batches are those of the exact solver, and are left out where some solvers are chosen.
    """
    names = tuple(PROBLEM_SETS) if sets is None else tuple(dict.fromkeys(sets))
    chosen = None if solvers is None else tuple(solvers) if name_solvers(solvers) else ()
    rounds = 0 if chosen is not None else 3 if quick else 7
    if quick:
        return BenchmarkPlan(names, chosen, count or 60, seed, 0.1, 2, batch=20_000, rounds=rounds, calls=1000)
    return BenchmarkPlan(names, chosen, count or 1000, seed, rounds=rounds)


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

    Names are measured in a process of its own, whose libraries use one thread; as soon as one solver is an
    instance, all are measured in this process, with the threads that it has.

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
        Spend 0.1 s on each solver and set, and not 3 s.
    out : path, optional
        Folder for the results; made if it is not there.
    progress : callable, optional
        Called with the share that is done.

    Raises
    ------
    InputError, UnknownSolver, PluginError, DataError
        Before any work: solvers, sets or numbers that cannot be used.
    MissingDependency
        If pyarrow (extra ``data``) is not installed, which results are kept with.

    Examples
    --------
    >>> import tensionlab as tl
    >>> results = tl.benchmark.run([tl.solvers.Newton(), "closed-form"], ["edge"], count=12, quick=True)
    >>> results.rows[["label", "solved_1e6"]].values.tolist()
    [['newton', 1.0], ['closed-form', 1.0]]
    """
    what = plan(sets, solvers, count, seed, quick)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary if out is None else out)
        measure(what, folder, sys.orig_argv, progress or (lambda _: None))
        return results.read(folder)


def measure(what: BenchmarkPlan, folder: Path, call: Sequence[str], progress: Callable[[float], None]) -> None:
    """Run a benchmark in a process of its own, and write its results into the folder.

    ``call`` is the command line, for the manifest. A plan with instances of solvers is measured in this process.
    """
    writing.require_folder(folder, parents=True)
    writing.make_folder(folder)
    if not all(isinstance(each, str) for each in what.solvers or ()):
        with speed.using_threads(1):
            measure_here(what, folder, call, progress)
        return
    order = json.dumps({"plan": what.record, "folder": str(folder), "call": list(call), "path": sys.path})
    command = [sys.executable, "-P", "-c", f"from {__name__} import main; main()", order]  # -P: as in `main`
    # In a group of its own, so that Ctrl-C ends this process, which ends that one, and neither shows where it was.
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | ONE_THREAD, **OWN_GROUP
    ) as process:
        assert process.stdout
        try:
            for line in process.stdout:
                message = json.loads(line)
                if isinstance(message, str):
                    raise TensionlabError(message)
                progress(message)
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        raise TensionlabError(
            f"the benchmark's process ended with status {process.returncode}; its messages are above"
        )


def measure_here(
    what: BenchmarkPlan, folder: Path, call: Sequence[str], progress: Callable[[float], None]
) -> None:
    """Run a benchmark in this process, and write results and manifest into the folder."""
    wall, processor = time.perf_counter(), time.process_time()
    effort, rng = Repetitions(what.seconds, what.repeats), np.random.default_rng(what.seed)
    rows: list[dict[str, Any]] = []
    measurements: list[dict[str, Any]] = []
    sets = {}
    share = (1.0 - BATCH_SHARE) / len(what.sets)
    for done, name in enumerate(what.sets):
        problems = find_problem_set(name, what.count, what.seed)
        evaluation = evaluate_set(
            problems,
            entries(problems.reachable, what.solvers),
            effort,
            rng,
            lambda part, done=done: progress(share * (done + part)),  # type: ignore[misc]
        )
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
    busy = (time.process_time() - processor) / (time.perf_counter() - wall)
    batches, calls = [], []
    if what.rounds:
        cases = list(itertools.product(speed.SHAPES, (True, False)))
        for done, (shape, reachable) in enumerate(cases, start=1):
            batches.append(speed.time_batches(*shape, reachable, what.batch, what.rounds, what.seed))
            progress(1.0 - BATCH_SHARE * (1.0 - 0.9 * done / len(cases)))
        calls = [row for shape in speed.CALL_SHAPES for row in speed.time_calls(*shape, what.calls, what.seed)]
        progress(1.0)
    manifest = provenance.manifest(call, what.seed)
    manifest["bench"] = {
        "sets": sets,
        "plan": what.record,
        "instruction_set": speed.INSTRUCTION_SET,
        "processor_share": busy,
        "threads": {name: os.environ.get(name) for name in ONE_THREAD},
        "batches": [dataclasses.asdict(row) for row in batches],
        "calls": [dataclasses.asdict(row) for row in calls],
    }
    columns = {
        name: np.concatenate([np.broadcast_to(part[name], len(part["problem"])) for part in measurements])
        for name in (measurements[0] if measurements else ())
    }
    joined = provenance.data_frame(columns) if columns else None
    results.write(folder, results.Results(provenance.data_frame(rows), manifest, joined))


def main() -> None:
    """Run the benchmark of the first argument; print each share done, or the message of an error, as JSON."""
    order = json.loads(sys.argv[1])
    sys.path += [each for each in order["path"] if each not in sys.path]  # last, so that no library is replaced
    what: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value for key, value in order["plan"].items()
    }
    # Backends print to stdout as well; only messages may reach the process that reads it.
    with os.fdopen(os.dup(1), "w") as messages:
        os.dup2(2, 1)

        def send(message: object) -> None:
            print(json.dumps(message), file=messages, flush=True)

        try:
            measure_here(BenchmarkPlan(**what), Path(order["folder"]), order["call"], send)
        except TensionlabError as error:
            send(str(error))
