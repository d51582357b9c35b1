"""Write submissions to the leaderboard of solvers and baselines: ``python -m benchmarks.submit [NAME ...]``."""

from __future__ import annotations

import json
import platform
import sys
import warnings
from pathlib import Path

import numpy as np

import tensionlab as tl
from tensionlab.benchmark.baselines import BASELINES
from tensionlab.benchmark.entries import Driver, Entry, driver, entries
from tensionlab.benchmark.problem_sets import problem_of
from tensionlab.benchmark.speed import using_threads, without_collector
from tensionlab.solvers.base import Problem
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.support.operating_system import processor_name

FOLDER = Path(__file__).with_name("submissions")
OURS = ("newton", "dykstra", "closed-form", "least-sum", "minimax", "analytic-centre")
REPEATS = 5  # timed calls of each problem, of which the fastest counts
DISTRIBUTIONS = {
    "cvxpy:plain": "cvxpy",
    "proxqp": "proxsuite",
    "highs": "highspy",
}  # others have the solver's name


def about(entry: Entry) -> dict[str, object]:
    """Return what `submission.toml` says of an entry."""
    backend = entry.solver.removeprefix("qpsolvers:")
    distribution = "tensionlab" if entry.setting == "proved" else DISTRIBUTIONS.get(backend, backend)
    versions = provenance.manifest([])["versions"]
    return {
        "solver": entry.solver if entry.setting == "proved" else f"{entry.solver}, {entry.setting}",
        "version": versions.get(distribution) or versions[f"{distribution}-base"],
        "language": "Python",
        "authors": ["the tensionlab project"],
        "machine": f"{processor_name()}, {platform.system()} {platform.machine()}, one thread",
        "command": f"python -m benchmarks.submit {entry.solver}",
    }


def answers(runs: Driver, problem: Problem) -> tuple[Floats, Floats]:
    """Return the tensions of an entry for a track, and the times of its calls."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # backends warn of what the leaderboard measures
        tensions = np.array(runs.answers(problem).tensions)
        times = np.full(len(problem), np.inf)
        with without_collector():
            for _ in range(REPEATS):
                times = np.minimum(times, [runs.call(problem, row).call_s for row in range(len(problem))])
    return tensions, np.array([float(f"{time:.2e}") for time in times])


def main() -> None:
    """Write the folder of each entry; of a baseline, with its strictest useful settings."""
    chosen = {entry.solver: entry for entry in entries("all", sys.argv[1:] or [*OURS, *BASELINES])}
    for name, entry in chosen.items():
        folder = FOLDER / name.replace(":", "-")
        folder.mkdir(parents=True, exist_ok=True)
        runs = driver(entry)
        with using_threads(1):
            for track in tl.datasets.names("tracks"):
                (group,) = tl.datasets.load(track).groups
                tensions, times = answers(runs, problem_of(group, "force"))
                np.savez_compressed(folder / f"{Path(track).name}.npz", tensions=tensions, times_s=times)
        lines = [f"{key} = {json.dumps(value)}\n" for key, value in about(entry).items()]
        (folder / "submission.toml").write_text("".join(lines), encoding="utf-8")
        print(folder)


if __name__ == "__main__":
    main()
