"""Bodies of a rig in the scene, and the cable that is nearest to one of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.bodies import HAND, Body, place_bodies, surface_points
from tensionlab.model.kinematics import in_space
from tensionlab.model.module import WORLD
from tensionlab.model.pose import Frames, frame_matrix
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BODY, GREY, RED, rgb
from tensionlab.viewer.evaluation import polytope
from tensionlab.viewer.scene import CABLE_PIXELS, NO_LINES, Lines, Mesh, add_lines, plain_lines, set_lines
from tensionlab.workspace.interference import body_distances

BODY_OPACITY = 0.55
LABEL_AT = (0.7, 0.3)  # shares of the ends of a cable in the place of its label: clear of those of modules


@dataclass(frozen=True, eq=False)
class BodyScene:
    """Bodies of a rig at a pose, and the cable nearest to the margin of one."""

    bodies: tuple[Body, ...] = ()
    poses: tuple[Floats, ...] = ()  # of their frames, matrices (4, 4)
    near: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), bool))  # below the margin, (m, b)
    cable: Lines = NO_LINES  # the nearest one; red below the margin
    label: str = ""  # its distance in words

    @property
    def points(self) -> Floats:
        """Points (k, 3) in m that a picture should hold."""
        points = [np.empty((0, 3))]
        for body, pose in zip(self.bodies, self.poses, strict=True):
            points.append(body_mesh(body).vertices @ pose[:3, :3].T + pose[:3, 3])
        return np.concatenate(points)


def draw_bodies(
    rig: Rig, cables: Floats, position: Floats, rotation: Floats | None = None, frames: Frames | None = None
) -> BodyScene:
    """Return the bodies of a rig at a pose as in `Rig.structure_matrix`; cables (m, 2, d) are in m."""
    if not rig.bodies:
        return BodyScene(near=np.zeros((rig.m, 0), bool))
    distances = body_distances(rig, position, rotation, frames)
    excess = distances - [body.margin for body in rig.bodies]
    module, body = (int(index) for index in np.unravel_index(int(excess.argmin()), excess.shape))
    nearest, below = rig.bodies[body], bool(excess[module, body] < 0.0)
    label = f"{rig.modules[module].name}: {max(distances[module, body], 0.0):.2f} m from {nearest.name}"
    where = rig.at_rest | dict(frames or {}) | {HAND: (position, rotation)}
    return BodyScene(
        bodies=rig.bodies,
        poses=tuple(pose_matrix(rig.dimension, where.get(body.frame)) for body in rig.bodies),
        near=excess < 0.0,
        cable=plain_lines(in_space(cables[module])[None], RED if below else GREY),
        label=label + f", margin {nearest.margin:g} m" * below,
    )


def pose_matrix(d: int, where: Any) -> Floats:
    """Return the pose of a frame, None for the world, as a matrix (4, 4)."""
    matrix = np.eye(4)
    if where is not None:
        matrix[:d, [*range(d), 3]] = frame_matrix(where, d)
    return matrix


def body_mesh(body: Body) -> Mesh:
    """Return the surface of a body in the axes of its frame; in the plane, what it covers."""
    (own,) = place_bodies([replace(body, frame=WORLD)], np.zeros(body.start.size), None, {})
    hull = polytope(surface_points(body, own))
    assert hull is not None
    return Mesh(in_space(hull.corners), hull.faces)


class BodyDrawing:
    """Nodes of bodies and of the nearest cable; `show` brings them up to date."""

    def __init__(self, scene: Any) -> None:
        self._scene, self._cable = scene, add_lines(scene, "nearest", 2.0 * CABLE_PIXELS)
        self._bodies: tuple[Body, ...] = ()
        self._nodes: list[Any] = []
        self._label = scene.add_label("/nearest label", "", anchor="top-left", visible=False)

    def show(self, drawn: BodyScene) -> None:
        """Bring all nodes up to date."""
        from scipy.spatial.transform import Rotation

        if drawn.bodies != self._bodies:
            for node in self._nodes:
                node.remove()
            self._bodies = drawn.bodies
            self._nodes = [
                self._scene.add_mesh_simple(
                    f"/bodies/{index}", mesh.vertices, mesh.faces, opacity=BODY_OPACITY, side="double",
                    cast_shadow=False, receive_shadow=False,
                )
                for index, mesh in enumerate(map(body_mesh, drawn.bodies))
            ]  # fmt: skip
        near_any: list[bool] = np.any(drawn.near, axis=0).tolist()
        for node, pose, near in zip(self._nodes, drawn.poses, near_any, strict=True):
            node.position = pose[:3, 3]
            node.wxyz = Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
            node.color = tuple(rgb(RED if near else BODY).tolist())
        set_lines(self._cable, drawn.cable)
        self._label.visible = bool(drawn.label)
        if drawn.label:
            self._label.text, self._label.position = drawn.label, drawn.cable.points[0].T @ LABEL_AT
