"""Did a run pull where it was meant to, and where not, why?"""

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

WEAK = 0.5
"""Forces below have no direction that matters, in N."""
SETTLING = 0.1
"""How long modules take to follow a force that turns round, in s: 6 N at 60 N/s."""
REASONS = ("none intended", "late", "out of reach", "held back", "unexplained")
"""Why a force may point elsewhere: nothing, or less than 0.5 N, is meant to be felt, and the cables are only taut;
it points where it was meant to within the loop's delay and 0.1 s; it is proved out of reach; a module is at a
limit of its own (slew, speed, heat, a brake that opens). The first that applies counts."""


@dataclass(frozen=True)
class Directions:
    """How well did a run's forces point where they were meant to?

    Attributes
    ----------
    judged : int
        Cycles whose force, by what the modules say they pull with, exceeds 0.5 N.
    within : int
        Those within 45 degrees of the intended one.
    reasons : dict of str to int
        Why the others were not, by `REASONS`.
    """

    judged: int
    within: int
    reasons: dict[str, int]


def directions(run: Run) -> Directions:
    """Judge the force of each cycle of a run whose rig holds a point."""
    reasons = why(run)
    counts = {reason: int((reasons == number).sum()) for number, reason in enumerate(REASONS)}
    return Directions(int((reasons >= -1).sum()), int((reasons == -1).sum()), counts)


def why(run: Run) -> NDArray[np.int64]:
    """Why did the force of each cycle not point where it was meant to? An index of `REASONS`.

    -1: it did; -2: it was weaker than 0.5 N.
    """
    told = told_by(run)
    meant = np.nan_to_num(run.desired)
    limits = [int(limit) for limit in (Limit.NONE, Limit.LOWER, Limit.UPPER)]
    found = np.full(len(run), REASONS.index("unexplained"))
    found[~np.isin(run.limiters, limits).all(axis=1)] = REASONS.index("held back")
    found[run.status == Status.NEAREST] = REASONS.index("out of reach")
    found[_late(run, told, meant)] = REASONS.index("late")
    found[np.linalg.norm(meant, axis=1) <= WEAK] = REASONS.index("none intended")
    found[_near(told, meant)] = -1
    found[np.linalg.norm(told, axis=1) <= WEAK] = -2
    return found


def told_by(run: Run) -> Floats:
    """Which force is that by what the modules say they pull with, (K, n) in N?"""
    force: Floats = np.einsum("knm,km->kn", run.structure, np.nan_to_num(run.measured))
    return force


def _near(told: Floats, meant: Floats) -> NDArray[np.bool_]:
    """Where is the angle between two forces (K, n) at most 45 degrees?"""
    sizes = np.linalg.norm(told, axis=1) * np.linalg.norm(meant, axis=1)
    return np.asarray((np.einsum("kn,kn->k", told, meant) >= MIN_COSINE * sizes) & (sizes > 0.0))


def _late(run: Run, told: Floats, meant: Floats) -> NDArray[np.bool_]:
    """Where does the force point as it was meant to shortly before?"""
    delay = np.nanmax(run.delays, initial=0.0) + SETTLING
    found = np.zeros(len(run), dtype=bool)
    for back in range(1, min(math.ceil(delay * run.setup.rate), len(run) - 1) + 1):
        found[back:] |= _near(told[back:], meant[:-back])
    return found
