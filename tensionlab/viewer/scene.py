"""The scene of both pages: a rig with its tensions and forces, as arrays and as nodes of viser that follow them.

Everything is in space and in m; a rig in the plane lies in the plane z = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.kinematics import in_space
from tensionlab.model.pose import place_anchors
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREY, ORANGE, RED, Colours, rgb

if TYPE_CHECKING:
    import viser

MIN_EDGE = 0.5  # shortest edge of the box around a rig, as a share of the longest one
FORCE_SHARE = 0.25  # length of the arrow of the strongest tension, about, as a share of the size of the rig
SLACK_N = 1e-9
# Radii of the balls at modules and hand, and dimensions of arrows, as shares of the size of the rig.
ANCHOR_SHARE, HAND_SHARE = 0.012, 0.015
LABEL_SHARE = 1.5 * ANCHOR_SHARE  # distance of labels above modules, as such a share
ARROW_SHARES = {"shaft_radius": 0.004, "head_radius": 0.010, "head_length": 0.03}
FIELD_OF_VIEW_RAD = 0.7
LABEL_ROOM = 1.12  # factor on the distance of the camera, so that labels at the border are whole
PHONE_COVERED = 0.45  # share of an upright picture that the panel covers, from below
CABLE_PIXELS, THIN_PIXELS = 3.0, 1.5
NO_LINE = np.zeros((1, 2, 3))


@dataclass(frozen=True)
class Mesh:
    """Triangles in space: vertices (k, 3), in m, and faces (f, 3), seen anticlockwise from outside."""

    vertices: Floats
    faces: NDArray[np.int64]


@dataclass(frozen=True)
class Lines:
    """Line segments (k, 2, 3), in m, and their colours (k, 3)."""

    points: Floats
    colours: Colours


@dataclass(frozen=True, eq=False)
class RigScene:
    """A rig with its tensions and forces, as it is drawn while it is designed and while it runs."""

    cables: Lines  # by tension
    platform: Lines  # its arms
    anchors: Floats  # modules, (m, 3), in m
    colours: Colours  # of the modules, (m, 3)
    hand: Floats  # the point, or the platform's reference point, (3,), in m
    labels: tuple[str, ...]  # name and tension of each module
    arrows: dict[str, Floats]  # start and end of each force, (2, 3), in m, by its name


def bounds(rig: Rig, *more: Floats) -> tuple[Floats, Floats]:
    """Return the corners, (d,), in m, of a box around the anchors, the home and further points (k, d) of a rig.

    Where all of them are nearly in a plane, as on a ceiling, the box reaches beyond it on the side of home.
    """
    points = np.concatenate([place_anchors(rig.modules, rig.anchors, rig.at_rest), rig.home[None], *more])
    low, high = points.min(axis=0), points.max(axis=0)
    missing = np.maximum(MIN_EDGE * float((high - low).max()) - (high - low), 0.0)
    below = np.where(rig.home - low < high - rig.home, 1.0, np.where(rig.home - low > high - rig.home, 0.0, 0.5))
    return low - below * missing, high + (1.0 - below) * missing


def size(rig: Rig) -> float:
    """Return the longest edge of the box around a rig, in m."""
    return float(np.ptp(bounds(rig), axis=0).max())


def force_scale(rig: Rig) -> float:
    """Return the length in m that is drawn for 1 N: a round number that suits the rig's size and tensions."""
    wanted = FORCE_SHARE * size(rig) / max(float(rig.limits.upper.max()), SLACK_N)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1 + 1e-12))


def module_colours(rig: Rig) -> Colours:
    """Return the colour of each module, (m, 3), which tells those on bodies from those in the world."""
    bodies = np.array([module.frame in rig.frames for module in rig.modules])
    return np.where(bodies[:, None], rgb(ORANGE), rgb(BLUE))


def cable_lines(points: Floats, colours: Colours) -> Lines:
    """Return the lines of cables through points (k, m, 3) from their attachments on, of colours (m, 3) or (3,)."""
    pieces = np.stack([points[:-1], points[1:]], axis=2)
    return Lines(pieces.reshape(-1, 2, 3), np.broadcast_to(colours, (*pieces.shape[:2], 3)).reshape(-1, 3))


