"""The page of a run, in progress or from its log: one picture, and the same texts next to it."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from tensionlab.hardware.sharing import POLL_S, RunInfo, RunSnapshot
from tensionlab.model.rig import Rig
from tensionlab.scenarios.scenery import Scenery
from tensionlab.support.colours import FORCE_COLOURS
from tensionlab.viewer import run_words
from tensionlab.viewer.drawing import RigDrawing
from tensionlab.viewer.html import render
from tensionlab.viewer.run_scene import Instant, draw_instant
from tensionlab.viewer.scenery import SceneryDrawing, points_to_see
from tensionlab.viewer.server import PageServer

PANEL_PIXELS = 410.0


class RunDrawing:
    """Nodes of the scene of a run: its rig, and the surroundings of its scenario."""

    def __init__(
        self, server: Any, rig: Rig, instant: Instant, scenery: Scenery | None, covered: float = 0.0
    ) -> None:
        """Look at all that is there at an instant, but for the share ``covered`` of the picture, from below."""
        self._rig, self._scenery = rig, None
        points = [instant.anchors, instant.hand[None]]
        if scenery is not None:
            points.append(points_to_see(scenery, rig, instant)[:, : rig.dimension])
            self._scenery = SceneryDrawing(server.scene, scenery, rig, instant)
        self._drawing = RigDrawing(server, FORCE_COLOURS)
        self._drawing.look_at(rig, *points, covered=covered)

    def show(self, instant: Instant, *, fresh: bool = True) -> None:
        """Bring all nodes up to date; an instant that is not fresh is grey."""
        self._drawing.show(draw_instant(self._rig, instant, fresh=fresh))
        if self._scenery is not None:
            self._scenery.show(instant, fresh=fresh)


class RunPage(ABC):
    """Page of a run in the browser.

    Call `turn` some thirty times a second, in one thread; `serve` does.
    """

    scenery: Scenery | None = None

    def __init__(self, server: PageServer) -> None:
        self.server = server
        gui = server.viser.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()  # next to the picture, so that neither hides the other
        gui.main_panel.set_width(PANEL_PIXELS)
        gui.add_html(
            render(
                "run.animations",
            )
        )
        self._outcome, self._heading, self._phases, self._forces = (gui.add_html("") for _ in range(4))
        self._tabs = gui.add_tab_group()
        with self._tabs.add_tab("Modules"):
            self._modules = gui.add_html("")
        with self._tabs.add_tab("Events"):
            self._events = gui.add_html("")
        with self._tabs.add_tab("Loop"):
            self._times = gui.add_html("")

    @abstractmethod
    def turn(self) -> None:
        """Take what is new, and bring all browsers up to date."""

    def show_texts(
        self,
        info: RunInfo,
        report: RunSnapshot,
        instant: Instant,
        *,
        fresh: bool,
        wrap: Callable[[str], str] = str,
    ) -> None:
        """Bring the texts about a report and its instant up to date, each wrapped by a function."""
        for part, html in (
            (self._phases, render("run.phases", self.scenery, instant.time)),
            (self._forces, run_words.forces(info.rig, instant)),
            (self._modules, run_words.modules(info, report, instant, fresh=fresh)),
            (self._times, run_words.times(info, report)),
        ):
            part.content = wrap(html)

    def serve(self, until: Callable[[], bool]) -> None:
        """Show the run until a function, called in each turn, returns true."""
        while not until():
            self.turn()
            time.sleep(POLL_S)

    def close(self) -> None:
        """Close the page."""
        self.server.close()
