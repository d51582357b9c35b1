"""The scene of the design page: a state as arrays, the nodes that follow it, and what is dragged with the mouse.

Forces are drawn to one scale: the arrow of a force ends inside the set of available forces if and only if it is
available.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tensionlab.model.kinematics import in_space
from tensionlab.model.pose import rotations
from tensionlab.model.pulleys import ways
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, Colours, ramp, rgb
from tensionlab.support.formatting import format_number
from tensionlab.viewer.bodies import BodyDrawing, BodyScene, draw_bodies
from tensionlab.viewer.evaluation import Certificate, StateEvaluation
from tensionlab.viewer.scene import (
    NO_LINES,
    Lines,
    Mesh,
    RigDrawing,
    RigScene,
    add_lines,
    cable_lines,
    force_scale,
    module_colours,
    plain_lines,
    platform_lines,
    set_lines,
    set_mesh,
    size,
)
from tensionlab.viewer.state import HAND, DesignState, ghost_state, outlines

if TYPE_CHECKING:
    import viser

TIP = "desired force"  # name of the end of the arrow of the desired force
ARROWS = {"desired": ORANGE, "rendered": BLUE, "error": GREY, "certificate": PURPLE}  # colour of each arrow
TIP_SHARE = 0.045  # least distance from the hand at which a force is grabbed, as a share of the size of the rig
TIP_RADIUS = 0.010  # radius of the ball there, as such a share
# Half of the edge of the plane of a certificate, as a share of the arrow of the strongest tension.
PLANE_SHARE = 0.7
GIZMO_PIXELS = 70.0
NO_MESH = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))


@dataclass(frozen=True, eq=False)
class DesignScene:
    """All that is drawn of a state except the workspace."""

    rig: RigScene  # with arrows of `ARROWS`
    tip: Floats  # where the arrow of the desired force is grabbed, (3,), in m
    ghost: Lines  # cables of the other rig
    walls: Lines  # surfaces of the space
    edges: Lines  # of the available forces
    available: Mesh | None  # forces that are available at the hand
    plane: Mesh | None  # beyond which the desired force is certified to be
    bodies: BodyScene


def draw(state: DesignState, found: StateEvaluation) -> DesignScene:
    """Return what is drawn of a state and its evaluation."""
    rig, ghost, task, labels = state.rig, ghost_state(state), state.task, state.names
    anchors, ends, hand = (in_space(points) for points in (state.anchors, state.attachments, state.position))
    scale = force_scale(rig)
    tip, shortest = scale * in_space(state.wrench[: rig.dimension]), TIP_SHARE * size(rig)
    if float(np.linalg.norm(tip)) < shortest:
        tip = shortest * np.array([0.8, 0.6, 0.0])  # clear of the hand
    if found.allocation is not None:
        tensions = found.allocation.tensions
        labels = tuple(f"{name} · {format_number(t)} N" for name, t in zip(labels, tensions, strict=True))
    available, edges, plane = None, NO_LINES, None
    if found.available is not None:
        corners = hand + scale * in_space(found.available.corners)
        available, edges = Mesh(corners, found.available.faces), plain_lines(corners[found.available.edges], BLUE)
    arrows = _arrows(state, found, hand, scale)

    def cables(of: DesignState, colours: Colours) -> Lines:
        points = ways(of.attachments, of.anchors, of.rig.pulleys_in_world(of.rig.at_rest))
        return cable_lines(in_space(points), colours)

    if found.certificate is not None:
        arrows["certificate"], plane = _certificate(state, found.certificate, hand, scale)
    return DesignScene(
        rig=RigScene(
            cables=cables(state, tension_colours(rig, found)),
            platform=platform_lines(hand, ends),
            anchors=anchors,
            colours=module_colours(rig),
            hand=hand,
            labels=labels,
            arrows=arrows,
        ),
        tip=hand + tip,
        ghost=NO_LINES if ghost is None else cables(ghost, rgb(GREY)),
        walls=NO_LINES if task is None else plain_lines(in_space(outlines(task.space)), GREY),
        edges=edges,
        available=available,
        plane=plane,
        bodies=BodyScene()
        if np.isnan(found.margin)  # a cable has no length
        else draw_bodies(rig, np.stack([state.attachments, state.anchors], 1), state.position, state.rotation),
    )


def tension_colours(rig: Rig, found: StateEvaluation) -> Colours:
    """Return the colour of each cable, (m, 3), by where its tension is between its limits; grey without one."""
    tensions = np.full(rig.m, np.nan) if found.allocation is None else found.allocation.tensions
    return ramp(tensions, rig.limits.lower, rig.limits.upper)


def _arrows(state: DesignState, found: StateEvaluation, hand: Floats, scale: float) -> dict[str, Floats]:
    """Return the arrow of the desired force and, where it is not rendered, of the rendered one and the error."""
    d = state.rig.dimension
    desired = hand + scale * in_space(state.wrench[:d])
    arrows = {"desired": np.stack([hand, desired])}
    if found.allocation is not None and found.rendered is not None and found.allocation.status != Status.EXACT:
        rendered = hand + scale * in_space(found.rendered[:d])
        if np.isfinite(rendered).all():
            arrows |= {"rendered": np.stack([hand, rendered]), "error": np.stack([rendered, desired])}
    return arrows


def _certificate(state: DesignState, certificate: Certificate, hand: Floats, scale: float) -> tuple[Floats, Mesh]:
    """Return the arrow across the plane that certifies the desired force infeasible, and the plane.

    The plane touches the set of available forces, and the desired force is beyond it.
    """
    along, d = in_space(certificate.direction), state.rig.dimension
    foot = hand + scale * (in_space(state.wrench[:d]) + (certificate.reach - certificate.desired) * along)
    reach = PLANE_SHARE * scale * float(state.rig.limits.upper.max())
    across = reach * np.linalg.svd(along[None])[2][1:]
    if d == 2:  # from the front it shows as a line
        across = reach * np.stack([np.cross(along, [0.0, 0.0, 1.0]), 0.03 * along])
    ring = foot + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ across
    start = foot + across[0]  # at the edge, clear of the other arrows
    return np.stack([start, start + reach * along]), Mesh(ring, np.array([[0, 1, 2], [0, 2, 3]]))


@dataclass(frozen=True)
class Grab:
    """Something that is dragged: a module by its name, `HAND` or `TIP`."""

    what: str
    phase: Literal["start", "update", "end"]
    place: Floats  # where it is dragged to, (3,), in m
    eye: Floats | None = None  # where the ray through the mouse begins, (3,), in m; None for the handle
    turn: Floats | None = None  # quaternion (w, x, y, z) of a platform that is turned


class DesignDrawing:
    """Nodes of the design page; `show` and `show_workspace` bring them up to date in place."""

    def __init__(
        self,
        server: viser.ViserServer,
        state: DesignState,
        on_grab: Callable[[Grab], None],
        on_select: Callable[[str], None],
    ) -> None:
        self._scene, self._on_grab, self._on_select = server.scene, on_grab, on_select
        self._flat = state.rig.dimension == 2
        self._names: tuple[str, ...] = ()
        self._by_ball = ""  # what was dragged by its ball since it was clicked: arrows would be in the way
        self._looked_at: tuple[object, ...] = ()
        self._rig = RigDrawing(server, ARROWS, lambda ball, i: self._make_draggable(ball, lambda: self._names[i]))
        self._bodies = BodyDrawing(server.scene)
        self._lines = {name: add_lines(server.scene, name) for name in ("ghost", "edges", "walls")}
        self._meshes = {
            "workspace": self._add_mesh("workspace", GREEN, 0.35, smooth=True),
            "ghost workspace": self._add_mesh("ghost workspace", GREY, 0.3, smooth=True),
            "available": self._add_mesh("available", BLUE, 0.18),
            "plane": self._add_mesh("plane", PURPLE, 0.35),
        }
        self._make_draggable(self._rig.hand, lambda: HAND)
        self._tip = self._scene.add_icosphere("/tip", color=rgb(ORANGE), cast_shadow=False)
        self._make_draggable(self._tip, lambda: TIP)
        # The handle with arrows and arcs, for what is selected.
        self._gizmo = self._scene.add_transform_controls(
            "/handle", GIZMO_PIXELS, fixed=True, active_axes=(True, True, not self._flat), depth_test=False,
            visible=False,
        )  # fmt: skip
        self._gizmo_held, self._gizmo_at = False, HAND
        self._gizmo.on_update(self._drag_gizmo)

    async def _drag_gizmo(self, event: Any) -> None:
        self._gizmo_held = event.phase != "end"
        turn = None if self._gizmo.disable_rotations else np.array(event.target.wxyz)
        self._on_grab(Grab(self._gizmo_at, event.phase, np.array(event.target.position), turn=turn))

    def _add_mesh(self, name: str, colour: str, opacity: float, *, smooth: bool = False) -> Any:
        # Of a closed surface the far side alone is drawn, since a near one would hide what is inside. Shading in
        # steps takes half the time of smooth shading without a graphics card.
        return self._scene.add_mesh_simple(
            f"/{name}", NO_MESH.vertices, NO_MESH.faces, color=rgb(colour), opacity=opacity,
            side="double" if self._flat or name == "plane" else "back",
            flat_shading=self._flat or not smooth, cast_shadow=False, receive_shadow=False, material="toon5",
            visible=False,
        )  # fmt: skip

    def show(self, scene: DesignScene, state: DesignState) -> None:
        """Bring all nodes but the workspace up to date."""
        looked_at = (state.rig.up, state.rig.m, state.rig.name, state.task)
        if looked_at != self._looked_at:
            self._looked_at = looked_at
            task, d = state.task, state.rig.dimension
            walls = [outlines(task.space).reshape(-1, d)] if task is not None and task.space.dimension == d else []
            self._rig.look_at(state.rig, *walls, scene.bodies.points[:, :d])
        self._names = tuple(module.name for module in state.rig.modules)
        self._rig.show(scene.rig)
        self._bodies.show(scene.bodies)
        for name, node in self._lines.items():
            set_lines(node, getattr(scene, name))
        for name in ("available", "plane"):
            set_mesh(self._meshes[name], getattr(scene, name))
        self._tip.position, self._tip.radius = scene.tip, TIP_RADIUS * self._rig.reach
        self._show_gizmo(scene, state)

    def show_workspace(self, surface: Mesh | None, ghost: Mesh | None) -> None:
        """Bring the surface of the workspace and that of the other rig up to date."""
        for name, mesh in (("workspace", surface), ("ghost workspace", ghost)):
            set_mesh(self._meshes[name], mesh)
            self._meshes[name].position = (0.0, 0.0, -0.01 * self._rig.reach if self._flat else 0.0)  # behind

    def _make_draggable(self, node: Any, name: Callable[[], str]) -> None:
        """Have a node say when it is clicked or dragged."""
        offset = np.zeros(3)

        # Coroutines run in their order; functions would on several threads.
        async def dragged(event: Any) -> None:
            nonlocal offset
            if event.phase == "start":
                offset = np.subtract(node.position, event.start_position)
                self._by_ball = name()
                self._on_select(name())
            place = np.asarray(event.end_position) + offset
            self._on_grab(Grab(name(), event.phase, place, np.array(event.client.camera.position)))

        async def clicked(event: Any) -> None:
            self._by_ball = ""
            self._on_select(name())

        node.on_drag("left")(dragged)
        node.on_click(clicked)

    def _show_gizmo(self, scene: DesignScene, state: DesignState) -> None:
        """Put the handle with arrows at what is selected, unless it is being dragged."""
        if self._gizmo_held:
            return
        self._gizmo_at = state.selected
        self._gizmo.visible = state.selected in (*self._names, HAND) and state.selected != self._by_ball
        rotation, self._gizmo.position = state.rotation, scene.rig.hand
        if state.selected in self._names:
            rotation, self._gizmo.position = None, scene.rig.anchors[self._names.index(state.selected)]
        self._gizmo.disable_rotations = rotation is None
        self._gizmo.wxyz = quaternion(rotation, state.rig.dimension)


def quaternion(rotation: Floats | None, dimension: int) -> Floats:
    """Return the quaternion (w, x, y, z) of a rotation: a matrix in space, an angle in the plane, or none."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(3)
    if rotation is not None:
        matrix[:dimension, :dimension] = rotations(rotation, dimension, "rotation")
    return np.asarray(Rotation.from_matrix(matrix).as_quat(scalar_first=True))


def rotation_of(turn: Floats, dimension: int) -> Floats:
    """Return the rotation of a quaternion (w, x, y, z): a matrix in space, an angle about z in the plane."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_quat(turn, scalar_first=True)
    return np.asarray(rotation.as_rotvec()[2] if dimension == 2 else rotation.as_matrix())
