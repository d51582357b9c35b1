"""Bodies of a rig as boxes, for the distances of its cables at one pose after another: `BodyBoxes`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tensionlab import _native
from tensionlab.model.bodies import HAND
from tensionlab.model.kinematics import in_space
from tensionlab.model.pose import Frames, frame_of, place_anchors, rotations
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

GAP_POINTS = 301  # points of a cable among which the one nearest to a body is found


class Clearances(NamedTuple):
    """Distances of m cables from b bodies at a pose, in m, less the bodies' sway."""

    distances: Floats  # (m, b)
    nearest: Floats  # of each cable from its nearest body, (m,); infinite without bodies
    least: float  # the least distance above the body's margin


class BodyBoxes:
    """Bodies of a rig as rounded boxes: a sphere has no edges, a capsule one along its segment.

    Attributes
    ----------
    origins, turns : (b, 3) and (b, 3, 3) arrays
        Pose of each body's frame at the latest pose, in m.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig, count, d = rig, len(rig.bodies), rig.dimension
        frames = [body.frame for body in rig.bodies]
        self._of_frame = {name: np.array([frame == name for frame in frames]) for name in dict.fromkeys(frames)}
        self._own_centres, self._own_axes = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
        self._halves = np.zeros((count, 3))
        for index, body in enumerate(rig.bodies):
            self._own_centres[index, :d] = body.start
            if body.size is not None:
                self._halves[index, :d] = body.size / 2
            elif body.end is not None:
                self._own_centres[index, :d] = (body.start + body.end) / 2
                along = np.zeros(3)
                along[:d] = body.end - body.start
                self._halves[index, 0] = float(np.linalg.norm(along)) / 2
                self._own_axes[index] = _axes_along(along)
        self._radii = np.array([body.radius for body in rig.bodies])
        self._reaches = self._radii + [body.sway for body in rig.bodies]
        self._margins = np.array([body.margin for body in rig.bodies])
        self.origins, self.turns = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
        self._centres, self._axes = self._own_centres.copy(), self._own_axes.copy()
        self._cables = (np.zeros((rig.n, rig.m)), rig.attachments, rig.anchors)
        self._place(rig.at_rest)

    def _place(self, frames: Frames) -> None:
        """Place the bodies on frames."""
        d = self._rig.dimension
        for name in self._of_frame.keys() & frames.keys():
            part, where, turn = self._of_frame[name], frame_of(frames[name]), np.eye(3)
            if where.rotation is not None:
                turn[:d, :d] = rotations(where.rotation, d, f'frame "{name}" rotation')
            self.origins[part, :d], self.turns[part] = where.position, turn
            self._centres[part] = self.origins[part] + self._own_centres[part] @ turn.T
            self._axes[part] = turn @ self._own_axes[part]

    def measure(
        self, structure: Floats, position: Floats, rotation: Floats | None = None, frames: Frames | None = None
    ) -> Clearances:
        """Return the distances of cables from bodies at a pose.

        The pose is as in `Rig.structure_matrix`, and ``structure`` (n, m) the matrix there. Cables over pulleys
        end within a pulley's radius of where they should. Bodies on frames that are not given stay where they are.
        """
        rig, d = self._rig, self._rig.dimension
        if frames:
            self._place(frames)
        if HAND in self._of_frame:
            self._place({HAND: (position, rotation)})
        ends = np.empty((rig.m, d))
        ends[:] = position
        if rig.n > d:
            turn = np.eye(d) if rotation is None else rotations(rotation, d, "rotation")
            ends += rig.attachments @ turn.T
        anchors = place_anchors(rig.modules, rig.anchors, frames) if rig.frames else rig.anchors
        self._cables = structure, ends, anchors
        return Clearances(
            *_native.body_distances(
                *self._cables, self._centres, self._axes, self._halves, self._reaches, self._margins
            )
        )

    def gap(self, module: int, body: int) -> tuple[Floats, Floats]:
        """Return about the nearest points of a cable and a body at the latest pose, and the cable, (2, 3) in m."""
        structure, ends, anchors = self._cables
        d = ends.shape[1]
        along, begin = structure[:d, module], ends[module]
        lengths = np.linspace(0.0, float((anchors[module] - begin) @ along), GAP_POINTS)
        points = in_space(begin + lengths[:, None] * along)
        local = (points - self._centres[body]) @ self._axes[body]
        inside = np.clip(local, -self._halves[body], self._halves[body])
        distances = np.linalg.norm(local - inside, axis=1)
        nearest = int(distances.argmin())
        share = min(self._radii[body] / max(distances[nearest], 1e-9), 1.0)
        surface = inside[nearest] + share * (local[nearest] - inside[nearest])
        gap = np.stack([points[nearest], self._centres[body] + self._axes[body] @ surface])
        return gap, points[[0, -1]]


def _axes_along(along: Floats) -> Floats:
    """Return a rotation matrix (3, 3) whose first column is along a vector; the identity for none."""
    length = float(np.linalg.norm(along))
    if length == 0.0:
        return np.eye(3)
    across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    axes = np.stack([along, across, np.cross(along, across)])
    return np.asarray((axes / np.linalg.norm(axes, axis=1, keepdims=True)).T)
