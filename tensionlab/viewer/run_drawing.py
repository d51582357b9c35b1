"""A run in the browser: nodes of viser that follow what is drawn of its instants; nothing can be grabbed."""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery
from tensionlab.scenarios.stick_figure import HEAD_M
from tensionlab.support.colours import GREY, RED, rgb
from tensionlab.viewer.drawing import (
    ANCHOR_SHARE,
    CABLE_PIXELS,
    HAND_SHARE,
    NOTHING,
    THIN_PIXELS,
    add_arrows,
    add_floor,
    place_camera,
    set_arrow,
    set_lines,
    set_mesh,
)
from tensionlab.viewer.instant import ARROW_COLOURS, Instant, draw
from tensionlab.viewer.scene import size
from tensionlab.viewer.scenery import PERSON_COLOUR, SceneryScene, draw_scenery

if TYPE_CHECKING:
    import viser

LIMB_THICKNESS_M = 0.03
MAX_NAMES = 10
"""Of bodies and phases that are seen at once."""


class SceneryDrawing:
    """Nodes of what is around the rig of a run; as many as there are in the first scene."""

    def __init__(self, scene: Any, first: SceneryScene) -> None:
        self._meshes = [
            scene.add_mesh_simple(
                f"/scenery/{i}", NOTHING.vertices, NOTHING.faces, color=tuple(rgb(each.colour)), opacity=0.35,
                side="double", cast_shadow=False, receive_shadow=False,
            )
            for i, each in enumerate(first.surfaces)
        ]  # fmt: skip
        nothing = np.zeros((1, 2, 3))
        self._edges = [
            scene.add_line_segments(
                f"/edges/{i}", nothing, rgb(GREY), thickness=THIN_PIXELS, thickness_units="screen"
            )
            for i in range(len(first.surfaces))
        ]
        self._person = scene.add_line_segments(
            "/person", nothing, rgb(GREY), thickness=LIMB_THICKNESS_M, thickness_units="world", visible=False
        )
        self._head = scene.add_icosphere("/head", HEAD_M, color=tuple(rgb(PERSON_COLOUR)), cast_shadow=False)
        self._head.visible = first.head is not None
        self._labels = [scene.add_label(f"/names/{i}", "", anchor="top-left") for i in range(MAX_NAMES)]

    def show(self, scene: SceneryScene) -> None:
        """Bring all nodes up to date."""
        for surface, mesh, edges in zip(scene.surfaces, self._meshes, self._edges, strict=True):
            set_mesh(mesh, surface.mesh)
            mesh.color = tuple(int(part) for part in rgb(surface.colour))
            set_lines(edges, surface.edges)
        set_lines(self._person, scene.person)
        if scene.head is not None:
            self._head.position = scene.head
        for node, label in zip_longest(self._labels, scene.labels[:MAX_NAMES]):
            node.visible = label is not None
            if label is not None:
                node.text, node.position = label.text, label.place


class RunDrawing:
    """Nodes of the scene of a run; `show` brings them up to date in place.

    Browsers look at the rig and at where modules and hand are at an instant: bodies are elsewhere by then.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        rig: Rig,
        instant: Instant,
        scenery: Scenery | None = None,
        *,
        covered: float = 0.0,
    ) -> None:
        seen = np.concatenate([instant.anchors, instant.hand[None]])
        self._rig, self._scenery = rig, scenery
        self._around: SceneryDrawing | None = None
        if scenery is not None:
            first = draw_scenery(scenery, rig, instant)
            seen = np.concatenate([seen, first.points[:, : rig.dimension]])
            self._around = SceneryDrawing(server.scene, first)
        scene, reach, nothing = server.scene, size(rig), np.zeros((1, 2, 3))
        place_camera(server, rig, seen, covered=covered)
        scene.world_axes.visible = False
        self._floor = add_floor(scene, rig, seen)
        self._cables, self._platform = (
            scene.add_line_segments(
                name, nothing, rgb(GREY), thickness=pixels, thickness_units="screen", visible=False
            )
            for name, pixels in (("/cables", CABLE_PIXELS), ("/platform", THIN_PIXELS))
        )
        self._arrows = add_arrows(scene, ARROW_COLOURS, reach)
        self._hand = scene.add_icosphere(
            "/hand", HAND_SHARE * reach, color=tuple(rgb(RED)), cast_shadow=False, visible=False
        )
        self._anchors = [
            scene.add_icosphere(f"/anchors/{i}", ANCHOR_SHARE * reach, cast_shadow=False, visible=False)
            for i in range(rig.m)
        ]
        self._labels = [scene.add_label(f"/labels/{i}", "", anchor="bottom-left") for i in range(rig.m)]

    def show(self, instant: Instant, *, fresh: bool = True) -> None:
        """Bring all nodes up to date; an instant that is not fresh is grey."""
        scene = draw(self._rig, instant, fresh=fresh)
        if self._around is not None and self._scenery is not None:
            self._around.show(draw_scenery(self._scenery, self._rig, instant, fresh=fresh))
        set_lines(self._cables, scene.cables)
        set_lines(self._platform, scene.platform)
        for name, node in self._arrows.items():
            set_arrow(node, scene.arrows.get(name))
        self._hand.position, self._hand.visible = scene.hand, True
        for anchor, label, place, colour, words in zip(
            self._anchors, self._labels, scene.anchors, scene.colours, scene.labels, strict=True
        ):
            anchor.position = label.position = place
            red, green, blue = (int(part) for part in colour)
            anchor.color, anchor.visible = (red, green, blue), True
            label.text = words.text