def plain_lines(points: Floats, colour: str) -> Lines:
    """Return lines (k, 2, 3) of one colour."""
    return Lines(points, np.tile(rgb(colour), (len(points), 1)))


NO_LINES = plain_lines(np.empty((0, 2, 3)), GREY)


def platform_lines(hand: Floats, ends: Floats) -> Lines:
    """Return lines from the reference point to the attachments; none for a point."""
    arms = ends[np.linalg.norm(ends - hand, axis=1) > 0.0]
    return plain_lines(np.stack([np.broadcast_to(hand, arms.shape), arms], axis=1), GREY)


class RigDrawing:
    """Nodes of a rig; `show` brings them up to date in place."""

    def __init__(
        self,
        server: viser.ViserServer,
        colours: Mapping[str, str],
        on_new_module: Callable[[Any, int], None] = lambda ball, index: None,
    ) -> None:
        """``colours`` are those of the arrows; ``on_new_module`` gets the ball of each module that is added."""
        self._server, self._on_new_module = server, on_new_module
        self._scene = scene = server.scene
        self.reach = 1.0  # size of the rig when `look_at` was last called, in m
        self._up = np.array([0.0, 1.0, 0.0])
        server.on_client_connect(self._look_from_phone)
        scene.world_axes.visible = False
        scene.add_light_ambient("/light", intensity=1.5)
        self._cables = add_lines(scene, "cables", CABLE_PIXELS)
        self._platform = add_lines(scene, "platform")
        self._arrows = {
            name: scene.add_arrows(f"/arrows/{name}", NO_LINE, linear(rgb(colour)), visible=False)
            for name, colour in colours.items()
        }
        self.hand = scene.add_icosphere("/hand", color=rgb(RED), cast_shadow=False)
        self._balls: list[Any] = []
        self._labels: list[Any] = []

    def look_at(self, rig: Rig, *points: Floats, covered: float = 0.0) -> None:
        """Point the camera at the rig, put the floor below it, and have all sizes suit it.

        ``points`` are arrays (k, d) to show as well; ``covered`` is the share of the picture, from below, that
        something else covers.
        """
        self._view, self._up = partial(camera_pose, rig, *points), upward(rig)
        self._server.scene.set_up_direction(tuple(self._up))
        camera = self._server.initial_camera
        camera.fov = FIELD_OF_VIEW_RAD
        camera.position, camera.look_at, camera.up = self._view(covered=covered)
        low, high = (in_space(corner) for corner in bounds(rig, *points))
        middle, reach = (low + high) / 2, float((high - low).max())
        if rig.dimension == 2:  # behind the rig
            plane, middle[2] = "xy", -0.02 * reach
        else:
            axis = "xyz".index(rig.vertical)
            plane = "xyz".replace(rig.vertical, "")
            middle[axis] = high[axis] if (rig.up or "").startswith("-") else low[axis]
        section = 10.0 ** np.floor(np.log10(reach))
        add_grid: Any = self._scene.add_grid  # replaces the grid before
        add_grid(
            "/floor", 3.0 * reach, 3.0 * reach, plane=plane, position=middle, cell_size=section / 5,
            section_size=section, cell_color=(150, 150, 150), section_color=(120, 120, 120), cell_thickness=0.6,
            section_thickness=1.0, fade_distance=8.0 * reach, shadow_opacity=0.0,
        )  # fmt: skip
        self.reach = size(rig)

    async def _look_from_phone(self, client: Any) -> None:
        """Have a browser whose picture is upright see the rig above the panel."""
        camera = client.camera
        aspect = camera.image_width / max(camera.image_height, 1)
        if aspect < 1.0 - PHONE_COVERED / 2:
            with client.atomic():
                camera.position, camera.look_at, camera.up_direction = self._view(
                    covered=PHONE_COVERED, aspect=aspect
                )

    def show(self, scene: RigScene) -> None:
        """Bring all nodes up to date."""
        set_lines(self._cables, scene.cables)
        set_lines(self._platform, scene.platform)
        for name, node in self._arrows.items():
            arrow = scene.arrows.get(name, NO_LINE[0])
            node.visible = bool((arrow[0] != arrow[1]).any())
            if node.visible:
                node.points = arrow[None]
                for part, share in ARROW_SHARES.items():
                    setattr(node, part, share * self.reach)
        self.hand.position, self.hand.radius = scene.hand, HAND_SHARE * self.reach
        self._match_modules(len(scene.anchors))
        for ball, label, place, colour, text in zip(
            self._balls, self._labels, scene.anchors, scene.colours, scene.labels, strict=True
        ):
            ball.position, label.position = place, place + LABEL_SHARE * self.reach * self._up
            ball.color, ball.radius = tuple(colour.tolist()), ANCHOR_SHARE * self.reach
            label.text = text

    def _match_modules(self, count: int) -> None:
        while len(self._balls) > count:
            self._balls.pop().remove()
            self._labels.pop().remove()
        for i in range(len(self._balls), count):
            ball = self._scene.add_icosphere(f"/anchors/{i}", color=rgb(BLUE), cast_shadow=False)
            self._balls.append(ball)
            self._labels.append(self._scene.add_label(f"/labels/{i}", "", anchor="bottom-center"))
            self._on_new_module(ball, i)


