"""The design page: what people do becomes edits of one state, and every browser shows that state."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tensionlab.errors import InputError, TensionlabError
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.viewer import export, volume
from tensionlab.viewer import state as edits
from tensionlab.viewer.drawing import TIP, Drawing, Grab, rotation_of
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.history import UNDONE, History
from tensionlab.viewer.latest import Latest
from tensionlab.viewer.layout_runner import LayoutRunner
from tensionlab.viewer.panel import Panel, load_space, pressed
from tensionlab.viewer.scene import draw, force_scale
from tensionlab.viewer.server import PageServer
from tensionlab.viewer.snapping import wall_behind
from tensionlab.viewer.solver_study import compare, points
from tensionlab.viewer.state import HAND, Edit, State
from tensionlab.viewer.workspace import WorkspaceWorker
from tensionlab.workspace.layout.results import Layout

COMPARED_BY = (*UNDONE, "solver", "policy", "compared", "study", "selected")
"""Attributes of a state that the comparison of solvers depends on."""
NOTICE_S = 8.0
"""How long it is shown that something was done."""


@dataclass(frozen=True)
class Request:
    """Edit to be made; one that is followed by another with the same key before its turn is left out."""

    edit: Edit
    step: object = None
    key: object = None


class DesignPage:
    """A rig in the browser, to be designed.

    People's edits wait in a queue. One thread takes them in their order, evaluates what has become of the state,
    and brings the scene and the panel up to date; another evaluates the workspace. So however fast a mouse moves,
    there is one allocation for each picture.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.viewer.page import DesignPage
    >>> from tensionlab.viewer.server import PageServer
    >>> page = DesignPage(tl.load_rig("bartels2026-validation"), PageServer())  # doctest: +SKIP
    """

    def __init__(self, rig: Rig, server: PageServer, word: str = "") -> None:
        self.server = server
        self.history = History(edits.begin(rig))
        self.loaded = rig
        self._word = word
        self._folder = Path.cwd()
        self._modal: Any = None
        self._queue: deque[Request | Callable[[], object]] = deque()
        self._wake = threading.Condition()
        self._open = True
        self._step: object = None
        self._search_step: object = None
        self._dragging = False
        self._compared: State | None = None
        self._looked_at: tuple[object, ...] = (None,) * 5
        present = self.history.present
        self._drawing = Drawing(server.viser, present, self._grab, self._select)
        self._workspace = WorkspaceWorker(self._volume_found)
        self._solvers: Latest[State] = Latest("solvers", self._compare)
        self._search = LayoutRunner(self._layout_found, self._search_said)
        self._panel = Panel(server.viser, self, self._default_path, self._folder)
        self._thread = threading.Thread(target=self._work, name="view", daemon=True)
        self._show()
        self._thread.start()

    @property
    def state(self) -> State:
        """The present state."""
        return self.history.present

    def edit(self, change: Edit, step: object = None, key: object = None) -> None:
        """Have an edit made, in its turn; from any thread."""
        self._put(Request(change, step, key))

    def undo(self) -> None:
        """Have the last step undone."""
        self._put(self.history.undo)

    def redo(self) -> None:
        """Have the step that was undone last made again."""
        self._put(self.history.redo)

    def save(self, path: str) -> None:
        """Have the rig saved, if it can work."""
        self._put(lambda: self._tell("Saved", f"{export.save(self.state.rig, path, self._folder)}"))

    def download_model(self) -> None:
        """Send every browser the rig as a MuJoCo model."""

        def send() -> None:
            rig = self.state.rig
            self.server.viser.send_file_download(export.file_name(rig, ".xml"), rig_to_mjcf(rig).encode())

        self._put(send)

    def show_python(self) -> None:
        """Show a program that does what the page shows; one at a time."""

        def close(_: object = None) -> None:
            modal, self._modal = self._modal, None
            if modal is not None:
                modal.close()

        def show() -> None:
            close()
            gui = self.server.viser.gui
            self._modal = gui.add_modal("As Python")
            with self._modal:
                unchanged = self.state.rig == self.loaded and self._word
                source = unchanged or self._default_path(self.state.rig)
                gui.add_markdown(f"```python\n{export.python_text(self.state, source)}```")
                pressed(gui.add_button("Close"), lambda: self._put(close))

        self._put(show)

    def _default_path(self, rig: Rig) -> str:
        return export.default_path(rig, self._word, self._folder)

    def search(self, space: str) -> None:
        """Have a layout searched for in a space, by its name or file; the best so far is shown as it is found."""

        def start() -> None:
            if not space.strip():
                raise InputError("no space is chosen; give the name of one, or its file, in the tab Search")
            self._search_step = object()
            self._search.start(self.state.task or load_space(space, self._folder), self.state.rig)

        self._put(start)

    def stop_search(self) -> None:
        """End the search; the best rig so far stays, until it is undone."""
        self._put(self._search.stop)

    def _layout_found(self, layout: Layout) -> None:
        self.edit(lambda state: edits.replace_rig(state, layout.rig), self._search_step, "layout")

    def _search_said(self, share: float, said: str) -> None:
        self._panel.show_search(share, said)

    def _tell(self, title: str, text: str) -> None:
        for client in self.server.viser.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=NOTICE_S)

    def close(self) -> None:
        """End both threads and the server."""
        with self._wake:
            self._open = False
            self._wake.notify_all()
        self._thread.join()
        self._search.stop()
        self._workspace.close()
        self._solvers.close()
        self.server.close()

    def _put(self, request: Request | Callable[[], object]) -> None:
        with self._wake:
            last = self._queue[-1] if self._queue else None
            if (
                isinstance(request, Request) and isinstance(last, Request) and request.key is not None
                and request.key == last.key and request.step is last.step
            ):  # fmt: skip
                self._queue.pop()
            self._queue.append(request)
            self._wake.notify_all()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._queue or not self._open)
                if not self._open:
                    return
                waiting = list(self._queue)
                self._queue.clear()
            shown, problem = self.state, ""
            for request in waiting:
                try:
                    if isinstance(request, Request):
                        self.history.record(request.edit(self.state), request.step)
                    else:
                        request()
                except Exception as error:  # whatever it is, the page goes on
                    problem = described(error)
            try:
                self._show(problem)
            except Exception as error:  # a state that cannot be shown is not kept
                self.history.present = shown
                self._show(described(error))

    def _show(self, problem: str = "") -> None:
        """Bring all browsers up to date."""
        state = self.state
        found = evaluate(state)
        with self.server.viser.atomic():
            self._drawing.show(draw(state, found), state)
            self._panel.show(state, found, self.history, problem)
        self.server.viser.flush()
        if state.display == "off" and self._looked_at[0] is not None:
            self._looked_at = (None,) * 5
            self._drawing.show_workspace(None, None, [])
        self._workspace.want(state, fine=not self._dragging)
        if state.compared or self._compared is not None:
            self._solvers.want(state)

    def _compare(self, state: State, wanted: Callable[[], bool]) -> None:
        """Compare solvers, on a thread of its own, unless that was done for a state that is the same in it."""
        if self._compared is not None and all(
            getattr(state, name) is getattr(self._compared, name) for name in COMPARED_BY
        ):
            return
        found = compare(state, wanted)
        if found is None:
            return
        self._compared = state if state.compared else None
        asked, answers = found
        with self.server.viser.atomic():
            places, colours = points(state, asked, answers[0])
            self._drawing.show_study(places[: len(places) * bool(state.compared)], colours)
            self._panel.show_answers(state, asked, answers)
        self.server.viser.flush()

    def _volume_found(self, state: State, found: volume.Volume, ghost: volume.Volume | None) -> None:
        """Show the workspace that another thread has evaluated."""
        shown = self.state  # which may be looked at otherwise meanwhile
        looked_at = (found, ghost, shown.display, shown.level, shown.display == "slices" and shown.position)
        if all(one is other for one, other in zip(looked_at, self._looked_at, strict=True)):
            return
        self._looked_at = looked_at
        surfaces = [
            volume.surface(each, shown.level) if each is not None and shown.display == "surface" else None
            for each in (found, ghost)
        ]
        slices = volume.slices(found, shown.position, shown.level) if shown.display == "slices" else []
        with self.server.viser.atomic():
            self._drawing.show_workspace(surfaces[0], surfaces[1], slices)
            self._panel.show_volume(shown, found, ghost)
        self.server.viser.flush()

    def _select(self, name: str) -> None:
        if name != TIP:
            self.edit(edits.choose(selected=name))

    def _grab(self, grab: Grab) -> None:
        """Turn a drag into edits, of which undo makes one."""
        if grab.phase == "start":
            self._step = object()
        self._dragging = grab.phase != "end"
        self.edit(lambda state: dragged(state, grab), self._step, ("drag", grab.what))


def described(error: Exception) -> str:
    """Return an error in words: its own if it is one of this package, else with its kind."""
    return str(error) if isinstance(error, TensionlabError) else f"{type(error).__name__}: {error}"


def dragged(state: State, grab: Grab) -> State:
    """Return the state after something was dragged to a place."""
    d = state.rig.dimension
    place = grab.place if d == 3 or grab.eye is None else on_plane(grab.eye, grab.place)
    if grab.what == TIP:
        force = (place[:d] - state.position) / force_scale(state.rig)
        return edits.desire(state, np.concatenate([np.round(force, edits.DECIMALS), state.wrench[d:]]))
    if grab.what == HAND:
        moved = edits.move_hand(state, place[:d])
        return moved if grab.turn is None else edits.turn_platform(moved, rotation_of(grab.turn, d))
    if state.task is not None and grab.eye is not None:
        wall = wall_behind(state.task.space, grab.eye, grab.place)
        place = place if wall is None else wall
    return edits.move_anchor(state, grab.what, place[:d])


def on_plane(eye: Floats, through: Floats) -> Floats:
    """Return where the ray from the eye through a place meets the plane z = 0; that place if it does not."""
    along = through - eye
    if abs(along[2]) < 1e-9 * float(np.linalg.norm(along)):
        return through
    return np.asarray(eye - eye[2] / along[2] * along)
