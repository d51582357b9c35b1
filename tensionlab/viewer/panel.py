"""The panel of the design page: fields and buttons that become edits, and what is said of the state."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import POLICIES
from tensionlab.support.arrays import Floats
from tensionlab.support.files.named import is_path, list_names
from tensionlab.viewer import state as edits
from tensionlab.viewer import words
from tensionlab.viewer.evaluation import Evaluation
from tensionlab.viewer.export import place_below
from tensionlab.viewer.history import History
from tensionlab.viewer.solver_panel import SolverPanel
from tensionlab.viewer.solver_study import Answer, Problems
from tensionlab.viewer.state import HAND, Edit, State
from tensionlab.viewer.volume import COARSE, Volume
from tensionlab.workspace.layout.task import LayoutTask, load_task
from tensionlab.workspace.metrics import METRICS
from tensionlab.workspace.orientations import roll_pitch_yaw, roll_pitch_yaw_of

if TYPE_CHECKING:
    import viser

NONE, AS_LOADED = "none", "as loaded"
OWN_POLICY = "the solver's own"
STEP_M, STEP_N, STEP_DEG = 0.01, 0.1, 1.0
PANEL_PIXELS = 410.0
LEVEL_STEPS = 50
SPACE_SUFFIX = ".toml"


class Actions(Protocol):
    """What the panel has done by the page."""

    loaded: Rig

    @property
    def state(self) -> State: ...  # noqa: D102
    def edit(self, change: Edit, step: object = None, key: object = None) -> None: ...  # noqa: D102
    def undo(self) -> None: ...  # noqa: D102
    def redo(self) -> None: ...  # noqa: D102
    def save(self, path: str) -> None: ...  # noqa: D102
    def download_model(self) -> None: ...  # noqa: D102
    def show_python(self) -> None: ...  # noqa: D102
    def search(self, space: str) -> None: ...  # noqa: D102
    def stop_search(self) -> None: ...  # noqa: D102


class Panel:
    """Fields of the design page; `show` brings them up to date."""

    def __init__(self, server: viser.ViserServer, page: Actions, path: Callable[[Rig], str], folder: Path) -> None:
        """``path`` gives the file in which a rig is saved by default; files of spaces are below ``folder``."""
        self._page, self._gui, self._path = page, server.gui, path
        self._rig = page.loaded
        self._dark = False
        gui = self._gui
        self._theme()
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PIXELS)
        self._status, self._problem, self._tensions = (gui.add_html("") for _ in range(3))
        both = gui.add_button_group("", ("Undo", "Redo"))
        pressed(both, lambda: page.undo() if both.value == "Undo" else page.redo())
        _triggered(gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), page.undo)
        _triggered(gui.add_command("Redo", hotkey="Y", modifier="cmd/ctrl"), page.redo)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Hand"):
            self._add_hand()
        with tabs.add_tab("Modules"):
            self._add_modules()
        with tabs.add_tab("Workspace"):
            self._add_workspace()
        with tabs.add_tab("Solvers") as tab:
            self._solvers = SolverPanel(gui, self._edits, solver_names(self._rig), tab)
        with tabs.add_tab("Search"):
            self._add_search(folder)
        with tabs.add_tab("File"):
            self._add_file()

    def _theme(self) -> None:
        self._gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False, dark_mode=self._dark,
        )  # fmt: skip

    def _edits(self, field: Any, change: Callable[[Any], Edit]) -> Any:
        """Have what is entered in a field become an edit; what is entered there in a row is undone at once."""
        return entered(field, lambda: self._page.edit(change(field.value), field, field))

    def _vector(self, label: str, size: int, step: float, change: Callable[[Floats], Edit]) -> Any:
        """Add a field for a vector in the plane or in space, or for a number."""
        if size == 1:
            field: Any = self._gui.add_number(label, 0.0, step=step)
        else:
            add: Any = self._gui.add_vector2 if size == 2 else self._gui.add_vector3
            field = add(label, (0.0,) * size, step=step)
        return self._edits(field, lambda value: change(np.atleast_1d(np.asarray(value, np.float64))))

    def _add_hand(self) -> None:
        gui, d, n = self._gui, self._rig.dimension, self._rig.n
        self._position = self._vector("position m", d, STEP_M, lambda at: lambda state: edits.move_hand(state, at))
        self._turn = None
        if n > d:
            self._turn = self._vector("turned °", n - d, STEP_DEG, lambda turn: lambda state: _turned(state, turn))
        self._force = self._vector("force N", d, STEP_N, lambda part: lambda state: _desired(state, part, 0))
        self._torque = None
        if n > d:
            self._torque = self._vector("torque N·m", n - d, STEP_N, lambda part: lambda s: _desired(s, part, d))
        self._solver = self._edits(
            gui.add_dropdown("solver", solver_names(self._rig)), lambda name: edits.choose(solver=name)
        )
        self._policy = self._edits(
            gui.add_dropdown("if infeasible", (OWN_POLICY, *POLICIES)),
            lambda name: edits.choose(policy=None if name == OWN_POLICY else name),
        )
        self._available = self._edits(
            gui.add_checkbox("available forces", True), lambda shown: edits.choose(show_available=shown)
        )

    def _add_modules(self) -> None:
        gui, d, turns = self._gui, self._rig.dimension, self._rig.n > self._rig.dimension
        self._selected = self._edits(
            gui.add_dropdown("module", (NONE, *(module.name for module in self._rig.modules))),
            lambda name: edits.choose(selected="" if name == NONE else name),
        )
        with gui.add_folder(None) as folder:  # of the module that is selected
            self._own = folder
            here = self._here
            self._name = self._edits(gui.add_text("name", ""), lambda new: here(edits.rename, new))
            self._anchor = self._vector("anchor m", d, STEP_M, lambda at: here(edits.move_anchor, at))
            self._attachment = None
            if turns:
                self._attachment = self._vector(
                    "attachment m", d, STEP_M, lambda at: here(edits.move_attachment, at)
                )
            self._lower, self._upper = (
                self._edits(gui.add_number(label, 0.0, min=0.0, step=STEP_N), lambda _: here(self._relimited))
                for label in ("lower limit N", "upper limit N")
            )
            self._frame = self._edits(gui.add_text("body frame", ""), lambda name: here(edits.set_frame, name))
            self._place = self._vector("body at m", d, STEP_M, lambda at: here(_move_own_frame, at))
            remove = gui.add_button("Remove this module", color="gray")
            pressed(remove, lambda: self._page.edit(here(edits.remove_module)))
        add = gui.add_button("Add a module")
        pressed(add, lambda: self._page.edit(edits.add_module))
        self._grid = self._edits(
            gui.add_number("snap to grid m", 0.0, min=0.0, step=STEP_M), lambda step: edits.choose(grid_m=step)
        )
        self._ghost = self._edits(
            gui.add_dropdown("compare with", (NONE, AS_LOADED, *list_names("rigs"))), self._with_ghost
        )

    def _add_workspace(self) -> None:
        gui = self._gui
        names = [name for name in METRICS if name != "body-distance"]  # needs bodies
        self._display = self._edits(
            gui.add_dropdown("show", ("off", "surface", "slices")), lambda how: edits.choose(display=how)
        )
        self._metric = self._edits(gui.add_dropdown("metric", names), lambda name: edits.choose(metric=name))
        self._level = self._edits(gui.add_slider("level", 0.0, 1.0, 0.01, 0.0), lambda at: edits.choose(level=at))
        self._share = gui.add_html("")

    def _add_search(self, folder: Path) -> None:
        gui, page = self._gui, self._page
        self._space = self._edits(
            gui.add_text("space", "", hint="Name of a space, or its file: the walls for modules"),
            lambda word: _with_space(word, folder),
        )
        self._walls = gui.add_html(words.space(None, self._rig))
        pressed(gui.add_button("Search for a layout"), lambda: page.search(self._space.value))
        pressed(gui.add_button("Stop", color="gray"), page.stop_search)
        self._progress = gui.add_progress_bar(0.0)
        self._searched = gui.add_html("")

    def _add_file(self) -> None:
        gui, page = self._gui, self._page
        self._rig_name = self._edits(
            gui.add_text("rig", self._rig.name), lambda new: lambda s: edits.name_rig(s, new)
        )
        pressed(gui.add_button("Make the hand's place home", color="gray"), lambda: page.edit(edits.set_home))
        self._file: Any = gui.add_text("file", self._path(self._rig))
        self._proposed: str = self._file.value
        pressed(gui.add_button("Save"), lambda: page.save(self._file.value))
        pressed(gui.add_button("Download as MuJoCo model", color="gray"), page.download_model)
        pressed(gui.add_button("Show as Python", color="gray"), page.show_python)
        self._dark_field = self._edits(gui.add_checkbox("dark", False), lambda dark: edits.choose(dark=dark))

    def _here(self, change: Callable[..., State], *values: Any) -> Edit:
        """Return the edit that changes the module that is selected when its turn comes."""
        return lambda state: change(state, state.selected, *values) if state.selected not in ("", HAND) else state

    def _relimited(self, state: State, name: str) -> State:
        return edits.relimit(state, name, self._lower.value, self._upper.value)

    def _with_ghost(self, name: str) -> Edit:
        rig = None if name == NONE else self._page.loaded if name == AS_LOADED else load_rig(name)
        return edits.choose(ghost=rig)

    def show(self, state: State, found: Evaluation, history: History, problem: str) -> None:
        """Bring all fields up to date."""
        self._status.content = words.status(state, found)
        self._problem.content = words.problem(problem)
        self._tensions.content = words.tensions(state, found)
        if problem:
            return  # what was refused stays in its field, to be corrected
        d = state.rig.dimension
        _set(self._position, state.position)
        _set(self._force, state.wrench[:d])
        if self._turn is not None and self._torque is not None and state.rotation is not None:
            turn = roll_pitch_yaw_of(state.rotation[None])[0] if d == 3 else state.rotation
            _set(self._turn, np.degrees(turn))
            _set(self._torque, state.wrench[d:])
        for field, value in (
            (self._solver, state.solver), (self._policy, state.policy or OWN_POLICY), (self._grid, state.grid_m),
            (self._available, state.show_available), (self._metric, state.metric), (self._display, state.display),
            (self._rig_name, state.rig.name), (self._dark_field, state.dark),
        ):  # fmt: skip
            field.value = value
        self._walls.content = words.space(state.task, state.rig)
        if self._file.value == self._proposed:  # nobody has written another
            self._file.value = self._proposed = self._path(state.rig)
        if state.dark is not self._dark:
            self._dark = state.dark
            self._theme()
        self._show_module(state)
        self._solvers.show(state)

    def _show_module(self, state: State) -> None:
        names = tuple(module.name for module in state.rig.modules)
        if self._selected.options != (NONE, *names):
            self._selected.options = (NONE, *names)
        chosen = state.selected in names
        self._selected.value = state.selected if chosen else NONE
        self._own.visible = chosen
        if not chosen:
            return
        module = edits.find(state, state.selected)
        self._name.value, self._frame.value = module.name, module.frame
        self._lower.value, self._upper.value = module.lower, module.upper
        _set(self._anchor, state.anchors[names.index(module.name)])
        if self._attachment is not None:
            _set(self._attachment, np.asarray(module.attachment))
        on_body = module.frame in state.rig.frames
        self._place.visible = on_body
        if on_body:
            _set(self._place, np.asarray(state.rig.at_rest[module.frame].position))

    def show_volume(self, state: State, volume: Volume, ghost: Volume | None) -> None:
        """Say what share of the box the workspace has, and let the level range over the values."""
        low, high = volume.extent
        if len(volume.axes[0]) > COARSE and high > low:  # or it would move while something is dragged
            step = 10.0 ** math.floor(math.log10((high - low) / LEVEL_STEPS))
            decimals = max(0, -round(math.log10(step)))
            self._level.min = round(math.floor(low / step) * step, decimals)
            self._level.max = round(math.ceil(high / step) * step, decimals)
            self._level.step = step
        self._level.value = float(state.level)
        self._share.content = words.share(state, volume, ghost)

    def show_search(self, share: float, said: str) -> None:
        """Show how far a search for a layout is, and what it says."""
        bar: Any = self._progress
        bar.value = 100.0 * share
        self._searched.content = words.note(said)

    def show_answers(self, state: State, asked: Problems, answers: Sequence[Answer]) -> None:
        """Show what solvers answer."""
        self._solvers.show_answers(state, asked, answers)


def solver_names(rig: Rig) -> list[str]:
    """Return the names of the solvers that serve rigs of this size, each once."""
    return list(dict.fromkeys(each.name for each in select_solvers(size=(rig.n, rig.m))[0]))


def _turned(state: State, angles: Floats) -> State:
    """Turn the platform by roll, pitch and yaw, or in the plane by an angle, in degrees."""
    turn = np.radians(angles)
    return edits.turn_platform(state, roll_pitch_yaw(*turn)[0] if len(turn) == 3 else turn[0])


def _desired(state: State, part: Floats, start: int) -> State:
    wrench = state.wrench.copy()
    wrench[start : start + len(part)] = part
    return edits.desire(state, wrench)


def _move_own_frame(state: State, name: str, place: ArrayLike) -> State:
    frame = edits.find(state, name).frame
    return edits.move_frame(state, frame, place) if frame in state.rig.frames else state


def load_space(word: str, folder: Path) -> LayoutTask:
    """Return the task of a space: one by its name, or of a file below a folder."""
    name = word.strip()
    return load_task(place_below(folder, name) if is_path(name, SPACE_SUFFIX) else name)


def _with_space(word: str, folder: Path) -> Edit:
    """Return the edit that has anchors snap to a space's surfaces; to none until its name or file is complete."""
    name = word.strip()
    complete = name in list_names("spaces") or name.endswith(SPACE_SUFFIX)
    return lambda state: replace(state, task=load_space(name, folder) if complete else None)


def _set(field: Any, values: Floats) -> None:
    """Write a vector, or its only entry, into a field."""
    rounded = np.round(np.atleast_1d(values), 6) + 0.0
    field.value = tuple(rounded.tolist()) if len(rounded) > 1 else float(rounded[0])


def entered(field: Any, act: Callable[[], None]) -> Any:
    """Call something when somebody has entered something in a browser; not when it is shown there."""

    async def changed(event: Any) -> None:
        if event.client is not None:
            act()

    field.on_update(changed)
    return field


def pressed(button: Any, act: Callable[[], None]) -> None:
    """Call something when a button is pressed in a browser."""

    async def pressed(event: Any) -> None:
        act()

    button.on_click(pressed)


def _triggered(command: Any, act: Callable[[], None]) -> None:
    async def triggered(event: Any) -> None:
        act()

    command.on_trigger(triggered)
