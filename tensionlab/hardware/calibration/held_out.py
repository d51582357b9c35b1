"""Do calibrated anchors explain lengths that they were not fitted to?"""

from __future__ import annotations

import math

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.anchors import calibrate_anchors
from tensionlab.hardware.calibration.poses import Poses
from tensionlab.hardware.calibration.problem import Problem
from tensionlab.model.rig import Rig

FOLDS = 5


def nominal_misfit(rig: Rig, lengths: Floats, poses: Poses, *, known: bool) -> float:
    """How far off are lengths from those of the nominal rig, in m? As `Problem.misfit`."""
    return Problem(rig, lengths, known, False).misfit(rig.anchors.ravel(), poses)


def held_out_misfit(rig: Rig, lengths: Floats, poses: Poses, *, known: bool, offsets: bool) -> float:
    """How far off are lengths from those of a rig that was calibrated without them, in m?

    Cross-validation: each fifth of the poses is left out once. NaN where the rest is too little to calibrate with.
    Arguments as those of `calibrate_anchors`.
    """
    squares = []
    for fold in range(FOLDS):
        out = np.arange(len(lengths)) % FOLDS == fold
        try:
            found = calibrate_anchors(
                rig, lengths[~out], poses.take(np.flatnonzero(~out)), known=known, offsets=offsets
            )
        except CalibrationError:
            return math.nan
        shared = np.concatenate([found.anchors.ravel(), found.offsets if offsets else []])
        left = Problem(rig, lengths[out], known, offsets)
        squares.append(left.misfit(shared, poses.take(np.flatnonzero(out))) ** 2 * int(out.sum()))
    return math.sqrt(sum(squares) / len(lengths))
