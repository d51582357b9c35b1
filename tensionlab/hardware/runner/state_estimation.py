"""State of the rig in each cycle: telemetry, delays of set-points, pose and velocity from the cables."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.demand import Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers


class Observation(NamedTuple):
    """Latest telemetry of all modules; fields as in `RigState`."""

    lengths: Floats
    speeds: Floats
    tensions: Floats
    ages: Floats
    states: Integers
    faults: Integers
    limiters: Integers
    brakes: Integers
    last_sequence: Integers
    thermal: Floats


def observe(group: ModuleGroup) -> Observation:
    """Return the latest telemetry that has come by now."""
    (lengths, speeds, tensions, ages, thermal), codes = group.observe()
    states, faults, limiters, brakes, last_sequence = codes
    return Observation(lengths, speeds, tensions, ages, states, faults, limiters, brakes, last_sequence, thermal)


SEQUENCE_NUMBERS = 256  # set-point numbers wrap around here
HISTORY_S = 5.0  # how far back times of set-points are kept


class SetPointDelays:
    """Ages of the set-points that modules report to follow, by the times at which they were sent.

    A number stands for many set-points at high rates. Which one it is follows from how many were sent since the
    last report; of the first one that is reported, the newest is taken. `rate` is set-points a second.
    """

    def __init__(self, count: int, rate: float) -> None:
        kept = SEQUENCE_NUMBERS * math.ceil(HISTORY_S * rate / SEQUENCE_NUMBERS)
        self._native = _native.SetPointDelays(count, kept)

    def send(self, sequences: Integers, now: float) -> None:
        """Note numbers (m,) of set-points that were sent at a time in s; -1 where none was."""
        self._native.send(sequences, now)

    def delays(self, last_sequence: Integers, now: float) -> tuple[Floats, Floats]:
        """Return how old the set-points are, in s, that modules report to follow by their numbers; -1: none yet.

        Returned twice (m,): NaN where a module has not reported to follow one of these, and with the time since
        the first was sent there.
        """
        return self._native.delays(last_sequence, now)


MAX_STEPS = 3  # newton steps a cycle: between two cycles a platform moves a few mm
MAX_SEARCH_STEPS = 30  # newton steps from home to wherever it is
# Lengths are extrapolated by their speeds for so long at most: a hand may have turned round by then.
MAX_EXTRAPOLATION_S = 0.1
STEP_TOLERANCE = 1e-4  # a step this short, in m and rad, ends the search: what is left is its square
MAX_SPEED_ERROR_M_S = 0.2  # root mean square of the speed errors above which a slack cable is being reeled in
# Root mean square of the length errors above which the lengths belong to no pose near the last one.
MAX_LENGTH_ERROR_M = 0.05


class PoseTracker:
    """Tracker of the platform from cycle to cycle by Gauss and Newton's method, from where it was.

    The derivative of the lengths is the structure matrix, ``-W'``. What fewer lengths than unknowns leave open
    stays as it was. `fits` is whether the latest lengths belong to the latest pose, within `MAX_LENGTH_ERROR_M`. A
    `HardwareError` where lengths do not fix the pose: modules are attached to bodies, or are too few.
    """

    def __init__(self, rig: Rig) -> None:
        why = None
        if rig.frames:
            why = f"modules are attached to {', '.join(rig.frames)}"
        elif rig.m < rig.n:
            why = f"{rig.m} cables do not fix {rig.n} unknowns"
        if why is not None:
            raise HardwareError(
                f'rig "{rig.name}": {why}, so cable lengths do not tell where it is; give a tracker, or --at'
            )
        self._rig = rig
        self.error = math.inf
        self.worst, self.off = 0, 0.0
        self._structure: Floats = rig.structure_matrix(rig.home)
        self._native = self._at_home()

    def search(self, lengths: Floats, known: NDArray[np.bool_]) -> tuple[Pose, Floats]:
        """Return the same as `follow`, from the rig's home."""
        self._native = self._at_home()
        return self.follow(lengths, known, MAX_SEARCH_STEPS)

    def follow(self, lengths: Floats, known: NDArray[np.bool_], steps: int = MAX_STEPS) -> tuple[Pose, Floats]:
        """Return the pose by the known ones of lengths (m,), and the structure matrix (n, m) there.

        If these lengths do not fit (see `fits`), it is the pose that fits best.
        """
        position, rotation, self._structure, squares, self.worst, self.off = self._native.follow(
            lengths, known, steps, STEP_TOLERANCE
        )
        self.error = math.sqrt(squares / max(int(np.count_nonzero(known)), 1))
        if self._rig.n == self._rig.dimension:
            return Pose(position), self._structure
        if self._rig.dimension == 2:
            return Pose(position, np.arctan2(rotation[1, 0], rotation[0, 0])), self._structure
        return Pose(position, rotation), self._structure

    @property
    def fits(self) -> bool:
        """Whether the latest lengths belong to the latest pose, within `MAX_LENGTH_ERROR_M`."""
        return bool(self.error <= MAX_LENGTH_ERROR_M)

    def moves_as_one(self, speeds: Floats, known: NDArray[np.bool_]) -> bool:
        """Return whether cables with these speeds of paying out can all be taut, at the latest pose."""
        errors = np.where(known, speeds + self._structure.T @ self.velocity(speeds, known), 0.0)
        return bool(errors @ errors <= MAX_SPEED_ERROR_M_S**2 * np.count_nonzero(known))

    def _at_home(self) -> _native.PoseTracker:
        rig = self._rig
        attachments = rig.attachments if rig.n > rig.dimension else np.zeros((0, rig.dimension))
        radii, axes = rig.pulleys or (np.zeros(0), np.zeros((0, rig.dimension)))
        return _native.PoseTracker(rig.anchors, attachments, rig.home, radii, axes)

    def check(
        self,
        check: _native.LengthCheck,
        lengths: Floats,
        speeds: Floats,
        tensions: Floats,
        known: NDArray[np.bool_],
        seconds: float,
    ) -> tuple[float, float]:
        """Return the largest doubt and creep in m of the lengths followed last."""
        return check.update(self._native, lengths, speeds, tensions, known, seconds)

    def protection(self, check: _native.LengthCheck, tensions: Floats) -> float:
        """Return the largest change in N of the force of tensions (m,) in N by a bias that is not in doubt."""
        return check.protection(self._native, tensions)

    def velocity(self, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
        """Return the same as the function `velocity`, at the latest pose."""
        return self._native.velocity(speeds, known)


def at_one_time(lengths: Floats, speeds: Floats, ages: Floats) -> Floats:
    """Return the lengths of cables now, by their lengths, speeds and ages, (m,) in m, m/s and s."""
    return _native.at_one_time(lengths, speeds, ages, MAX_EXTRAPOLATION_S)


def any_reaches(numbers: Floats, thresholds: Floats) -> bool:
    """Return whether any number (m,) is not below its threshold (m,); NaN is."""
    return _native.any_reaches(numbers, thresholds)


def velocity(structure: Floats, speeds: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return the twist (n,) that fits the cables' speeds of paying out best, ``-W' twist = speeds``.

    The shortest one, where they leave some of it open.
    """
    found = np.linalg.lstsq(structure.T * known[:, None], np.where(known, speeds, 0.0), rcond=1e-6)[0]
    return np.asarray(-found, dtype=np.float64)