def upward(rig: Rig) -> Floats:
    """Return the direction, (3,), that is drawn upright: that of the rig, or y."""
    return in_space(rig.upward) if rig.up is not None else np.array([0.0, 1.0, 0.0])


def camera_pose(
    rig: Rig, *points: Floats, covered: float = 0.0, aspect: float = 1.0
) -> tuple[Floats, Floats, Floats]:
    """Return where a camera is that sees the whole rig, at what it looks, and its axis that is up.

    A rig in the plane is seen from the front. ``points`` and ``covered`` are as in `RigDrawing.look_at`;
    ``aspect`` is the width of the picture by its height.
    """
    low, high = (in_space(corner) for corner in bounds(rig, *points))
    middle, up = (low + high) / 2, upward(rig)
    away = np.array([0.0, 0.0, 1.0])
    if rig.dimension == 3:
        away = 1.15 * np.roll(np.abs(up), 1) + 0.85 * np.roll(np.abs(up), 2) + 0.55 * up
    away = away / np.linalg.norm(away)
    half = np.tan(FIELD_OF_VIEW_RAD / 2)
    radius = LABEL_ROOM * float(np.linalg.norm(high - low)) / 2
    distance = radius / np.sin(FIELD_OF_VIEW_RAD / 2) / min(1.0 - covered, aspect)
    upwards = up - (up @ away) * away
    middle = middle - covered * distance * half * upwards / np.linalg.norm(upwards)
    return middle + distance * away, middle, up


def linear(colours: Colours) -> Colours:
    """Return colours as viser takes those of lines and arrows: linear, where all other colours are sRGB."""
    share = colours / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(255.0 * light), np.uint8)


def add_lines(scene: Any, name: str, pixels: float = THIN_PIXELS) -> Any:
    """Add lines, hidden until `set_lines` shows them."""
    return scene.add_line_segments(
        f"/{name}", NO_LINE, (0, 0, 0), thickness=pixels, thickness_units="screen", visible=False
    )


def set_lines(node: Any, lines: Lines) -> None:
    """Show lines in a node; none hide it."""
    if len(lines.points):
        node.points, node.colors = lines.points, np.repeat(linear(lines.colours)[:, None], 2, axis=1)
    node.visible = bool(len(lines.points))


def set_mesh(node: Any, mesh: Mesh | None) -> None:
    """Show a mesh in a node; none hides it."""
    node.visible = mesh is not None and len(mesh.faces) > 0
    if mesh is not None and node.visible:
        node.vertices, node.faces = mesh.vertices, mesh.faces
