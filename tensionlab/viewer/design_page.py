"""The design page: what people do becomes edits of one state, and every browser shows that state."""

from __future__ import annotations

import atexit
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np

from tensionlab.errors import RigError, TensionlabError, WriteError
from tensionlab.model.files import save_rig
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files import writing
from tensionlab.support.files.named import is_path, list_names
from tensionlab.validation.rig_check import check_rig
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_panel import DesignPanel
from tensionlab.viewer.design_scene import TIP, DesignDrawing, Grab, draw, rotation_of
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.server import PageServer
from tensionlab.viewer.solver_comparison import compare
from tensionlab.viewer.state import HAND, UNDOABLE, DesignState, Edit, History
from tensionlab.viewer.workspace import Latest, Volume, WorkspaceWorker, surface
from tensionlab.workspace.layout.task import LayoutTask, load_task

# Attributes of a state that the comparison of solvers depends on.
COMPARED_BY = (*UNDOABLE, "solver", "policy", "compared", "study", "selected")
SUFFIX = ".toml"  # of files of rigs and spaces
NOTICE_S = 8.0  # duration of a notice that something was done
HEIGHT_PIXELS = 640  # height of the page in a notebook


class DesignPage:
    """A rig in the browser, to be designed; a notebook shows it where it is the value of a cell.

    People's edits wait in a queue. One thread takes them in their order, evaluates the state, and brings the scene
    and the panel up to date; others evaluate the workspace and compare solvers. So however fast a mouse moves,
    there is one allocation for each picture.
    """

    def __init__(self, rig: Rig, server: PageServer, source: str = "") -> None:
        """``source`` is the name or the file that the rig is from; it is saved there by default."""
        self.server = server
        self.history = History(edits.begin(rig))
        self._folder = Path.cwd()
        self._queue: list[tuple[object, Callable[[], object]]] = []
        self._wake = threading.Condition()
        self._open = True
        self._step: object = None
        self._dragging = False
        self._compared: DesignState | None = None
        self._shown_volume: tuple[object, ...] = ()
        self._drawing = DesignDrawing(server.viser, self.state, self._grab, self._select)
        self._workspace = WorkspaceWorker(self._volume_found)
        self._solvers: Latest[DesignState] = Latest("solvers", self._compare)
        file = source if is_path(source, SUFFIX) else f"{rig.name}{SUFFIX}"
        self._panel = DesignPanel(server.viser, self, rig, file)
        self._thread = threading.Thread(target=self._work, name="view", daemon=True)
        self._show()
        self._thread.start()

    @property
    def state(self) -> DesignState:
        """Present state."""
        return self.history.present

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
        return (
            f'<iframe src="{escape(self.url)}" style="width:100%;height:{HEIGHT_PIXELS}px;'
            f'border:1px solid rgba(128,128,128,.4)" title="{escape(self.rig.name)}"></iframe>'
        )

    def edit(self, change: Edit, step: object = None, key: object = None) -> None:
        """Have an edit made, in its turn; from any thread.

        One that is followed by another with the same step and key before its turn is left out.
        """
        self._put(lambda: self.history.record(change(self.state), step), None if key is None else (key, step))

    def undo(self) -> None:
        """Have the last step undone."""
        self._put(self.history.undo)

    def redo(self) -> None:
        """Have the step that was undone last made again."""
        self._put(self.history.redo)

    def save(self, path: str) -> None:
        """Have the rig saved, if it can work."""

        def act() -> None:
            place = save_below(self._folder, self.rig, path)
            for client in self.server.viser.get_clients().values():
                client.add_notification("Saved", str(place), auto_close_seconds=NOTICE_S)

        self._put(act)

    def snap_to_space(self, word: str) -> None:
        """Have anchors snap to the surfaces of a space, by its name or its file."""
        self.edit(lambda state: replace(state, task=load_space(word, self._folder)))

    def close(self) -> None:
        """Close the page; the rig stays as it was designed."""
        atexit.unregister(self.close)
        with self._wake:
            self._open = False
            self._wake.notify_all()
        self._thread.join()
        self._workspace.close()
        self._solvers.close()
        self.server.close()

    def _put(self, act: Callable[[], object], key: object = None) -> None:
        with self._wake:
            if key is not None and self._queue and self._queue[-1][0] == key:
                self._queue.pop()
            self._queue.append((key, act))
            self._wake.notify_all()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._queue or not self._open)
                if not self._open:
                    return
                waiting, self._queue = self._queue, []
            before, problem = self.state, ""
            for _, act in waiting:
                try:
                    act()
                except Exception as error:  # whatever it is, the page must survive it
                    problem = described(error)
            try:
                self._show(problem)
            except Exception as error:  # a state that cannot be shown is not kept
                self.history.present = before
                self._show(described(error))

    def _show(self, problem: str = "") -> None:
        """Bring all browsers up to date."""
        state = self.state
        found = evaluate(state)
        with self.server.viser.atomic():
            self._drawing.show(draw(state, found), state)
            self._panel.show(state, found, problem)
            if not state.show_workspace and self._shown_volume:
                self._shown_volume = ()
                self._drawing.show_workspace(None, None)
        self.server.viser.flush()
        self._workspace.submit(state, fine=not self._dragging)
        if state.compared or self._compared is not None:
            self._solvers.submit(state)

    def _compare(self, state: DesignState, wanted: Callable[[], bool]) -> None:
        """Compare solvers, unless that was done for a state that is the same in it."""
        if self._compared is not None and all(
            getattr(state, name) is getattr(self._compared, name) for name in COMPARED_BY
        ):
            return
        found = compare(state, wanted)
        if found is None:
            return
        self._compared = state if state.compared else None
        with self.server.viser.atomic():
            self._panel.solvers.show(state, *found)
        self.server.viser.flush()

    def _volume_found(self, found: Volume, ghost: Volume | None) -> None:
        """Show the workspace that another thread has evaluated, as the present state has it shown."""
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
        self.edit(lambda state: dragged(state, grab), self._step, ("drag", grab.what))


