"""The panel of the design page: fields and buttons that become edits, and texts about the state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tensionlab.model.files import load_rig
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import POLICIES
from tensionlab.support.arrays import Floats
from tensionlab.support.files.named import is_path, list_names
from tensionlab.viewer import design_words
from tensionlab.viewer import state as edits
from tensionlab.viewer.evaluation import StateEvaluation
from tensionlab.viewer.html import render
from tensionlab.viewer.saving import place_below
from tensionlab.viewer.solver_panel import SolverPanel
from tensionlab.viewer.state import DesignState, Edit
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


class PanelActions(Protocol):
    """Actions of the page that the panel calls."""

    def edit(self, change: Edit, step: object = None, key: object = None) -> None: ...  # noqa: D102
    def undo(self) -> None: ...  # noqa: D102
    def redo(self) -> None: ...  # noqa: D102
    def save(self, path: str) -> None: ...  # noqa: D102


class DesignPanel:
    """Fields of the design page; `show` brings them up to date."""

    def __init__(self, server: viser.ViserServer, page: PanelActions, rig: Rig, file: str, folder: Path) -> None:
        """``file`` is where the rig is saved by default; spaces are read below ``folder``."""
        self._page, self._gui, self._rig, self._folder = page, server.gui, rig, folder
        self._shown: list[tuple[Any, Callable[[DesignState], Any]]] = []
        self._dark = False
        gui = self._gui
        self._set_theme()
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PIXELS)
        self._status, self._problem, self._tensions = (gui.add_html("") for _ in range(3))
        both = gui.add_button_group("", ("Undo", "Redo"))
        pressed(both, lambda: page.undo() if both.value == "Undo" else page.redo())
        triggered(gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), page.undo)
        triggered(gui.add_command("Redo", hotkey="Y", modifier="cmd/ctrl"), page.redo)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Hand"):
            self._add_hand()
        with tabs.add_tab("Modules"):
            self._add_modules()
        with tabs.add_tab("Workspace"):
            self._add_workspace()
        with tabs.add_tab("Solvers") as tab:
            self.solvers = SolverPanel(gui, self._bind, solver_names(rig), tab)
        with tabs.add_tab("File"):
            self._add_file(file)

    def _set_theme(self) -> None:
        self._gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False, dark_mode=self._dark
        )

    # Each field has a function that reads its value from a state, None for nothing, and one that changes a state.

    def _bind(
        self,
        field: Any,
        read: Callable[[DesignState], Any],
        change: Callable[[DesignState, Any], DesignState],
    ) -> Any:
        """Show a part of the state in a field, and make what is entered there an edit; undo takes all back."""
        self._shown.append((field, read))

        def edit() -> None:
            value = field.value
            self._page.edit(lambda state: change(state, value), field, field)

        return entered(field, edit)

    def _bind_attribute(self, field: Any, name: str) -> Any:
        """Show an attribute of the state in a field."""
        return self._bind(
            field, lambda state: getattr(state, name), lambda state, value: replace(state, **{name: value})
        )

    def _bind_module(
        self,
        field: Any,
        read: Callable[[Module], Any],
        change: Callable[[DesignState, str, Any], DesignState],
    ) -> Any:
        """Show a part of the selected module in a field."""
        return self._bind(
            field,
            lambda state: read(edits.find(state, state.selected)) if has_module(state) else None,
            lambda state, value: change(state, state.selected, value) if has_module(state) else state,
        )

    def _vector(self, label: str, size: int, step: float) -> Any:
        """Add a field for a vector in the plane or in space, or for a number."""
        if size == 1:
            return self._gui.add_number(label, 0.0, step=step)
        add: Any = self._gui.add_vector2 if size == 2 else self._gui.add_vector3
        return add(label, (0.0,) * size, step=step)

    def _add_hand(self) -> None:
        gui, d, n = self._gui, self._rig.dimension, self._rig.n
        self._position = self._bind(
            self._vector("position m", d, STEP_M), lambda state: state.position, edits.move_hand
        )
        if n > d:
            self._bind(self._vector("turned °", n - d, STEP_DEG), angles_deg, turn_by_degrees)
        self._bind(self._vector("force N", d, STEP_N), lambda s: s.wrench[:d], lambda s, v: set_part(s, v, 0))
        if n > d:
            torque = self._vector("torque N·m", n - d, STEP_N)
            self._bind(torque, lambda s: s.wrench[d:], lambda s, v: set_part(s, v, d))
        self._solver = self._bind_attribute(gui.add_dropdown("solver", solver_names(self._rig)), "solver")
        self._bind(
            gui.add_dropdown("if infeasible", (OWN_POLICY, *POLICIES)),
            lambda state: state.policy or OWN_POLICY,
            lambda state, name: replace(state, policy=None if name == OWN_POLICY else name),
        )
        self._bind_attribute(gui.add_checkbox("available forces", True), "show_available")

    def _add_modules(self) -> None:
        gui, names = self._gui, tuple(module.name for module in self._rig.modules)
        self._selected = self._bind(
            gui.add_dropdown("module", (NONE, *names)),
            lambda state: state.selected if has_module(state) else NONE,
            lambda state, name: replace(state, selected="" if name == NONE else name),
        )
        with gui.add_folder(None) as self._own:
            self._add_selected_module()
        pressed(gui.add_button("Add a module"), lambda: self._page.edit(edits.add_module))
        self._grid = self._bind_attribute(gui.add_number("snap to grid m", 0.0, min=0.0, step=STEP_M), "grid_m")
        space: Any = gui.add_text("snap to space", "", hint="Name of a space, or its file: walls for modules")
        self._space = entered(space, lambda: self._page.edit(with_space(space.value, self._folder)))
        self._walls = gui.add_html("")
        ghost: Any = gui.add_dropdown("compare with", (NONE, AS_LOADED, *list_names("rigs")))
        entered(ghost, lambda: self._page.edit(self._with_ghost(ghost.value)))

    def _add_selected_module(self) -> None:
        gui, d = self._gui, self._rig.dimension
        self._bind_module(gui.add_text("name", ""), lambda module: module.name, edits.rename)
        self._bind(
            self._vector("anchor m", d, STEP_M),
            anchor_in_world,
            lambda s, at: edits.move_anchor(s, s.selected, at) if has_module(s) else s,
        )
        if self._rig.n > d:
            attachment = self._vector("attachment m", d, STEP_M)
            self._bind_module(attachment, lambda module: np.asarray(module.attachment), edits.move_attachment)
        lower, upper = (gui.add_number(f"{end} limit N", 0.0, min=0.0, step=STEP_N) for end in ("lower", "upper"))
        self._bind_module(
            lower, lambda module: module.lower, lambda s, name, low: edits.relimit(s, name, low, upper.value)
        )
        self._bind_module(
            upper, lambda module: module.upper, lambda s, name, high: edits.relimit(s, name, lower.value, high)
        )
        self._bind_module(gui.add_text("body frame", ""), lambda module: module.frame, edits.set_frame)
        self._body = self._vector("body at m", d, STEP_M)
        self._bind(self._body, body_position, move_body)
        remove = gui.add_button("Remove this module", color="gray")
        pressed(remove, lambda: self._page.edit(remove_selected))

    def _add_workspace(self) -> None:
        gui = self._gui
        self._display = self._bind_attribute(gui.add_dropdown("show", ("off", "surface")), "display")
        names = [name for name in METRICS if name != "body-distance"]  # needs bodies
        self._bind_attribute(gui.add_dropdown("metric", names), "metric")
        level: Any = gui.add_slider("level", 0.0, 1.0, 0.01, 0.0)
        entered(level, lambda: self._page.edit(edits.set_fields(level=level.value), level, level))
        self._level, self._share = level, gui.add_html("")

    def _add_file(self, file: str) -> None:
        gui, page = self._gui, self._page
        self._bind(gui.add_text("rig", self._rig.name), lambda state: state.rig.name, edits.name_rig)
        home = gui.add_button("Make the hand's place home", color="gray")
        pressed(home, lambda: page.edit(edits.set_home))
        self._file: Any = gui.add_text("file", file)
        pressed(gui.add_button("Save"), lambda: page.save(self._file.value))
        self._bind_attribute(gui.add_checkbox("dark", False), "dark")

    def _with_ghost(self, name: str) -> Edit:
        rig = None if name == NONE else self._rig if name == AS_LOADED else load_rig(name)
        return edits.set_fields(ghost=rig)

    def show(self, state: DesignState, found: StateEvaluation, problem: str) -> None:
        """Bring all fields up to date; a field whose entry was refused keeps it, to be corrected."""
        self._status.content = design_words.status(state, found)
        self._problem.content = render("design.problem", problem)
        self._tensions.content = design_words.tensions(state, found)
        if problem:
            return
        names = (NONE, *(module.name for module in state.rig.modules))
        if self._selected.options != names:
            self._selected.options = names
        self._own.visible = has_module(state)
        self._body.visible = body_position(state) is not None
        for field, read in self._shown:
            if (value := read(state)) is not None:
                field.value = shown_value(value)
        self._walls.content = design_words.space(state.task)
        if state.dark is not self._dark:
            self._dark = state.dark
            self._set_theme()

    def show_volume(self, state: DesignState, volume: Volume, ghost: Volume | None) -> None:
        """Say what share of the box the workspace has, and let the level range over the values."""
        low, high = volume.extent
        if len(volume.axes[0]) > COARSE and high > low:  # or it would move during a drag
            step = 10.0 ** math.floor(math.log10((high - low) / LEVEL_STEPS))
            decimals = max(0, -round(math.log10(step)))
            self._level.min = round(math.floor(low / step) * step, decimals)
            self._level.max = round(math.ceil(high / step) * step, decimals)
            self._level.step = step
        self._level.value = float(state.level)
        self._share.content = design_words.share(state, volume, ghost)


def solver_names(rig: Rig) -> list[str]:
    """Return the names of the solvers that serve rigs of this size."""
    return list(dict.fromkeys(entry.name for entry in select_solvers(size=(rig.n, rig.m))[0]))


def has_module(state: DesignState) -> bool:
    """Return whether a module is selected."""
    return state.selected in [module.name for module in state.rig.modules]


def anchor_in_world(state: DesignState) -> Floats | None:
    """Return the anchor of the selected module, (d,), in m; None without one."""
    return state.anchors[state.rig.modules.index(edits.find(state, state.selected))] if has_module(state) else None


def remove_selected(state: DesignState) -> DesignState:
    """Remove the selected module, if there is one."""
    return edits.remove_module(state, state.selected) if has_module(state) else state


def angles_deg(state: DesignState) -> Floats | None:
    """Return roll, pitch and yaw of the platform, or its angle in the plane, in degrees; None for a point."""
    if state.rotation is None:
        return None
    return np.degrees(roll_pitch_yaw_of(state.rotation[None])[0] if state.rig.dimension == 3 else state.rotation)


def turn_by_degrees(state: DesignState, angles: Any) -> DesignState:
    """Turn the platform by roll, pitch and yaw, or in the plane by an angle, in degrees."""
    turn = np.radians(np.atleast_1d(angles))
    return edits.turn_platform(state, roll_pitch_yaw(*turn)[0] if len(turn) == 3 else turn[0])


def set_part(state: DesignState, part: Any, start: int) -> DesignState:
    """Set components of the desired wrench, from a first one on."""
    wrench, values = state.wrench.copy(), np.atleast_1d(part)
    wrench[start : start + len(values)] = values
    return edits.set_wrench(state, wrench)


def body_position(state: DesignState) -> Floats | None:
    """Return where the body of the selected module is at rest, (d,), in m; None without one."""
    frame = edits.find(state, state.selected).frame if has_module(state) else ""
    return np.asarray(state.rig.at_rest[frame].position) if frame in state.rig.frames else None


def move_body(state: DesignState, place: Any) -> DesignState:
    """Move the body of the selected module, if it is on one."""
    if body_position(state) is None:
        return state
    return edits.move_frame(state, edits.find(state, state.selected).frame, place)


def load_space(word: str, folder: Path) -> LayoutTask:
    """Return the task of a space: one by its name, or of a file below a folder."""
    name = word.strip()
    return load_task(place_below(folder, name) if is_path(name, SPACE_SUFFIX) else name)


def with_space(word: str, folder: Path) -> Edit:
    """Return the edit that has anchors snap to a space's surfaces; to none until its name or file is complete."""
    name = word.strip()
    complete = name in list_names("spaces") or name.endswith(SPACE_SUFFIX)
    return lambda state: replace(state, task=load_space(name, folder) if complete else None)


def shown_value(value: Any) -> Any:
    """Return a value as a field has it: vectors as tuples of rounded numbers."""
    if not isinstance(value, np.ndarray):
        return value
    rounded = np.round(np.atleast_1d(value), 6) + 0.0
    return tuple(rounded.tolist()) if len(rounded) > 1 else float(rounded[0])


def entered(field: Any, act: Callable[[], None]) -> Any:
    """Call a function when something is entered in a browser, but not when the page shows it there."""

    async def changed(event: Any) -> None:
        if event.client is not None:
            act()

    field.on_update(changed)
    return field


def pressed(button: Any, act: Callable[[], None]) -> None:
    """Call a function when a button is pressed in a browser."""

    async def pressed(event: Any) -> None:
        act()

    button.on_click(pressed)


def triggered(command: Any, act: Callable[[], None]) -> None:
    """Call a function when a keyboard shortcut is pressed in a browser."""

    async def triggered(event: Any) -> None:
        act()

    command.on_trigger(triggered)
