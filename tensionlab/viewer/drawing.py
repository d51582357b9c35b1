"""The scene in the browser: nodes of viser that follow what is drawn, and what is grabbed with the mouse."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tensionlab.model.kinematics import in_space
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, Colours, rgb
from tensionlab.viewer.scene import ARROWS, Arrow, Lines, Scene, size
from tensionlab.viewer.snapping import outlines
from tensionlab.viewer.state import HAND, State
from tensionlab.viewer.volume import Mesh, Slice, bounds

if TYPE_CHECKING:
    import viser

TIP = "desired force"
"""What the end of the arrow of the desired force is called."""
ANCHOR_SHARE, HAND_SHARE, BALL_SHARE, STUDY_SHARE = 0.012, 0.015, 0.010, 0.008
"""Radii of what can be grabbed, and of the dots of a study, as shares of the size of the rig."""
ARROW_SHARES = {"shaft_radius": 0.004, "head_radius": 0.010, "head_length": 0.03}
"""Sizes of arrows, as such shares."""
GIZMO_PIXELS = 70.0
FIELD_OF_VIEW_RAD = 0.7
CABLE_PIXELS, THIN_PIXELS = 3.0, 1.5

NOTHING = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
"""Mesh of which nothing is seen."""

CLEAR = np.zeros((1, 1, 4), np.uint8)
"""Image of which nothing is seen."""

Phase = Literal["start", "update", "end"]


@dataclass(frozen=True)
class Grab:
    """Something that is dragged: a module by its name, `HAND` or `TIP`.

    Attributes
    ----------
    what : str
        Which of them.
    phase : "start", "update" or "end"
        Of the drag.
    place : (3,) array
        Where it is dragged to, in m.
    eye : (3,) array or None
        Where the ray through the mouse begins, in m; None for a drag of the handle with arrows.
    turn : (4,) array or None
        Quaternion (w, x, y, z) of a platform that is turned.
    """

    what: str
    phase: Phase
    place: Floats
    eye: Floats | None = None
    turn: Floats | None = None


class Drawing:
    """Nodes of the scene; `show` brings them up to date in place."""

    def __init__(
        self,
        server: viser.ViserServer,
        state: State,
        on_grab: Callable[[Grab], None],
        on_select: Callable[[str], None],
    ) -> None:
        self._scene = scene = server.scene
        self._on_grab, self._on_select = on_grab, on_select
        self._anchors: list[Any] = []
        self._labels: list[Any] = []
        self._names: tuple[str, ...] = ()
        self._offset: dict[str, Floats] = {}
        self._gizmo_held = False
        self._by_ball = ""  # what was dragged by its ball since it was clicked: arrows would be in its way
        reach = size(state.rig)
        flat = state.rig.dimension == 2
        self._server = server
        self._seen: tuple[object, ...] = ()
        scene.world_axes.visible = False
        nothing, black = np.zeros((1, 2, 3)), np.zeros((1, 2, 3), np.uint8)
        self._lines = {
            name: scene.add_line_segments(
                f"/{name}", nothing, black, thickness=pixels, thickness_units="screen", visible=False
            )
            for name, pixels in (
                ("cables", CABLE_PIXELS), ("platform", THIN_PIXELS), ("ghost", THIN_PIXELS),
                ("edges", THIN_PIXELS), ("walls", THIN_PIXELS),
            )
        }  # fmt: skip
        self._arrows = add_arrows(scene, ARROWS, reach)
        # Of what is closed, the far side alone is drawn: a browser sorts whole objects, so a near one would hide
        # what is inside. What is flat has triangles for either side: a mesh of two sides is drawn twice,
        # each time with another program, which without a graphics card took a third of the work. There, light in
        # five steps takes half of the time of a smooth one.
        self._meshes = {
            name: scene.add_mesh_simple(
                f"/{name}", NOTHING.vertices, NOTHING.faces, color=tuple(rgb(colour)), opacity=opacity,
                side="front" if flat or name == "plane" else "back",
                flat_shading=flat or "workspace" not in name,
                cast_shadow=False, receive_shadow=False, material="toon5",
            )
            for name, colour, opacity in (
                ("workspace", GREEN, 0.35), ("ghost workspace", GREY, 0.3), ("available", BLUE, 0.18),
                ("plane", PURPLE, 0.35),
            )
        }  # fmt: skip
        # In the plane, the workspace is behind all else.
        self._behind = np.array([0.0, 0.0, -0.01 * reach if flat else 0.0])
        self._meshes["workspace"].position = self._behind
        self._meshes["ghost workspace"].position = 1.5 * self._behind
        self._study = scene.add_point_cloud(
            "/study", np.zeros((1, 3)), (0, 0, 0), point_shape="circle", visible=False
        )
        self._slices = [scene.add_image(f"/slices/{i}", CLEAR, 1.0, 1.0, visible=False) for i in range(3)]
        self._hand = scene.add_icosphere("/hand", color=tuple(rgb(RED)), cast_shadow=False)
        self._tip = scene.add_icosphere("/tip", color=tuple(rgb(ORANGE)), cast_shadow=False)
        self._make_draggable(self._hand, HAND)
        self._make_draggable(self._tip, TIP)
        self._gizmo = scene.add_transform_controls(
            "/handle",
            GIZMO_PIXELS,
            fixed=True,
            active_axes=(True, True, not flat),
            depth_test=False,
            visible=False,
        )
        self._gizmo_at = HAND
        self._follow_gizmo()

    def show(self, scene: Scene, state: State) -> None:
        """Bring all nodes up to date, but for the workspace."""
        seen = (state.rig.up, state.rig.m, state.rig.name, state.task)
        if seen != self._seen:
            self._seen = seen
            task, d = state.task, state.rig.dimension
            walls = [outlines(task.space).reshape(-1, d)] if task is not None and task.space.dimension == d else []
            place_camera(self._server, state.rig, *walls)
            add_floor(self._scene, state.rig, *walls)  # in place of the one before
            self._reach = size(state.rig)
        for name, lines in (("cables", scene.cables), ("platform", scene.platform), ("ghost", scene.ghost),
                            ("walls", scene.walls), ("edges", scene.edges)):  # fmt: skip
            set_lines(self._lines[name], lines)
        for name, node in self._arrows.items():
            set_arrow(node, scene.arrows.get(name))
        for name, mesh in (("available", scene.available), ("plane", scene.plane)):
            self._show_mesh(name, mesh)
        self._show_modules(scene, state)
        self._show_sizes()
        self._hand.position, self._tip.position = scene.hand, scene.tip
        self._show_gizmo(scene, state)

    def show_workspace(self, surface: Mesh | None, ghost: Mesh | None, slices: Sequence[Slice]) -> None:
        """Bring the surface of the workspace, that of the other rig, and the slices up to date."""
        self._show_mesh("workspace", surface)
        self._show_mesh("ghost workspace", ghost)
        for node, shown in zip_longest(self._slices, slices):
            node.visible = shown is not None
            if shown is not None:
                node.image, node.position = shown.image, shown.middle + self._behind
                node.render_width, node.render_height = shown.edges
                node.wxyz = quaternion(shown.axes)

    def show_study(self, points: Floats, colours: Colours) -> None:
        """Bring the problems at which solvers are compared up to date."""
        self._study.visible = bool(len(points))
        if len(points):
            self._study.points, self._study.colors = points.astype(np.float32), colours

    def _show_mesh(self, name: str, mesh: Mesh | None) -> None:
        node = self._meshes[name]
        set_mesh(node, both_sides(mesh) if mesh is not None and node.side == "front" else mesh)

    def _show_modules(self, scene: Scene, state: State) -> None:
        self._names = tuple(module.name for module in state.rig.modules)
        while len(self._anchors) > len(self._names):
            self._anchors.pop().remove()
            self._labels.pop().remove()
        for i in range(len(self._anchors), len(self._names)):
            node = self._scene.add_icosphere(f"/anchors/{i}", color=tuple(rgb(BLUE)), cast_shadow=False)
            self._make_draggable(node, i)
            self._anchors.append(node)
            self._labels.append(self._scene.add_label(f"/labels/{i}", "", anchor="bottom-left"))
        bodies = {module.name for module in state.rig.modules if module.frame in state.rig.frames}
        for name, node, place, label, words in zip(
            self._names, self._anchors, scene.anchors, self._labels, scene.labels, strict=True
        ):
            node.position = label.position = place
            node.color = tuple(int(part) for part in rgb(ORANGE if name in bodies else BLUE))
            label.text = words.text

    def _show_sizes(self) -> None:
        """Have what is grabbed and the arrows suit the size of the rig, as it is when it is first looked at."""
        for share, nodes in (
            (ANCHOR_SHARE, self._anchors), (HAND_SHARE, [self._hand]), (BALL_SHARE, [self._tip]),
        ):  # fmt: skip
            for node in nodes:
                node.radius = share * self._reach
        self._study.point_size = STUDY_SHARE * self._reach
        for arrow in self._arrows.values():
            for name, size_m in arrow_sizes(self._reach).items():
                setattr(arrow, name, size_m)

    def _show_gizmo(self, scene: Scene, state: State) -> None:
        """Put the handle with arrows at what is selected, unless it is being dragged."""
        if self._gizmo_held:
            return
        self._gizmo_at = state.selected
        self._gizmo.visible = state.selected in (*self._names, HAND) and state.selected != self._by_ball
        if state.selected in self._names:
            self._gizmo.position = scene.anchors[self._names.index(state.selected)]
            self._gizmo.wxyz = (1.0, 0.0, 0.0, 0.0)
            self._gizmo.disable_rotations = True
        else:
            self._gizmo.position = scene.hand
            self._gizmo.wxyz = quaternion(state.rotation)
            self._gizmo.disable_rotations = state.rotation is None

    def _make_draggable(self, node: Any, what: str | int) -> None:
        """Have a node tell when it is clicked or dragged; a module is known by its number."""

        def name() -> str:
            return self._names[what] if isinstance(what, int) else what

        # Coroutines run in their order; functions would on several threads.
        async def dragged(event: Any) -> None:
            here = name()
            if event.phase == "start":
                self._offset[here] = np.subtract(node.position, event.start_position)
                self._by_ball = here
                self._on_select(here)
            place = np.asarray(event.end_position) + self._offset.get(here, 0.0)
            self._on_grab(Grab(here, event.phase, place, np.array(event.client.camera.position)))

        async def clicked(event: Any) -> None:
            self._by_ball = ""
            self._on_select(name())

        node.on_drag("left")(dragged)
        node.on_click(clicked)

    def _follow_gizmo(self) -> None:
        async def dragged(event: Any) -> None:
            self._gizmo_held = event.phase != "end"
            turn = None if self._gizmo.disable_rotations else np.array(event.target.wxyz)
            self._on_grab(Grab(self._gizmo_at, event.phase, np.array(event.target.position), turn=turn))

        self._gizmo.on_update(dragged)


def quaternion(rotation: Floats | None) -> Floats:
    """Return the quaternion (w, x, y, z) of a rotation: a matrix in space, an angle in the plane, or none."""
    from viser import transforms

    if rotation is None:
        return np.array([1.0, 0.0, 0.0, 0.0])
    if rotation.ndim == 0:
        return np.array([np.cos(rotation / 2), 0.0, 0.0, np.sin(rotation / 2)])
    return np.asarray(transforms.SO3.from_matrix(rotation).wxyz)


def rotation_of(turn: Floats, dimension: int) -> Floats:
    """Return the rotation of a quaternion (w, x, y, z): a matrix in space, an angle about z in the plane."""
    from viser import transforms

    if dimension == 2:
        return np.asarray(2.0 * np.arctan2(turn[3], turn[0]))
    return np.asarray(transforms.SO3(np.asarray(turn, np.float64)).as_matrix())


def place_camera(server: viser.ViserServer, rig: Rig, *more: Floats, covered: float = 0.0) -> None:
    """Have browsers look at the whole rig, with its vertical axis upright; at one in the plane from the front.

    ``more`` are arrays (k, d) of points that are to be seen, too; ``covered`` is the share of the picture, from
    below, in which nothing is seen.
    """
    low, high = (in_space(each) for each in bounds(rig, *more))
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    up = in_space(rig.upward) if rig.up is not None else np.array([0.0, 1.0, 0.0])
    server.scene.set_up_direction(tuple(up))
    if rig.dimension == 2:
        away = np.array([0.0, 0.0, 1.0])
    else:
        aside = np.roll(np.abs(up), 1), np.roll(np.abs(up), 2)
        away = 1.15 * aside[0] + 0.85 * aside[1] + 0.55 * up
    camera = server.initial_camera
    camera.fov = FIELD_OF_VIEW_RAD
    distance = radius / np.sin(FIELD_OF_VIEW_RAD / 2) / (1.0 - covered)
    away = away / np.linalg.norm(away)
    upwards = up - (up @ away) * away
    middle = middle - covered * distance * np.tan(FIELD_OF_VIEW_RAD / 2) * upwards / np.linalg.norm(upwards)
    camera.position, camera.look_at, camera.up = middle + distance * away, middle, up


def add_floor(scene: Any, rig: Rig, *more: Floats) -> Any:
    """Add a grid at the lowest point of the rig, and of arrays (k, d); a rig in the plane has it behind."""
    low, high = (in_space(each) for each in bounds(rig, *more))
    reach = float((high - low).max())
    section = 10.0 ** np.floor(np.log10(reach))
    middle = (low + high) / 2
    if rig.dimension == 2:
        plane, middle[2] = "xy", -0.02 * reach
    else:
        axis = "xyz".index(rig.vertical)
        plane = "xyz".replace("xyz"[axis], "")
        middle[axis] = high[axis] if (rig.up or "").startswith("-") else low[axis]
    return scene.add_grid(
        "/floor", 3.0 * reach, 3.0 * reach, plane=plane, position=middle, cell_size=section / 5,
        section_size=section, cell_color=(150, 150, 150), section_color=(120, 120, 120), cell_thickness=0.6,
        section_thickness=1.0, fade_distance=8.0 * reach, shadow_opacity=0.0,
    )  # fmt: skip


def set_lines(node: Any, lines: Lines) -> None:
    """Show lines in a node; none hide it."""
    if len(lines.points):
        node.points, node.colors = lines.points, linear(lines.colours)
    node.visible = bool(len(lines.points))


def linear(colours: Colours) -> Colours:
    """Return colours as viser takes those of lines and arrows: linear, where all other colours are sRGB."""
    share = colours / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(255.0 * light), np.uint8)


def arrow_sizes(reach: float) -> dict[str, float]:
    """Return the sizes of arrows, in m, that suit the size of a rig."""
    return {name: share * reach for name, share in ARROW_SHARES.items()}


def add_arrows(scene: Any, colours: Mapping[str, str], reach: float) -> dict[str, Any]:
    """Add an arrow for each name and colour, hidden until `set_arrow` shows it."""
    nothing = np.zeros((1, 2, 3))
    return {
        name: scene.add_arrows(
            f"/arrows/{name}", nothing, linear(rgb(colour)), visible=False, **arrow_sizes(reach)
        )
        for name, colour in colours.items()
    }  # fmt: skip


def set_arrow(node: Any, arrow: Arrow | None) -> None:
    """Show an arrow in a node; one without a length hides it."""
    there = arrow is not None and float(np.linalg.norm(arrow.end - arrow.start)) > 0.0
    if arrow is not None and there:
        node.points = np.stack([arrow.start, arrow.end])[None]
    node.visible = there


def both_sides(mesh: Mesh) -> Mesh:
    """Return a mesh with its triangles seen from either side."""
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))


def set_mesh(node: Any, mesh: Mesh | None) -> None:
    """Show a mesh in a node that is never invisible: those that become visible are made anew, in another order."""
    shown = NOTHING if mesh is None or not len(mesh.faces) else mesh
    node.vertices, node.faces = shown.vertices, shown.faces
