"""Where is the platform, from cable lengths that come again and again?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import HardwareError
from tensionlab.hardware.cycle import Floats, Pose
from tensionlab.model import kinematics
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
        self._pose = Pose(rig.home, np.eye(rig.dimension) if rig.n > rig.dimension else None)  # always a matrix

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
        structure, missing = self._compare(lengths, known)
        for _ in range(STEPS):
            step = velocity(structure, missing, known)
            self._move(step)
            structure, missing = self._compare(lengths, known)
            if np.abs(step).max() < FOUND:
                break
        if missing @ missing > FAR**2 * known.sum():
            worst = int(np.argmax(np.abs(missing)))
            raise HardwareError(
                f'cable lengths fit no pose: that of module "{self._rig.modules[worst].name}" is off by '
                f"{1e3 * abs(missing[worst]):.0f} mm; calibrate the lengths, and start near the rig's home"
            )
        return self._public(), structure

    def _compare(self, lengths: Floats, known: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Structure matrix at the pose, and what its lengths are short of those measured; 0 where unknown."""
        cables = self._rig.cables(*self._public())
        structure = kinematics.structure_matrix(cables.directions, cables.arms)
        return structure, np.where(known, lengths - cables.lengths, 0.0)

    def _move(self, step: Floats) -> None:
        d = self._rig.dimension
        position, rotation = self._pose.position + step[:d], self._pose.rotation
        if rotation is not None:
            turn = step[d:]
            rotation = (kinematics.exponential(turn) if d == 3 else kinematics.planar_rotation(turn[0])) @ rotation
        self._pose = Pose(position, rotation)

    def _public(self) -> Pose:
        """The pose as `Rig` takes it: in the plane with an angle."""
        rotation = self._pose.rotation
        if rotation is not None and self._rig.dimension == 2:
            return Pose(self._pose.position, np.arctan2(rotation[1, 0], rotation[0, 0]))
        return self._pose


def velocity(structure: Floats, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
    """Which velocity (n,) fits the cables' speeds of paying out best? ``-W' twist = speeds``.

    The shortest one, where they leave some of it open.
    """
    found = np.linalg.lstsq(structure.T * known[:, None], np.where(known, speeds, 0.0), rcond=1e-6)[0]
    return np.asarray(-found, dtype=np.float64)
