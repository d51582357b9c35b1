"""The scene of the design page: the rig, its workspace and forces, and what is dragged with the mouse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE
from tensionlab.viewer.drawing import RigDrawing, add_lines, as_rgb, set_lines, set_mesh
from tensionlab.viewer.scene import ARROWS, DesignScene
from tensionlab.viewer.state import HAND, DesignState, outlines
from tensionlab.viewer.workspace import Mesh

if TYPE_CHECKING:
    import viser

TIP = "desired force"  # name of the end of the arrow of the desired force
TIP_SHARE = 0.010  # radius of the ball there, as a share of the size of the rig
GIZMO_PIXELS = 70.0
NO_MESH = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))


@dataclass(frozen=True)
class Grab:
    """Something that is dragged: a module by its name, `HAND` or `TIP`.

    Attributes
    ----------
    what : str
        Its name.
    phase : "start", "update" or "end"
        Phase of the drag.
    place : (3,) array
        Where it is dragged to, in m.
    eye : (3,) array or None
        Where the ray through the mouse begins, in m; None for a drag of the handle with arrows.
    turn : (4,) array or None
        Quaternion (w, x, y, z) of a platform that is turned.
    """

    what: str
    phase: Literal["start", "update", "end"]
    place: Floats
    eye: Floats | None = None
    turn: Floats | None = None


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
        self._lines = {name: add_lines(server.scene, name) for name in ("ghost", "edges", "walls")}
        self._meshes = {
            "workspace": self._add_mesh("workspace", GREEN, 0.35, smooth=True),
            "ghost workspace": self._add_mesh("ghost workspace", GREY, 0.3, smooth=True),
            "available": self._add_mesh("available", BLUE, 0.18),
            "plane": self._add_mesh("plane", PURPLE, 0.35),
        }
        self._make_draggable(self._rig.hand, lambda: HAND)
        self._tip = self._scene.add_icosphere("/tip", color=as_rgb(ORANGE), cast_shadow=False)
        self._make_draggable(self._tip, lambda: TIP)
        self._add_gizmo()

    def _add_mesh(self, name: str, colour: str, opacity: float, *, smooth: bool = False) -> Any:
        # Of a closed surface the far side alone is drawn, since a near one would hide what is inside. Shading in
        # steps takes half the time of smooth shading without a graphics card.
        return self._scene.add_mesh_simple(
            f"/{name}", NO_MESH.vertices, NO_MESH.faces, color=as_rgb(colour), opacity=opacity,
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
            self._rig.look_at(state.rig, *walls)
        self._names = tuple(module.name for module in state.rig.modules)
        self._rig.show(scene.rig)
        for name, node in self._lines.items():
            set_lines(node, getattr(scene, name))
        for name in ("available", "plane"):
            set_mesh(self._meshes[name], getattr(scene, name))
        self._tip.position, self._tip.radius = scene.tip, TIP_SHARE * self._rig.reach
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

    def _add_gizmo(self) -> None:
        """Add the handle with arrows and arcs, for what is selected."""
        self._gizmo = self._scene.add_transform_controls(
            "/handle", GIZMO_PIXELS, fixed=True, active_axes=(True, True, not self._flat), depth_test=False,
            visible=False,
        )  # fmt: skip
        self._gizmo_held, self._gizmo_at = False, HAND

        async def dragged(event: Any) -> None:
            self._gizmo_held = event.phase != "end"
            turn = None if self._gizmo.disable_rotations else np.array(event.target.wxyz)
            self._on_grab(Grab(self._gizmo_at, event.phase, np.array(event.target.position), turn=turn))

        self._gizmo.on_update(dragged)

    def _show_gizmo(self, scene: DesignScene, state: DesignState) -> None:
        """Put the handle with arrows at what is selected, unless it is being dragged."""
        if self._gizmo_held:
            return
        self._gizmo_at = state.selected
        self._gizmo.visible = state.selected in (*self._names, HAND) and state.selected != self._by_ball
        at_module = state.selected in self._names
        self._gizmo.disable_rotations = at_module or state.rotation is None
        self._gizmo.position = (
            scene.rig.anchors[self._names.index(state.selected)] if at_module else scene.rig.hand
        )
        self._gizmo.wxyz = quaternion(None if at_module else state.rotation)


def quaternion(rotation: Floats | None) -> Floats:
    """Return the quaternion (w, x, y, z) of a rotation: a matrix in space, an angle in the plane, or none."""
    from scipy.spatial.transform import Rotation

    if rotation is None:
        return np.array([1.0, 0.0, 0.0, 0.0])
    turn = (
        Rotation.from_rotvec([0.0, 0.0, float(rotation)]) if rotation.ndim == 0 else Rotation.from_matrix(rotation)
    )
    return np.asarray(turn.as_quat(scalar_first=True))


def rotation_of(turn: Floats, dimension: int) -> Floats:
    """Return the rotation of a quaternion (w, x, y, z): a matrix in space, an angle about z in the plane."""
    from scipy.spatial.transform import Rotation

    found = Rotation.from_quat(turn, scalar_first=True)
    return np.asarray(found.as_rotvec()[2] if dimension == 2 else found.as_matrix())
