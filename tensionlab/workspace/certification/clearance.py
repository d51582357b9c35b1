"""Distances of cables from each other and from bodies, bounded over cells of positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import InputError
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers
from tensionlab.workspace.interference import Capsule, body_pairs, body_segments, cable_pairs, closest

ROUNDING = 1e-7  # error of a distance relative to the longest cable; the kernel has 1e-8 where segments cross


@dataclass(frozen=True, eq=False)
class ClearanceProblem:
    """Pairs of cables, and of cables and bodies, that must be so far apart, in m.

    Segments of bodies are (b, 2, d); radii are those of cables, zero, and bodies.
    """

    least: float
    pairs: Integers
    bodies: Floats
    radii: Floats

    def decide(
        self, anchors: Floats, arms: Floats, angle: float, centres: Floats, half_edges: Floats
    ) -> NDArray[np.int8]:
        """Return 1 for cells (k) that are clear in all poses, -1 for those that are not in any, 0 for the others.

        Anchors and arms are (rotations, m, d). The distance of two cables changes by no more than the platform
        moves: points at the shares s and t of their lengths come closer by |s - t| of its shift at most, and by s
        and t of what their attachments turn by.
        """
        reach = float(np.linalg.norm(half_edges)) + 2 * angle * float(np.linalg.norm(arms, axis=-1).max())
        clear = np.ones(len(centres), np.int8)
        for own_anchors, own_arms in zip(anchors, arms, strict=True):
            ends = centres[:, None] + own_arms
            cables = np.stack([np.broadcast_to(own_anchors, ends.shape), ends], axis=-2)
            bodies = np.broadcast_to(self.bodies, (len(centres), *self.bodies.shape))
            distance = closest(np.concatenate([cables, bodies], axis=-3), self.pairs, self.radii).distance
            doubt = reach + ROUNDING * np.linalg.norm(own_anchors - ends, axis=-1).max(axis=-1)
            verdict = np.where(distance - doubt >= self.least, 1, np.where(distance + doubt < self.least, -1, 0))
            clear = np.minimum(clear, verdict.astype(np.int8))
        return clear


def clearance_problem(rig: Rig, least: float | None, bodies: Sequence[Capsule]) -> ClearanceProblem | None:
    """Return which pairs must be apart, or None if no distance is required; see `body_distance` for errors."""
    if least is None:
        if bodies:
            raise InputError("bodies are given without a clearance; give the distance in m that cables must keep")
        return None
    if not (np.isfinite(least) and least >= 0):
        raise InputError(f"clearance is {least}; give a distance in m, 0 or more")
    segments, radii = body_segments(bodies, rig.dimension)
    if any(each.ndim != 3 for each in segments):
        raise InputError("bodies: give one place for each body; it is the same all over the region")
    return ClearanceProblem(
        float(least),
        np.concatenate([cable_pairs(rig), body_pairs(rig, bodies)]),
        np.concatenate([np.zeros((0, 2, rig.dimension)), *segments]),
        np.array([0.0] * rig.m + radii),
    )
