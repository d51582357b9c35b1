"""Clearance of the cables of a run from the bodies of its rig: distances, events, and tension limits that fall."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tensionlab import _native
from tensionlab.demand import Impedance, Pose
from tensionlab.hardware.runner.guard import STEP_N
from tensionlab.model.bodies import HAND, PlacedBody, as_segments, place_bodies
from tensionlab.model.module import TensionLimits
from tensionlab.model.pose import place_anchors, rotations
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

HYSTERESIS_M = 0.01  # distance beyond its margin from which on a body may be approached anew


class BodyClearance:
    """Monitor of the distances from the cables of a run to the bodies of its rig.

    A cable closer to a body than its margin is an event, once per approach, and its upper tension limit falls: in
    proportion to the distance, from the rig's own at the margin to the lower limit where the cable touches.
    `distances` (m,) are those from the nearest body at the latest pose, in m, NaN without bodies; `shares` (m,) of
    the way from the lower to the upper limit are left; `closest` says how close each cable came.
    """

    def __init__(self, rig: Rig, note: Callable[[str, str, str], None]) -> None:
        self._rig, self._note = rig, note
        self.distances, self.shares = np.full(rig.m, np.nan), np.ones(rig.m)
        self.closest: dict[str, str] = {}
        self._least: dict[str, float] = {}  # distances of those
        self._near: set[tuple[int, int]] = set()  # cable and body of each approach that has not ended
        self._upper = rig.limits.upper
        self._limits: tuple[TensionLimits, TensionLimits] | None = None  # those given, and those returned for them
        self._margins = np.array([body.margin for body in rig.bodies])
        self._reaches = np.array([body.radius + body.sway for body in rig.bodies])
        self._held = any(body.frame == HAND for body in rig.bodies)
        self._placed: list[PlacedBody] = []  # the bodies, if they stay where they are

    def update(self, pose: Pose, structure: Floats) -> None:
        """Measure the distances at a pose, given the structure matrix (n, m) there, and lower the limits.

        Cables over pulleys end within a pulley's radius of where they should.
        """
        rig, d = self._rig, self._rig.dimension
        if not len(self._margins):
            return
        turn = rig.home_matrix if pose.rotation is None else rotations(pose.rotation, d, "rotation")
        placed = self._placed
        if pose.frames or self._held or not placed:
            placed = place_bodies(rig.bodies, pose.position, turn, rig.at_rest | dict(pose.frames or {}))
            self._placed = [] if pose.frames else placed
        ends = pose.position + rig.attachments @ turn.T
        anchors = place_anchors(rig.modules, rig.anchors, pose.frames) if rig.frames else rig.anchors
        directions = structure[:d].T
        lengths = np.einsum("md,md->m", anchors - ends, directions)[:, None]
        segments, shape = as_segments(np.stack([ends, ends + lengths * directions], axis=1), rig.bodies, placed)
        distances = _native.segment_distances(*segments).reshape(shape) - self._reaches
        self.distances = distances.min(axis=1)
        if self._near or (distances < self._margins).any():
            self._limit(distances)

    def _limit(self, distances: Floats) -> None:
        own, upper, modules = self._rig.limits, self._rig.limits.upper.copy(), self._rig.modules
        self.shares = np.ones(self._rig.m)
        self._near -= {pair for pair in self._near if distances[pair] - self._margins[pair[1]] >= HYSTERESIS_M}
        for index, body in np.argwhere(distances < self._margins).tolist():
            distance, margin = max(float(distances[index, body]), 0.0), float(self._margins[body])
            self.shares[index] = min(distance / margin if margin > 0.0 else 0.0, self.shares[index])
            fallen = own.lower[index] + self.shares[index] * (own.upper[index] - own.lower[index])
            upper[index] = max(STEP_N * math.floor(fallen / STEP_N + 1e-9), own.lower[index])
            name = modules[index].name
            what = f'{distance:.2f} m from "{self._rig.bodies[body].name}", closer than its margin of {margin:g} m'
            if (index, body) not in self._near:
                self._note("near", f"{what}: its upper limit falls", name)
            self._near.add((index, body))
            if distance < self._least.get(name, math.inf):
                self._least[name] = distance
                self.closest[name] = f"{what}: its upper limit fell to {upper[index]:.2f} N"
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
        if (share := float(self.shares[index])) == 1.0:
            return spring
        tensions = ("stiffness", "damping", "feed_forward", "amplitude")
        return spring._replace(**{name: share * getattr(spring, name) for name in tensions})
