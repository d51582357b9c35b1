"""Reel in slack cables before a run: nobody did while no run was on, and slack lengths tell no pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tensionlab.hardware.runner.clock import Clock
from tensionlab.hardware.runner.observation import Observation
from tensionlab.hardware.runner.pose_tracker import PoseTracker, at_one_time

CYCLES = 3
"""Lengths must fit a pose, and speeds a motion, for so many cycles before the run begins."""
AT_MOST_S = 4.0
"""How long slack cables may take to be reeled in, in s."""
AT_LEAST_S = 0.5
"""How long they take at least, in s, where any lengths fit a pose: no more cables than unknowns."""


def reel_in(
    tracker: PoseTracker,
    cycle: Callable[[], Observation],
    active: NDArray[np.bool_],
    clock: Clock,
    *,
    redundant: bool,
) -> None:
    """Have cycles go by until all cables are taut.

    Parameters
    ----------
    tracker : PoseTracker
        Knows the pose then.
    cycle : callable
        Waits for the next cycle, has the modules hold their cables taut, and returns how they are.
    active : (m,) array of bool
        Modules that take part; it may change meanwhile.
    clock : Clock
    redundant : bool
        Whether there are more cables than unknowns.

    Raises
    ------
    HardwareError
        If the lengths of taut cables fit no pose.
    """
    began, settled = clock.now(), 0
    while settled < CYCLES or (not redundant and clock.now() - began < AT_LEAST_S):
        seen = cycle()
        tracker.search(at_one_time(seen.lengths, seen.speeds, seen.ages), active)
        taut = tracker.fits and tracker.moves_as_one(seen.speeds, active)
        settled = settled + 1 if taut else 0
        if clock.now() - began > AT_MOST_S:
            tracker.require_fit(
                "all cables are taut, so calibrate the lengths (`tensionlab module calibrate lengths`), and "
                "start near the rig's home"
            )
            break  # only the speeds do not fit: a hand that shakes, behind links that are late
