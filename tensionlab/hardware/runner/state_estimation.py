"""State of the rig in each cycle: telemetry, delays of set-points, pose and velocity by checked cable lengths."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.demand import Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers

Flags = NDArray[np.bool_]


class Observation(NamedTuple):
    """Latest telemetry of all modules; fields as in `RigState`."""

    lengths: Floats
    speeds: Floats
    tensions: Floats
    ages: Floats
    windings: Floats
    bearable: Floats
    states: Integers
    faults: Integers
    limiters: Integers
    brakes: Integers
    last_sequence: Integers


def observe(group: ModuleGroup) -> Observation:
    """Return the latest telemetry that has come by now."""
    measured, codes = group.observe()
    return Observation(*measured, *codes)


MAX_STEPS = 3  # Newton steps per cycle: between two cycles a platform moves a few mm
MAX_SEARCH_STEPS = 30  # Newton steps from home to any pose
MAX_EXTRAPOLATION_S = 0.1  # longest extrapolation of lengths by their speeds: a hand may have turned round by then
STEP_TOLERANCE = 1e-4  # a step this short, in m and rad, ends the search: the remaining error is its square
MAX_SPEED_ERROR_M_S = 0.2  # rms of the speed errors above which a slack cable is being taken up
MAX_LENGTH_ERROR_M = 0.05  # rms of the length errors above which the lengths belong to no pose near the last one


class PoseTracker:
    """Tracker of the platform from cycle to cycle by the Gauss-Newton method, starting where it was.

    The derivative of the lengths is ``-W'``, by the structure matrix. What fewer lengths than unknowns leave open
    stays as it was. `error` is the root mean square of the latest length errors in m; `worst` is the module with
    the largest, `off`. A `HardwareError` refuses rigs whose lengths do not fix the pose.
    """

    def __init__(self, rig: Rig) -> None:
        if rig.frames or rig.m < rig.n:
            why = f"{rig.m} cables do not fix {rig.n} unknowns"
            if rig.frames:
                why = f"modules are attached to {', '.join(rig.frames)}"
            advice = "cable lengths do not tell where it is; give a tracker, or --at"
            raise HardwareError(f'rig "{rig.name}": {why}, so {advice}')
        self._rig = rig
        self.error, self.worst, self.off = math.inf, 0, 0.0
        self._structure: Floats = rig.structure_matrix(rig.home)
        self.native = self._at_home()

    def _at_home(self) -> _native.PoseTracker:
        rig = self._rig
        attachments = rig.attachments @ rig.home_matrix.T  # the tracker starts with the identity
        attachments = attachments if rig.n > rig.dimension else np.zeros((0, rig.dimension))
        radii, axes = rig.pulleys or (np.zeros(0), np.zeros((0, rig.dimension)))
        return _native.PoseTracker(rig.anchors, attachments, rig.home, radii, axes)

    def search(self, lengths: Floats, known: Flags) -> tuple[Pose, Floats]:
        """Return the same as `follow`, starting from the rig's home."""
        self.native = self._at_home()
        return self.follow(lengths, known, MAX_SEARCH_STEPS)

    def follow(self, lengths: Floats, known: Flags, steps: int = MAX_STEPS) -> tuple[Pose, Floats]:
        """Return the pose that fits the known ones of lengths (m,) best, and the structure matrix (n, m) there."""
        position, rotation, self._structure, squares, self.worst, self.off = self.native.follow(
            lengths, known, steps, STEP_TOLERANCE
        )
        self.error = math.sqrt(squares / max(int(np.count_nonzero(known)), 1))
        if self._rig.n == self._rig.dimension:
            return Pose(position), self._structure
        rotation = rotation @ self._rig.home_matrix
        if self._rig.dimension == 2:
            rotation = np.arctan2(rotation[1, 0], rotation[0, 0])
        return Pose(position, rotation), self._structure

    @property
    def fits(self) -> bool:
        """Whether the latest lengths belong to the latest pose, within `MAX_LENGTH_ERROR_M`."""
        return bool(self.error <= MAX_LENGTH_ERROR_M)

    def moves_as_one(self, speeds: Floats, known: Flags) -> bool:
        """Return whether cables with these speeds of paying out can all be taut, at the latest pose."""
        errors = np.where(known, speeds + self._structure.T @ self.native.velocity(speeds, known), 0.0)
        return bool(errors @ errors <= MAX_SPEED_ERROR_M_S**2 * np.count_nonzero(known))


def synchronise(lengths: Floats, speeds: Floats, ages: Floats) -> Floats:
    """Return the lengths of cables now, by their lengths, speeds and ages, (m,) in m, m/s and s."""
    return _native.synchronise(lengths, speeds, ages, MAX_EXTRAPOLATION_S)


def velocity(structure: Floats, speeds: Floats, known: Flags) -> Floats:
    """Return the shortest twist (n,) that fits the cables' speeds of paying out best, ``-W' twist = speeds``."""
    opposite = np.linalg.lstsq(structure.T * known[:, None], np.where(known, speeds, 0.0), rcond=1e-6)[0]
    return np.asarray(-opposite, dtype=np.float64)


