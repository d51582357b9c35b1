"""Pose of the platform from cable lengths, cycle after cycle, and slack cables reeled in before a run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.arrays import Floats
from tensionlab.demand import Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.observation import Observation
from tensionlab.hardware.runner.settings import Clock
from tensionlab.model.rig import Rig

STEPS = 3
"""Newton steps a cycle at most: between two cycles a platform moves a few mm."""
SEARCH_STEPS = 30
"""Newton steps from home to wherever it is."""
EXTRAPOLATED_S = 0.1
"""Lengths are carried on by their speeds for so long at most, in s: a hand may have turned round by then."""
FOUND = 1e-4
"""A step this short, in m and rad, ends the search: what is left is its square."""
TAUT_M_S = 0.2
"""Root mean square of the speed errors, in m/s, above which a slack cable is being reeled in."""
FAR = 0.05
"""Root mean square of the length errors, in m, above which the lengths belong to no pose near the last one."""


class PoseTracker:
    """Follows the platform from cycle to cycle by Gauss and Newton's method, from where it was.

    The derivative of the lengths is the structure matrix, ``-W'``. What fewer lengths than unknowns leave open
    stays as it was.

    Parameters
    ----------
    rig : Rig
        All its modules stand in the world.

    Attributes
    ----------
    fits : bool
        Whether the latest lengths belong to the latest pose, but for some cm.

    Raises
    ------
    HardwareError
        If modules ride on bodies, or there are fewer than unknowns: the lengths do not tell the pose.
    """

    def __init__(self, rig: Rig) -> None:
        why = None
        if rig.frames:
            why = f"modules ride on {', '.join(rig.frames)}"
        elif rig.m < rig.n:
            why = f"{rig.m} cables do not fix {rig.n} unknowns"
        if why is not None:
            raise HardwareError(
                f'rig "{rig.name}": {why}, so cable lengths do not tell where it is; give a tracker, or a place'
            )
        self._rig = rig
        self.fits = False
        self._worst, self._off = 0, 0.0
        self._structure: Floats = rig.structure_matrix(rig.home)
        self._native = self._at_home()

    def search(self, lengths: Floats, known: NDArray[np.bool_]) -> tuple[Pose, Floats]:
        """The same as `follow`, from the rig's home."""
        self._native = self._at_home()
        return self.follow(lengths, known, SEARCH_STEPS)

    def follow(self, lengths: Floats, known: NDArray[np.bool_], steps: int = STEPS) -> tuple[Pose, Floats]:
        """Where is it, by the lengths (m,) of those modules whose length is known?

        Returns
        -------
        Pose, (n, m) array
            And the structure matrix there. If these lengths do not fit (see `fits`), the pose that fits best.
        """
        position, rotation, self._structure, squares, self._worst, self._off = self._native.follow(
            lengths, known, steps, FOUND
        )
        self.fits = bool(squares <= FAR**2 * np.count_nonzero(known))
        if self._rig.n == self._rig.dimension:
            return Pose(position), self._structure
        if self._rig.dimension == 2:
            return Pose(position, np.arctan2(rotation[1, 0], rotation[0, 0])), self._structure
        return Pose(position, rotation), self._structure

    def require_fit(self, advice: str) -> None:
        """Refuse, by a `HardwareError` with this advice, lengths that fit no pose near the last one."""
        if not self.fits:
            raise HardwareError(
                f'cable lengths fit no pose: that of module "{self._rig.modules[self._worst].name}" is off by '
                f"{1e3 * self._off:.0f} mm, or another's is; {advice}"
            )

    def moves_as_one(self, speeds: Floats, known: NDArray[np.bool_]) -> bool:
        """Return whether cables with these speeds of paying out can all be taut, at the latest pose."""
        errors = np.where(known, speeds + self._structure.T @ self.velocity(speeds, known), 0.0)
        return bool(errors @ errors <= TAUT_M_S**2 * np.count_nonzero(known))

    def _at_home(self) -> _native.PoseTracker:
        rig = self._rig
        attachments = rig.attachments if rig.n > rig.dimension else np.zeros((0, rig.dimension))
        return _native.PoseTracker(rig.anchors, attachments, rig.home)

    def velocity(self, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
        """The same as the function `velocity`, at the latest pose."""
        return self._native.velocity(speeds, known)


def at_one_time(lengths: Floats, speeds: Floats, ages: Floats) -> Floats:
    """Return how long cables are now that were so long some time ago, (m,) in m, m/s and s."""
    return lengths + speeds * np.minimum(ages, EXTRAPOLATED_S)


def velocity(structure: Floats, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
    """Which velocity (n,) fits the cables' speeds of paying out best? ``-W' twist = speeds``.

    The shortest one, where they leave some of it open.
    """
    found = np.linalg.lstsq(structure.T * known[:, None], np.where(known, speeds, 0.0), rcond=1e-6)[0]
    return np.asarray(-found, dtype=np.float64)


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
