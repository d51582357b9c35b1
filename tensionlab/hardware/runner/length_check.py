"""Check that cable lengths belong together: a module whose length drifts must not move the pose unnoticed.

With more cables than unknowns, each length is compared with what the others say (`_native.LengthCheck`): the
estimate of its bias, averaged over 0.25 s, is in doubt where such a bias would change the rendered force by 0.5 N,
but not below 8 mm and always above 40 mm of residual. This is receiver autonomous integrity monitoring (RAIM), as
in satellite navigation: Parkinson and Axelrad 1988, "Autonomous GPS integrity monitoring using the pseudorange
residual", Navigation 35(2); Brown 1992, "A baseline GPS RAIM scheme and a note on the equivalence of three RAIM
methods", Navigation 39(3). The protection level is the largest change of the force by a bias that is not in doubt;
near singular poses it grows with the tensions, and the force is limited there.

Each length is also compared with its own speed, which needs no other cable.

What remains undetectable: without redundancy, a module whose length and speed drift together, or whose length
drifts by less than `MAX_CREEP_M` in 10 s; with it, two or more lengths that drift as a motion of the platform
would have them; and whatever was wrong before the run, as far as it fitted a pose.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.state_estimation import PoseTracker
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

CHECK_PERIOD_S = 0.02  # shortest time between two checks; faster runs leave cycles out
# Length that a cable's own speed may leave unexplained over 10 s; slack cables and late telemetry make 0.03.
MAX_CREEP_M = 0.06
MAX_PROTECTION_N = 0.55
"""Protection level at which the force is limited.

Away from singular poses it is 0.5 N at most. It is linear in the drift, and residuals are averaged: of 200
drifts near singular poses, three changed the force by more than 1 N, the largest by 1.05 N.
"""
# Modules whose residual is above this share of the largest are named: with one cable to spare, all of them.
SUSPECT_SHARE = 0.8
CALIBRATE = "Look at its spool and encoder, and calibrate its length (`tensionlab module calibrate lengths`)"


class LengthMonitor:
    """Monitor of the cable lengths of a run, which `note` is told of what it cannot check."""

    def __init__(self, rig: Rig, note: Callable[[str], None]) -> None:
        self._rig, self._note = rig, note
        self._native = _native.LengthCheck(rig.m)
        self._checked_at = -np.inf
        self._tracker: PoseTracker | None = None
        self._noted = False

    def check(
        self,
        tracker: PoseTracker,
        lengths: Floats,
        speeds: Floats,
        tensions: Floats,
        active: NDArray[np.bool_],
        now: float,
    ) -> None:
        """Refuse lengths (m,) in m at a time in s that the tracker has followed and that do not belong together.

        Speeds (m,) of paying out are in m/s and commanded tensions (m,) in N. A `HardwareError` names the modules
        that may be wrong.
        """
        seconds = now - self._checked_at
        if seconds < 0.999 * CHECK_PERIOD_S:
            return
        self._checked_at = now
        doubt, creep = tracker.check(self._native, lengths, speeds, tensions, active, seconds)
        if doubt > 1.0 or creep > MAX_CREEP_M:
            raise HardwareError(self._reason(doubt > 1.0))
        cables = int(np.count_nonzero(active))
        self._tracker = tracker if cables > self._rig.n else None
        if self._tracker is None:
            self._note_once(
                f"{cables} cables for {self._rig.n} unknowns do not check each other's lengths: a module that "
                "drifts, and reports a speed that agrees, is not noticed"
            )

    def must_limit(self, tensions: Floats) -> bool:
        """Return whether a drift that is not noticed could change the force of tensions (m,) in N by too much."""
        tracker = self._tracker
        return tracker is not None and tracker.protection(self._native, tensions) > MAX_PROTECTION_N

    def share(self, at_rest: Floats, tensions: Floats) -> float:
        """Return the largest share of the way from tensions at rest to tensions (m,) in N that drifts allow.

        Above 0.5 N the protection level is a convex function of the tensions, so it is at most `MAX_PROTECTION_N`
        there, if it is at rest.
        """
        assert self._tracker is not None
        self._note_once(
            "the pose is near a singular one, where a drifting length could change the force by more than 1 N "
            "before it is noticed: the force is limited there"
        )
        low, high = (self._tracker.protection(self._native, each) for each in (at_rest, tensions))
        return min((MAX_PROTECTION_N - low) / (high - low), 1.0) if low < min(MAX_PROTECTION_N, high) else 0.0

    @property
    def doubts(self) -> Floats:
        """Estimates of the lengths' biases over their thresholds, (m,); above 1 a run stops."""
        return self._native.doubts()[0]

    def _reason(self, inconsistent: bool) -> str:
        _, residuals, biases, creeps = self._native.doubts()
        names = [module.name for module in self._rig.modules]
        if not inconsistent:
            worst = int(np.argmax(np.abs(creeps)))
            return (
                f'the cable length of module "{names[worst]}" has drifted by {1e3 * creeps[worst]:+.0f} mm that '
                f"its speed does not explain. {CALIBRATE}"
            )
        suspects = np.flatnonzero(residuals >= SUSPECT_SHARE * residuals.max())
        said = ", or ".join(
            f'that of module "{names[index]}" is {1e3 * abs(biases[index]):.0f} mm too '
            f"{'long' if biases[index] > 0.0 else 'short'}"
            for index in suspects
        )
        return f"cable lengths have drifted apart: {said}. {CALIBRATE}"

    def _note_once(self, text: str) -> None:
        if not self._noted:
            self._noted = True
            self._note(text)