def view(rig: Rig) -> DesignPage:
    """Open the design page of a rig: inline in a notebook, in a browser elsewhere.

    A thread serves it until it is closed or this process ends.

    Parameters
    ----------
    rig : Rig

    Returns
    -------
    DesignPage
        With ``url``, ``rig`` (as it is designed now) and ``close()``.

    Raises
    ------
    MissingDependency
        If viser is not installed.

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


def described(error: Exception) -> str:
    """Return an error in words: its own if it is one of this package, else with its kind."""
    return str(error) if isinstance(error, TensionlabError) else f"{type(error).__name__}: {error}"


def dragged(state: DesignState, grab: Grab) -> DesignState:
    """Return the state after something was dragged to a place."""
    d = state.rig.dimension
    place = grab.place if d == 3 or grab.eye is None else on_plane(grab.eye, grab.place)
    if grab.what == TIP:
        force = (place[:d] - state.position) / force_scale(state.rig)
        return edits.set_wrench(state, np.concatenate([np.round(force, edits.DECIMALS), state.wrench[d:]]))
    if grab.what == HAND:
        moved = edits.move_hand(state, place[:d])
        return moved if grab.turn is None else edits.turn_platform(moved, rotation_of(grab.turn, d))
    return edits.move_anchor(state, grab.what, place[:d])


def on_plane(eye: Floats, through: Floats) -> Floats:
    """Return where the ray from the eye through a place meets the plane z = 0; that place if it does not."""
    ray = through - eye
    if abs(ray[2]) < 1e-9 * float(np.linalg.norm(ray)):
        return through
    return np.asarray(eye - eye[2] / ray[2] * ray)


def place_below(folder: Path, path: str) -> Path:
    """Return the place of a path that a browser gives; WriteError unless it is below a folder, links followed."""
    try:
        place = (folder / path.strip()).resolve()
        inside = place.is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # a null character, or a loop of links
        raise WriteError(f"{path!r} is no path of a file ({error})") from None
    if not inside:
        raise WriteError(f"{path}: the page was started in {folder}, and uses files below it only; name one there")
    return place


def save_below(folder: Path, rig: Rig, path: str) -> Path:
    """Write a rig to a TOML file below a folder; RigError with the findings of ``rig check`` if it cannot work."""
    place = place_below(folder, path)
    writing.require_writable(place, (SUFFIX,))
    failed = [check for check in check_rig(rig) if check.passed is False]
    if failed:
        findings = "; ".join(f"{check.name}: {check.text}" for check in failed)
        raise RigError(f"{rig.name} cannot work at home, so it is not saved. {findings}")
    save_rig(rig, place)
    return place


def load_space(word: str, folder: Path) -> LayoutTask | None:
    """Return a space by its name or its file below a folder; None until that is complete."""
    name = word.strip()
    if name not in list_names("spaces") and not name.endswith(SUFFIX):
        return None
    return load_task(place_below(folder, name) if is_path(name, SUFFIX) else name)
