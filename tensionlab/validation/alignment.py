"""How is the force sensor turned? From a few forces, as they were to be and as it showed them.

The sensor's Z axis is mapped onto the devices' Y axis, which is up; what is left is estimated.
"""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From the sensor's axes, Z up, to the devices', Y up: a turn by -90 degrees about X."""


def yaw(desired: Floats, measured: Floats) -> Floats:
    """Which turn about the vertical fits best? The published way: a tilt of the sensor stays.

    The angle is atan2(sum(q_z p_x - q_x p_z), sum(q_x p_x + q_z p_z)), with q measured and p desired.

    Parameters
    ----------
    desired, measured : (K, 3) arrays
        Forces in N; the measured ones upright already.

    Returns
    -------
    (3, 3) array
        What turns measured forces.
    """
    p, q = desired, measured
    sine = np.sum(q[:, 2] * p[:, 0] - q[:, 0] * p[:, 2])
    cosine = np.sum(q[:, 0] * p[:, 0] + q[:, 2] * p[:, 2])
    size = np.hypot(sine, cosine)
    if size == 0.0:
        return np.eye(3)
    s, c = sine / size, cosine / size
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def kabsch(desired: Floats, measured: Floats) -> Floats:
    """Which rotation fits best? Kabsch 1976, Acta Crystallographica A32; Wahba's problem. Leaves no tilt.

    Parameters and return value as those of `yaw`.
    """
    u, _, vt = np.linalg.svd(desired.T @ measured)
    mirrored = np.linalg.det(u) * np.linalg.det(vt) < 0.0
    return np.asarray(u @ np.diag([1.0, 1.0, -1.0 if mirrored else 1.0]) @ vt)


def angle(rotation: Floats) -> float:
    """By how many degrees does a rotation turn?"""
    skew = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    return float(np.degrees(np.arctan2(np.linalg.norm(skew), np.trace(rotation) - 1.0)))


ALIGNMENTS = {"paper": yaw, "kabsch": kabsch}
"""The publication's, and the one that finds tilt as well."""
