"""A run in the browser: nodes of viser that follow what is drawn of its instants; nothing can be grabbed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tensionlab.display import GREY, RED
from tensionlab.model.rig import Rig
from tensionlab.view.drawing import (
    ANCHOR_SHARE,
    CABLE_PIXELS,
    HAND_SHARE,
    THIN_PIXELS,
    add_floor,
    place_camera,
    set_arrow,
    set_lines,
)
from tensionlab.view.instant import ARROW_COLOURS, Instant, InstantScene
from tensionlab.view.scene import rgb, size

if TYPE_CHECKING:
    import viser


class RunDrawing:
    """Nodes of the scene of a run; `show` brings them up to date in place.

    Browsers look at the rig and at where modules and hand are at an instant: bodies are elsewhere by then.
    """

    def __init__(self, server: viser.ViserServer, rig: Rig, instant: Instant, *, covered: float = 0.0) -> None:
        seen = np.concatenate([instant.anchors, instant.hand[None]])
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
        self._arrows = {
            name: scene.add_arrows(
                f"/arrows/{name}", nothing, rgb(colour), shaft_radius=0.004 * reach, head_radius=0.010 * reach,
                head_length=0.03 * reach, visible=False,
            )
            for name, colour in ARROW_COLOURS.items()
        }  # fmt: skip
        self._hand = scene.add_icosphere(
            "/hand", HAND_SHARE * reach, color=tuple(rgb(RED)), cast_shadow=False, visible=False
        )
        self._anchors = [
            scene.add_icosphere(f"/anchors/{i}", ANCHOR_SHARE * reach, cast_shadow=False, visible=False)
            for i in range(rig.m)
        ]
        self._labels = [scene.add_label(f"/labels/{i}", "", anchor="bottom-left") for i in range(rig.m)]

    def show(self, scene: InstantScene) -> None:
        """Bring all nodes up to date."""
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
