"""How long does one call for one problem take, and how evenly, beside qpsolvers on the same problems?

`python -m tensionlab.benchmark.calls` prints it.
"""

from __future__ import annotations

import gc
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab.allocation import Allocator, allocate
from tensionlab.arrays import Floats
from tensionlab.benchmark import daqp_direct
from tensionlab.benchmark.batches import LOWER, UPPER, daqp_loop, random_problems
from tensionlab.benchmark.statistics import quantile
from tensionlab.solvers.quadratic import solve_qp

BLOCK = 20
"""Single calls in a row before the next caller's turn."""
PASSES = 3
"""Times that each caller gets each single problem."""


@dataclass(frozen=True)
class CallRow:
    """Seconds of one call for one problem.

    ``median_s`` and ``p999_s`` have the machine's interruptions in them, ``quiet_p999_s`` has few: it is the
    99.9 % quantile of each problem's best time of `PASSES`.
    """

    components: int
    cables: int
    caller: str
    median_s: float
    p999_s: float
    quiet_p999_s: float


def single_calls(components: int, cables: int, calls: int = 5000, seed: int = 0) -> list[CallRow]:
    """How long does one call take, for a control loop or a script, against qpsolvers on the same problems?

    Callers take turns of `BLOCK` calls, in a new random order each time, after one that is not timed; each
    problem comes up in `PASSES` passes.
    """
    structure, wrench = random_problems(components, cables, calls, seed)
    lower, upper = np.full(cables, LOWER), np.full(cables, UPPER)
    prepared = Allocator((lower, upper))
    callers: dict[str, Callable[[int], Any]] = {
        "tl.Allocator": lambda row: prepared(structure[row], wrench[row]),
        "tl.allocate": lambda row: allocate(structure[row], wrench[row], (lower, upper)),
    }
    if daqp_direct.installed():
        callers["daqp.solve"] = _one_daqp_call(structure, wrench)
        callers['qpsolvers.solve_qp(solver="daqp")'] = lambda row: solve_qp(
            structure[row], wrench[row], lower, upper, "daqp"
        )
    names, rng = list(callers), np.random.default_rng(seed)
    spent = {name: np.empty((PASSES, calls)) for name in names}
    gc.collect()
    gc.disable()
    try:
        for taken, first in itertools.product(range(PASSES), range(0, calls, BLOCK)):
            for name in rng.permutation(names):
                call, times = callers[name], spent[name][taken]
                call(first)
                for row in range(first, min(first + BLOCK, calls)):
                    began = time.perf_counter()
                    call(row)
                    times[row] = time.perf_counter() - began
    finally:
        gc.enable()
    return [
        CallRow(components, cables, name, quantile(each, 0.5), quantile(each, 0.999), quantile(each.min(0), 0.999))
        for name, each in spent.items()
    ]


def _one_daqp_call(structure: Floats, wrench: Floats) -> Callable[[int], Any]:
    loop = daqp_loop(structure, wrench)
    return lambda row: loop((row,))


def main() -> None:
    """Print the table."""
    print("One call, µs                               median   p99.9   p99.9 / median   uninterrupted")
    for components, cables in ((3, 8), (6, 8)):
        for call in single_calls(components, cables):
            print(
                f"n = {components}, m = {cables}  {call.caller:32s} {1e6 * call.median_s:7.1f} "
                f"{1e6 * call.p999_s:7.1f} {call.p999_s / call.median_s:16.1f} "
                f"{call.quiet_p999_s / call.median_s:15.1f}"
            )


if __name__ == "__main__":
    main()
