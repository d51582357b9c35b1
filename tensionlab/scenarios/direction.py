"""Directions of the measured forces of a run: which are off the desired ones, and for what reason."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Status
from tensionlab.arrays import Floats
from tensionlab.haptics.rendering.assignment import MIN_COSINE
from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.protocol.codes import Limit

MIN_FORCE_N = 0.5
"""Smaller forces have no direction that matters."""
REVERSAL_S = 0.1
"""Time in which modules follow a force that turns round: 6 N at 60 N/s."""
REASONS = ("none desired", "delayed", "infeasible", "module limited", "unexplained")
"""Why a force may point elsewhere: no force above 0.5 N is desired, and the cables are only taut; it points where
it should have within the loop's delay and 0.1 s; it is certified infeasible; a module is at a limit of its own
(slew, speed, heat, a brake that opens). The first that applies counts."""
ALIGNED_CYCLE, WEAK_CYCLE = -1, -2
"""In place of a reason: the force is within 45 degrees, or weaker than 0.5 N."""


@dataclass(frozen=True)
class Directions:
    """Counts of the cycles of a run by the direction of their measured force.

    Attributes
    ----------
    cycles : int
        With a force above 0.5 N.
    within : int
        Those within 45 degrees of the desired one.
    reasons : dict of str to int
        The others, by `REASONS`.
    """

    cycles: int
    within: int
    reasons: dict[str, int]


def check_directions(run: Run) -> Directions:
    """Count the cycles, by direction, of a run whose rig holds a point."""
    found = direction_reasons(run)
    counts = {reason: int((found == number).sum()) for number, reason in enumerate(REASONS)}
    return Directions(int((found != WEAK_CYCLE).sum()), int((found == ALIGNED_CYCLE).sum()), counts)


def direction_reasons(run: Run) -> NDArray[np.int64]:
    """Return for each cycle an index of `REASONS`, `ALIGNED_CYCLE` or `WEAK_CYCLE`."""
    measured = measured_force(run)
    desired = np.nan_to_num(run.desired)
    tension_limits = [int(limit) for limit in (Limit.NONE, Limit.LOWER, Limit.UPPER)]
    found = np.full(len(run), REASONS.index("unexplained"))
    found[~np.isin(run.limiters, tension_limits).all(axis=1)] = REASONS.index("module limited")
    found[run.status == Status.NEAREST] = REASONS.index("infeasible")
    found[_delayed(run, measured, desired)] = REASONS.index("delayed")
    found[np.linalg.norm(desired, axis=1) <= MIN_FORCE_N] = REASONS.index("none desired")
    found[_aligned(measured, desired)] = ALIGNED_CYCLE
    found[np.linalg.norm(measured, axis=1) <= MIN_FORCE_N] = WEAK_CYCLE
    return found


def measured_force(run: Run) -> Floats:
    """Return the force of the tensions that the modules report, (K, n) in N."""
    force: Floats = np.einsum("knm,km->kn", run.structure, np.nan_to_num(run.measured))
    return force


def _aligned(measured: Floats, desired: Floats) -> NDArray[np.bool_]:
    """Return where the angle between two forces (K, n) is at most 45 degrees."""
    sizes = np.linalg.norm(measured, axis=1) * np.linalg.norm(desired, axis=1)
    return np.asarray((np.einsum("kn,kn->k", measured, desired) >= MIN_COSINE * sizes) & (sizes > 0.0))


def _delayed(run: Run, measured: Floats, desired: Floats) -> NDArray[np.bool_]:
    """Return where the force points as it should have shortly before."""
    delay = np.nanmax(run.delays, initial=0.0) + REVERSAL_S
    found = np.zeros(len(run), dtype=bool)
    for back in range(1, min(math.ceil(delay * run.setup.rate), len(run) - 1) + 1):
        found[back:] |= _aligned(measured[back:], desired[:-back])
    return found
