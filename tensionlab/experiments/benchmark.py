"""How fast is the exact solver, against the fastest peer's own clock, in one run?"""

from __future__ import annotations

import os
import statistics
import time
from dataclasses import dataclass

import numpy as np

from tensionlab import _native
from tensionlab.allocation import allocate
from tensionlab.errors import MissingDependency
from tensionlab.solvers.contract import Floats, Status

LOWER, UPPER = 0.5, 6.0


@dataclass(frozen=True)
class SpeedRow:
    """Seconds a problem, proof included, beside the C time (set-up plus solve) that DAQP reports."""

    components: int
    cables: int
    batch_s: float
    daqp_s: float
    gap_max: float

    @property
    def ratio(self) -> float:
        """Batch time over DAQP's."""
        return self.batch_s / self.daqp_s


def random_problems(components: int, cables: int, count: int, seed: int) -> tuple[Floats, Floats]:
    """Random structure matrices (count, n, m) of unit cables, and wrenches (count, n) they can render."""
    rng = np.random.default_rng(seed)
    pulls = rng.normal(size=(count, 3, cables))
    pulls /= np.linalg.norm(pulls, axis=1, keepdims=True)
    arms = rng.normal(scale=0.3, size=(count, 3, cables))
    structure = pulls if components == 3 else np.concatenate([pulls, np.cross(arms, pulls, axis=1)], axis=1)
    tensions = rng.uniform(LOWER, UPPER, size=(count, cables))
    return structure, np.einsum("bnm,bm->bn", structure, tensions)


def against_daqp(components: int, cables: int, count: int = 100_000, rounds: int = 7, seed: int = 0) -> SpeedRow:
    """How long does a problem take in one large batch, and in DAQP's C code?

    Both are timed in turn, ``rounds`` times, and the medians compared. DAQP solves a new 1,000 of the
    problems in each round, one call each, and reports the time that its set-up and its solve took in C; its
    Python wrapper does not count. Ours is the wall time of one `allocate` call over all problems, proof included.

    Raises
    ------
    MissingDependency
        If DAQP is not installed.
    """
    try:
        import daqp
    except ImportError as error:
        raise MissingDependency("DAQP is not installed; pip install 'tensionlab[solvers]'") from error
    structure, wrench = random_problems(components, cables, count, seed)
    hessian, linear = np.eye(cables), np.zeros(cables)
    sense = np.array([0] * cables + [5] * components, dtype=np.int32)  # 5: an equality
    ours, theirs, gap = [], [], 0.0
    for turn in range(rounds):
        began = time.perf_counter()
        result = allocate(structure, wrench, (LOWER, UPPER))
        ours.append((time.perf_counter() - began) / count)
        assert (result.status == Status.EXACT).all()
        spent = []
        for row in range(turn * 1000, (turn + 1) * 1000):
            above = np.concatenate([np.full(cables, UPPER), wrench[row]])
            below = np.concatenate([np.full(cables, LOWER), wrench[row]])
            tensions, _, _, info = daqp.solve(hessian, linear, structure[row], above, below, sense)
            spent.append(info["setup_time"] + info["solve_time"])
            gap = max(gap, float(np.abs(tensions - result.tensions[row]).max()))
        theirs.append(statistics.median(spent))
    return SpeedRow(components, cables, statistics.median(ours), statistics.median(theirs), gap)


def main() -> None:
    """Print the table of README's section on speed."""
    threads = os.environ.get("TENSIONLAB_NUM_THREADS", "as many as the machine has; set it to 1 for a fair race")
    print(f"Instruction set: {_native.instruction_set()}; TENSIONLAB_NUM_THREADS: {threads}")
    print("  n   m   batch, µs   DAQP in C, µs   ratio   largest difference, N")
    for components, cables in ((3, 4), (3, 8), (3, 12), (6, 8)):
        row = against_daqp(components, cables)
        print(
            f"{components:3d} {cables:3d} {1e6 * row.batch_s:11.3f} {1e6 * row.daqp_s:15.3f} "
            f"{row.ratio:7.3f} {row.gap_max:23.1e}"
        )


if __name__ == "__main__":
    main()
