"""Clearance of the cables of a run from the bodies of its rig: distances, events, and tension limits that fall."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensionlab.demand import Impedance, Pose
from tensionlab.hardware.runner.body_boxes import BodyBoxes
from tensionlab.hardware.runner.guard import STEP_N
from tensionlab.hardware.runner.records import Approach
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

HYSTERESIS_M = 0.01  # distance beyond its margin from which on a body may be approached anew


class BodyClearance:
    """Monitor of the distances from the cables of a run to the bodies of its rig.

    A cable closer to a body than its margin is an event, once per approach, and its upper tension limit falls: in
    proportion to the distance, from the rig's own at the margin to the lower limit where the cable touches.

    Attributes
    ----------
    distances : (m,) array
        Distance of each cable from its nearest body at the latest pose, in m; NaN where the rig has none.
    shares : (m,) array
        Share of the way from the lower to the upper limit that is left to each cable.
    closest : dict
        The closest `Approach` of each module whose limit has fallen, by its name.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from dataclasses import replace
    >>> from tensionlab.hardware import Pose
    >>> from tensionlab.hardware.runner.body_clearance import BodyClearance
    >>> head = tl.Body("head", [0.0, 1.2, -0.3], radius=0.12, margin=0.36)
    >>> rig = replace(tl.load_rig("bartels2026-validation"), bodies=(head,))
    >>> monitor = BodyClearance(rig, lambda *event: print(*event))
    >>> monitor.update(Pose(rig.home), rig.structure_matrix(rig.home))
    near 0.18 m from "head", closer than its margin of 0.36 m: its upper limit falls top
    >>> monitor.limited(rig.limits).upper
    array([6. , 6. , 6. , 3.2])
    """

    def __init__(self, rig: Rig, note: Callable[[str, str, str], None]) -> None:
        self._rig, self._note = rig, note
        self.distances, self.shares = np.full(rig.m, np.nan), np.ones(rig.m)
        self.closest: dict[str, Approach] = {}
        self._upper = rig.limits.upper
        self._limits: tuple[TensionLimits, TensionLimits] | None = None  # those given, and those returned for them
        self._boxes = BodyBoxes(rig) if rig.bodies else None
        self._margins = np.array([body.margin for body in rig.bodies])
        self._near: set[tuple[int, int]] = set()  # module and body of each approach that has not ended

    def update(self, pose: Pose, structure: Floats) -> None:
        """Measure the distances at a pose, given the structure matrix (n, m) there."""
        if self._boxes is None:
            return
        distances, self.distances, least = self._boxes.measure(structure, *pose)
        if least >= 0.0 and not self._near:
            return
        own, upper = self._rig.limits, self._rig.limits.upper.copy()
        self.shares = np.ones(self._rig.m)
        before = self._near
        self._near = {pair for pair in before if distances[pair] - self._margins[pair[1]] < HYSTERESIS_M}
        for index, body in np.argwhere(distances < self._margins).tolist():
            distance, margin = float(distances[index, body]), float(self._margins[body])
            share = max(distance, 0.0) / margin if margin > 0.0 else 0.0
            if share < self.shares[index]:
                self.shares[index] = share
                fallen = own.lower[index] + share * (own.upper[index] - own.lower[index])
                upper[index] = max(STEP_N * math.floor(fallen / STEP_N + 1e-9), own.lower[index])
            name, where = self._rig.modules[index].name, self._rig.bodies[body].name
            if name not in self.closest or distance < self.closest[name].distance_m:
                self.closest[name] = Approach(where, distance, float(upper[index]))
            self._near.add((index, body))
            if (index, body) not in before:
                closer = f'{max(distance, 0.0):.2f} m from "{where}", closer than its margin of {margin:g} m'
                self._note("near", f"{closer}: its upper limit falls", name)
        if (upper != self._upper).any():
            self._upper, self._limits = upper, None

    def limited(self, limits: TensionLimits) -> TensionLimits:
        """Return tension limits, of which the upper ones fall by `shares`, in steps of `STEP_N`."""
        if not self._near:
            return limits
        if self._limits is None or self._limits[0] is not limits:
            self._limits = limits, TensionLimits(limits.lower, np.minimum(self._upper, limits.upper))
        return self._limits[1]

    def soften(self, spring: Impedance, index: int) -> Impedance:
        """Return the impedance of a module, all its tensions lowered by the share that is left to it."""
        share = float(self.shares[index])
        if share == 1.0:
            return spring
        tensions = ("stiffness", "damping", "feed_forward", "amplitude")
        return replace(spring, **{name: share * getattr(spring, name) for name in tensions})
