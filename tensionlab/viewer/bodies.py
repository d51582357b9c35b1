"""Bodies of a rig in the scene, and the cable that is nearest to one of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.hardware.runner.body_boxes import BodyBoxes
from tensionlab.model.bodies import Body
from tensionlab.model.kinematics import in_space
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import GREY, RED, rgb
from tensionlab.viewer.evaluation import polytope
from tensionlab.viewer.scene import CABLE_PIXELS, NO_LINES, Lines, Mesh, add_lines, plain_lines, set_lines

BODY_COLOUR, BODY_OPACITY = "#B8B8B8", 0.55
ROUND_POINTS = 400  # points of a sphere, and of a circle in the plane


@dataclass(frozen=True, eq=False)
class BodyScene:
    """Bodies of a rig at a pose, and the cable nearest to the margin of one."""

    bodies: tuple[Body, ...] = ()
    origins: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # of their frames, (b, 3), in m
    turns: Floats = field(default_factory=lambda: np.zeros((0, 4)))  # quaternions (w, x, y, z) of their frames
    near: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), bool))  # below the margin, (m, b)
    gap: Lines = NO_LINES  # from the nearest cable to the body; below its margin with the cable, red
    label: str = ""  # its length in words

    @property
    def points(self) -> Floats:
        """Points (k, 3) in m that a picture should hold."""
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_quat(self.turns, scalar_first=True) if self.bodies else ()
        meshes = [body_mesh(body).vertices for body in self.bodies]
        placed = [turn.apply(mesh) + at for turn, mesh, at in zip(turns, meshes, self.origins, strict=True)]
        return np.concatenate([np.empty((0, 3)), *placed])


def draw_bodies(
    rig: Rig, structure: Floats, position: Floats, rotation: Floats | None = None, frames: Frames | None = None
) -> BodyScene:
    """Return the bodies of a rig at a pose as in `Rig.structure_matrix`, whose matrix (n, m) is given."""
    from scipy.spatial.transform import Rotation

    if not rig.bodies:
        return BodyScene(near=np.zeros((rig.m, 0), bool))
    boxes = BodyBoxes(rig)
    distances = boxes.measure(structure, position, rotation, frames).distances
    excess = distances - [body.margin for body in rig.bodies]
    module, body = np.unravel_index(int(excess.argmin()), excess.shape)
    below = bool(excess[module, body] < 0.0)
    gap, cable = boxes.gap(int(module), int(body))
    label = f"{rig.modules[module].name}: {max(distances[module, body], 0.0):.2f} m from {rig.bodies[body].name}"
    if below:
        label += f", margin {rig.bodies[body].margin:g} m"
    return BodyScene(
        bodies=rig.bodies,
        origins=boxes.origins,
        turns=Rotation.from_matrix(boxes.turns).as_quat(scalar_first=True),
        near=excess < 0.0,
        gap=plain_lines(np.stack([gap, cable] if below else [gap]), RED if below else GREY),
        label=label,
    )


def body_mesh(body: Body) -> Mesh:
    """Return the surface of a body in the axes of its frame; in the plane, what it covers."""
    d = body.start.size
    if body.size is not None:
        signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * d), axis=-1).reshape(-1, d)
        points = body.start + signs * body.size
    else:
        ball = body.radius * _directions(d)
        points = np.concatenate([end + ball for end in (body.start, body.end) if end is not None])
    hull = polytope(points)
    assert hull is not None
    return Mesh(in_space(hull.corners), hull.faces)


def _directions(d: int) -> Floats:
    """Return evenly spread unit vectors (k, d)."""
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(ROUND_POINTS)  # the golden angle
    height = 1.0 - (2.0 * np.arange(ROUND_POINTS) + 1.0) / ROUND_POINTS
    if d == 2:
        height, turn = np.zeros(ROUND_POINTS), 2.0 * np.pi * np.arange(ROUND_POINTS) / ROUND_POINTS
    around = np.sqrt(1.0 - height**2)
    return np.column_stack([around * np.cos(turn), around * np.sin(turn), height])[:, :d]


class BodyDrawing:
    """Nodes of bodies and of the gap to the nearest cable; `show` brings them up to date."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self._bodies: tuple[Body, ...] = ()
        self._nodes: list[Any] = []
        self._gap = add_lines(scene, "gap", 2.0 * CABLE_PIXELS)
        self._label = scene.add_label("/gap label", "", anchor="top-left", visible=False)

    def show(self, drawn: BodyScene) -> None:
        """Bring all nodes up to date."""
        if drawn.bodies != self._bodies:
            for node in self._nodes:
                node.remove()
            self._bodies = drawn.bodies
            self._nodes = [self._add(index, body) for index, body in enumerate(drawn.bodies)]
        near_any: list[bool] = np.any(drawn.near, axis=0).tolist()
        for node, origin, turn, near in zip(self._nodes, drawn.origins, drawn.turns, near_any, strict=True):
            node.position, node.wxyz = origin, turn
            node.color = tuple(rgb(RED if near else BODY_COLOUR).tolist())
        set_lines(self._gap, drawn.gap)
        self._label.visible = bool(drawn.label)
        if drawn.label:
            self._label.text, self._label.position = drawn.label, drawn.gap.points[0].mean(axis=0)

    def _add(self, index: int, body: Body) -> Any:
        mesh = body_mesh(body)
        return self._scene.add_mesh_simple(
            f"/bodies/{index}", mesh.vertices, mesh.faces, color=rgb(BODY_COLOUR), opacity=BODY_OPACITY,
            side="double", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
