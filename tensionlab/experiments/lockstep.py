"""How much faster than time do simulated modules run? ``python -m tensionlab.experiments.lockstep``."""

from __future__ import annotations

import sys
import time

from tensionlab.hardware.codes import Calibration, State
from tensionlab.hardware.protocol import Arm, Calibrate, SetTension
from tensionlab.hardware.simulated import STEP, SimulatedModule

MODULES, SESSION, RATE = 4, 1, 50.0
AT_LEAST = 50.0
"""Times real time that the project promises, on one core."""


def armed_module(number: int) -> SimulatedModule:
    """A module that is ready for set-points."""
    module = SimulatedModule(number, seed=number)
    module.advance(STEP)
    module.receive(Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0).frame(0).pack())
    module.receive(Arm(SESSION).frame(0).pack())
    return module


def times_real_time(count: int, seconds: float) -> float:
    """How much simulated time passes for all modules together in a second of one core?

    Each module is stepped at 4 kHz, gets set-points at 50 Hz, and the far end of its cable moves.

    Parameters
    ----------
    count : int
        Of modules.
    seconds : float
        How much simulated time to measure.

    Raises
    ------
    RuntimeError
        If a module did not run all the time.
    """
    modules = [armed_module(number) for number in range(1, count + 1)]
    start = time.thread_time()
    for turn in range(1, round(seconds * RATE) + 1):
        for module in modules:
            module.receive(SetTension(SESSION, 1.0 + turn % 3).frame(turn % 256).pack())
            module.advance(1.0 / RATE, 1.0 + 0.002 * (turn % 2))
            module.transmit()
    spent = time.thread_time() - start
    if any(module.sample.state is not State.RUNNING for module in modules):
        raise RuntimeError("a module stopped: that is no measurement")
    return seconds / spent


def main() -> int:
    """Print the best of five; 1 if it is less than promised."""
    best = max(times_real_time(MODULES, 4.0) for _ in range(5))
    print(f"{MODULES} modules at {1.0 / STEP:.0f} Hz on one core: {best:.0f} times real time")
    return int(best < AT_LEAST)


if __name__ == "__main__":
    sys.exit(main())
