"""What each route of the compiled kernels gains: ``python -m benchmarks.ablation``.

The extension is built for this processor, once whole and once without each route, in ``build/ablation/``, which
takes minutes. The table has the times of jobs of a user on one core, and how many times longer they take without a
route. Rounds of all builds are interleaved; of each job the least time of the processor counts.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.solver_speed import LOWER, UPPER, infeasible_wrenches, random_problems
from tensionlab.allocation import allocate
from tensionlab.model.files import load_rig
from tensionlab.support.operating_system import KERNEL_THREADS
from tensionlab.workspace import tension_factor
from tools.sanitize import PRELOADED, build

FOLDER = Path("build", "ablation").absolute()
# In the order of `Route` in include/tensionlab/simd/batch.hpp.
ROUTES = ("sweep", "guess", "separation in it", "nearest face", "proof in it", "null plane", "Gram-Schmidt")
SHAPES = ((3, 4), (3, 8), (6, 8))  # components and cables
PROBLEMS, POSES = 20_000, 4_000
CALLS = 5  # of a job in a round


def jobs() -> dict[str, tuple[Callable[[], object], int]]:
    """Return calls by name, and the number of problems or poses in each."""
    limits = LOWER, UPPER
    found: dict[str, tuple[Callable[[], object], int]] = {}
    for n, m in SHAPES:
        W, w = random_problems(n, m, PROBLEMS, seed=0)
        far = infeasible_wrenches(W, w, seed=0)
        found[f"{n} x {m}, feasible"] = partial(allocate, W, w, limits), PROBLEMS
        found[f"{n} x {m}, infeasible"] = partial(allocate, W, far, limits), PROBLEMS
    found["6 x 8, policy tension"] = partial(allocate, W, far, limits, policy="tension"), PROBLEMS
    found["6 x 8, closed-form"] = partial(allocate, W, w, limits, "closed-form"), PROBLEMS
    rig = load_rig("ipanema-1")
    position = rig.home + np.random.default_rng(0).uniform(-0.1, 0.1, (POSES, 3))
    found["ipanema-1, tension factor"] = partial(tension_factor, rig.structure_matrix(position)), POSES
    return found


def time_jobs() -> dict[str, float]:
    """Return the least time of each job, in s a problem or pose."""
    times = {}
    for name, (call, count) in jobs().items():
        call()
        spent = []
        for _ in range(CALLS):
            began = time.process_time()
            call()
            spent.append((time.process_time() - began) / count)
        times[name] = min(spent)
    return times


def time_build(folder: Path, library: Path) -> dict[str, float]:
    """Return the times of `time_jobs` in a process that loads this extension."""
    (folder / "sitecustomize.py").write_text(PRELOADED.format(library=str(library)))
    environment = os.environ | {"PYTHONPATH": str(folder), KERNEL_THREADS: "1"}
    words = [sys.executable, "-m", "benchmarks.ablation", "--times"]
    out = subprocess.run(words, check=True, capture_output=True, text=True, env=environment).stdout
    times: dict[str, float] = json.loads(out)
    return times


def main() -> None:
    """Build, measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--times", action="store_true", help="only print the times of the extension that is loaded"
    )
    options = parser.parse_args()
    if options.times:
        print(json.dumps(time_jobs()))
        return
    names = ("whole", *ROUTES)
    libraries = {}
    for number, name in enumerate(names):
        flags = "" if name == "whole" else f"-DTENSIONLAB_WITHOUT={1 << (number - 1)}"
        libraries[name] = build(flags, FOLDER / str(number), "Release")
    rounds = [
        {name: time_build(FOLDER / str(number), libraries[name]) for number, name in enumerate(names)}
        for _ in range(options.rounds)
    ]
    print(f"{'':28}{'µs':>7}  " + "  ".join(ROUTES))
    for job in rounds[0]["whole"]:
        best = {name: min(each[name][job] for each in rounds) for name in names}
        gains = "  ".join(f"{best[name] / best['whole']:{len(name)}.2f}" for name in ROUTES)
        print(f"{job:28}{1e6 * best['whole']:7.3f}  {gains}")


if __name__ == "__main__":
    main()