CHECK_PERIOD_S = 0.02  # shortest time between two checks of lengths; faster runs leave cycles out
# Length that a cable's own speed may leave unexplained over 10 s; slack cables and late telemetry make 0.03.
MAX_CREEP_M = 0.06
# Protection level at which the force is limited. Away from singular poses it is 0.5 N at most. It is linear in the
# drift, and residuals are averaged: of 200 drifts near singular poses, three changed the force by more than 1 N,
# the largest by 1.05 N.
MAX_PROTECTION_N = 0.55
# Modules whose residual is above this share of the largest are named: with one cable to spare, all of them.
SUSPECT_SHARE = 0.8
CALIBRATE = "Look at its spool and encoder, and calibrate its length (`tensionlab module calibrate lengths`)"


class LengthMonitor:
    """Monitor of the cable lengths of a run: a length that drifts must not move the pose unnoticed.

    With more cables than unknowns, each length is compared with what the others say (`_native.LengthCheck`): the
    estimate of its bias, averaged over 0.25 s, is in doubt where such a bias would change the rendered force by
    0.5 N, but not below 8 mm and always above 40 mm of residual. This is receiver autonomous integrity monitoring
    (RAIM): Parkinson and Axelrad 1988, Navigation 35(2); Brown 1992, Navigation 39(3). The protection level is the
    largest change of the force by a bias that is not in doubt; near singular poses it grows with the tensions, and
    the force is limited there. Each length is also compared with its own speed, which needs no other cable.

    What remains undetectable: without redundancy, a module whose length and speed drift together, or whose length
    drifts by less than `MAX_CREEP_M` in 10 s; with it, lengths that drift as a motion of the platform would have
    them; and errors from before the run, as far as they fitted a pose. `note` is called once with the text of an
    event that says what is not checked.
    """

    def __init__(self, rig: Rig, note: Callable[[str], None]) -> None:
        self._rig, self._note = rig, note
        self._native = _native.LengthCheck(rig.m)
        self._checked_at = -np.inf
        self._tracker: PoseTracker | None = None  # where lengths check each other
        self._noted = False

    def check(
        self, tracker: PoseTracker, lengths: Floats, speeds: Floats, tensions: Floats, active: Flags, now: float
    ) -> None:
        """Refuse lengths (m,) in m at a time in s that the tracker has followed and that do not belong together.

        Speeds (m,) of paying out are in m/s and commanded tensions (m,) in N. A `HardwareError` names the modules
        that may be wrong.
        """
        seconds = now - self._checked_at
        if seconds < 0.999 * CHECK_PERIOD_S:
            return
        self._checked_at = now
        doubt, creep = self._native.update(tracker.native, lengths, speeds, tensions, active, seconds)
        if doubt > 1.0 or creep > MAX_CREEP_M:
            raise HardwareError(f"{self._drifted() if doubt > 1.0 else self._crept()}. {CALIBRATE}")
        cables = int(np.count_nonzero(active))
        self._tracker = tracker if cables > self._rig.n else None
        if self._tracker is None:
            self._note_once(
                f"{cables} cables for {self._rig.n} unknowns do not check each other's lengths: a module that "
                "drifts, and reports a speed that agrees, is not noticed"
            )

    def must_limit(self, tensions: Floats) -> bool:
        """Return whether an unnoticed drift could change the force of tensions (m,) in N by too much."""
        return self._tracker is not None and self._protection(tensions) > MAX_PROTECTION_N

    def share(self, at_rest: Floats, tensions: Floats) -> float:
        """Return the largest share of the way from tensions at rest to tensions (m,) in N that drifts allow.

        Above 0.5 N the protection level is a convex function of the tensions, so it is at most `MAX_PROTECTION_N`
        there, if it is at rest.
        """
        self._note_once(
            "the pose is near a singular one, where a drifting length could change the force by more than 1 N "
            "before it is noticed: the force is limited there"
        )
        low, high = self._protection(at_rest), self._protection(tensions)
        return min((MAX_PROTECTION_N - low) / (high - low), 1.0) if low < min(MAX_PROTECTION_N, high) else 0.0

    def _protection(self, tensions: Floats) -> float:
        assert self._tracker is not None
        return self._native.protection(self._tracker.native, tensions)

    def _crept(self) -> str:
        creeps = self._native.doubts()[3]
        worst = int(np.argmax(np.abs(creeps)))
        name, millimetres = self._rig.modules[worst].name, 1e3 * creeps[worst]
        drift = f"has drifted by {millimetres:+.0f} mm that its speed does not explain"
        return f'the cable length of module "{name}" {drift}'

    def _drifted(self) -> str:
        _, residuals, biases, _ = self._native.doubts()
        suspects = [
            f'that of module "{module.name}" is {1e3 * abs(bias):.0f} mm too {"long" if bias > 0.0 else "short"}'
            for module, residual, bias in zip(self._rig.modules, residuals, biases, strict=True)
            if residual >= SUSPECT_SHARE * residuals.max()
        ]
        return f"cable lengths have drifted apart: {', or '.join(suspects)}"

    def _note_once(self, text: str) -> None:
        if not self._noted:
            self._noted = True
            self._note(text)
