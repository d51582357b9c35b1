"""The design page: what people do becomes edits of one state, and every browser shows that state."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Callable

import numpy as np

from tensionlab.model.rig import Rig
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_panel import DesignPanel
from tensionlab.viewer.design_scene import TIP, DesignDrawing, Grab, draw, rotation_of
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.history import UNDOABLE, EditQueue
from tensionlab.viewer.html import render
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.server import PageServer
from tensionlab.viewer.solver_comparison import compare
from tensionlab.viewer.state import HAND, DesignState
from tensionlab.viewer.worker import Latest
from tensionlab.viewer.workspace import Volume, WorkspaceWorker, surface

# Attributes of a state that the comparison of solvers depends on.
COMPARED_BY = (*UNDOABLE, "solver", "policy", "compared", "study", "selected")
HEIGHT_PIXELS = 640  # height of the page in a notebook


class DesignPage:
    """A rig in the browser, to be designed; a notebook shows it where it is the value of a cell.

    The thread of a queue makes people's edits, evaluates the state, and brings the scene and the panel up to date;
    others evaluate the workspace and compare solvers.
    """

    def __init__(self, rig: Rig, server: PageServer, source: str = "") -> None:
        """``source`` is the name or the file that the rig is from; it is saved there by default."""
        rig.require_position("pages")
        self.server = server
        self._step: object = None
        self._dragging = False
        self._compared: DesignState | None = None
        self._shown_volume: tuple[object, ...] = ()
        self._queue = EditQueue(edits.opening(rig), self._show)
        self.edit = self._queue.edit
        self._drawing = DesignDrawing(server.viser, self.state, self._grab, self._select)
        self._workspace = WorkspaceWorker(self._show_volume)
        self._solvers: Latest[DesignState] = Latest("solvers", self._compare)
        self._panel = DesignPanel(server.viser, self._queue, rig, source)
        self._queue.start()

    @property
    def state(self) -> DesignState:
        """Present state."""
        return self._queue.history.present

    @property
    def rig(self) -> Rig:
        """Rig as it is designed now."""
        return self.state.rig

    @property
    def url(self) -> str:
        """Address of the page on this computer."""
        return self.server.url

    def __repr__(self) -> str:
        return f"<DesignPage of {self.rig.name} at {self.url}>"

    def _repr_html_(self) -> str:
        return render("design.frame", self.url, self.rig.name, HEIGHT_PIXELS)

    def close(self) -> None:
        """Close the page; the rig stays as it was designed."""
        atexit.unregister(self.close)
        self._queue.close()
        self._workspace.close()
        self._solvers.close()
        self.server.close()

    def _show(self, problem: str) -> None:
        """Bring all browsers up to date."""
        state = self.state
        evaluation = evaluate(state)
        with self.server.viser.atomic():
            self._drawing.show(draw(state, evaluation), state)
            self._panel.show(state, evaluation, problem)
            if not state.show_workspace and self._shown_volume:
                self._shown_volume = ()
                self._drawing.show_workspace(None, None)
        self.server.viser.flush()
        self._workspace.submit(state, fine=not self._dragging)
        if state.compared or self._compared is not None:
            self._solvers.put(state)

    def _compare(self, state: DesignState, wanted: Callable[[], bool]) -> None:
        """Compare solvers, unless that was done for a state that is the same in it."""
        if self._compared is not None and all(
            getattr(state, name) is getattr(self._compared, name) for name in COMPARED_BY
        ):
            return
        comparison = compare(state, wanted)
        if comparison is None:
            return
        self._compared = state if state.compared else None
        with self.server.viser.atomic():
            self._panel.solvers.show(state, *comparison)
        self.server.viser.flush()

    def _show_volume(self, found: Volume, ghost: Volume | None) -> None:
        """Show a workspace from the thread that evaluates it, as the present state has it shown."""
        state = self.state
        shown = (found, ghost, state.level)
        if not state.show_workspace or shown == self._shown_volume:
            return
        self._shown_volume = shown
        other = None if ghost is None else surface(ghost, state.level)
        with self.server.viser.atomic():
            self._drawing.show_workspace(surface(found, state.level), other)
            self._panel.show_volume(state, found, ghost)
        self.server.viser.flush()

    def _select(self, name: str) -> None:
        if name != TIP:
            self.edit(edits.set_fields(selected=name))

    def _grab(self, grab: Grab) -> None:
        """Turn a drag into edits, of which undo makes one."""
        if grab.phase == "start":
            self._step = object()
        self._dragging = grab.phase != "end"
        self.edit(lambda state: dragged(state, grab), self._step)


def view(rig: Rig) -> DesignPage:
    """Open the design page of a rig: inline in a notebook, in a browser elsewhere.

    A thread serves it until it is closed or this process ends. The page has ``url``, ``rig`` (as it is designed
    now) and ``close()``. MissingDependency if viser is not installed.

    Examples
    --------
    >>> import tensionlab as tl
    >>> page = tl.view(tl.load_rig("bartels2026-validation"))  # doctest: +SKIP
    >>> designed = page.rig  # doctest: +SKIP
    """
    page = DesignPage(rig, PageServer())
    atexit.register(page.close)  # before viser closes its server, and says so
    if not in_notebook():
        page.server.open_browser()
    return page


def in_notebook() -> bool:
    """Return whether this process computes for a notebook, which shows values of cells as HTML."""
    ipython = sys.modules.get("IPython")  # a notebook's process has imported it
    shell = None if ipython is None else ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None


def dragged(state: DesignState, grab: Grab) -> DesignState:
    """Return the state after something was dragged to a place; with the mouse, in the plane of a planar rig."""
    d, place, eye = state.rig.dimension, grab.place, grab.eye
    if d == 2 and eye is not None and abs(eye[2] - place[2]) > 1e-9 * float(np.linalg.norm(place - eye)):
        place = eye - eye[2] / (place[2] - eye[2]) * (place - eye)  # along the ray
    if grab.what == TIP:
        force = (place[:d] - state.position) / force_scale(state.rig)
        return edits.set_wrench(state, np.concatenate([np.round(force, edits.DECIMALS), state.wrench[d:]]))
    if grab.what == HAND:
        moved = edits.move_hand(state, place[:d])
        return moved if grab.turn is None else edits.turn_platform(moved, rotation_of(grab.turn, d))
    return edits.move_anchor(state, grab.what, place[:d])
