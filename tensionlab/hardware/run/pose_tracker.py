"""Where is the platform, from cable lengths that come again and again?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.demand import Floats, Pose
from tensionlab.errors import HardwareError
from tensionlab.model.rig import Rig

STEPS = 3
"""Newton steps a cycle at most: between two cycles a platform moves a few mm."""
FOUND = 1e-4
"""A step this short, in m and rad, ends the search: what is left is its square."""
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
        attachments = rig.attachments if rig.n > rig.dimension else np.zeros((0, rig.dimension))
        self._native = _native.PoseTracker(rig.anchors, attachments, rig.home)

    def follow(self, lengths: Floats, known: NDArray[np.bool_]) -> tuple[Pose, Floats]:
        """Where is it, by the lengths (m,) of those modules whose length is known?

        Returns
        -------
        Pose, (n, m) array
            And the structure matrix there.

        Raises
        ------
        HardwareError
            If no pose near the last one has these lengths.
        """
        found = self._native.follow(lengths, known, STEPS, FOUND)
        position, rotation, structure, squares, worst, off = found
        if not squares <= FAR**2 * np.count_nonzero(known):
            raise HardwareError(
                f'cable lengths fit no pose: that of module "{self._rig.modules[worst].name}" is off by '
                f"{1e3 * off:.0f} mm; calibrate the lengths, and start near the rig's home"
            )
        if self._rig.n == self._rig.dimension:
            return Pose(position), structure
        if self._rig.dimension == 2:
            return Pose(position, np.arctan2(rotation[1, 0], rotation[0, 0])), structure
        return Pose(position, rotation), structure

    def velocity(self, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
        """The same as the function `velocity`, at the latest pose."""
        return self._native.velocity(speeds, known)


def velocity(structure: Floats, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
    """Which velocity (n,) fits the cables' speeds of paying out best? ``-W' twist = speeds``.

    The shortest one, where they leave some of it open.
    """
    found = np.linalg.lstsq(structure.T * known[:, None], np.where(known, speeds, 0.0), rcond=1e-6)[0]
    return np.asarray(-found, dtype=np.float64)
