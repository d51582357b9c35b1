"""The panel of the design page: fields and buttons that become edits, texts about the state, and files."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import RigError, TensionlabError, WriteError
from tensionlab.model.files import load_rig, save_rig
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import POLICIES, Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE
from tensionlab.support.files import writing
from tensionlab.support.files.named import is_path, list_names
from tensionlab.support.files.reading import read_toml
from tensionlab.validation.rig_check import check_rig
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_scene import tension_colours
from tensionlab.viewer.evaluation import StateEvaluation
from tensionlab.viewer.history import EditQueue
from tensionlab.viewer.html import render
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.server import on_input, on_press
from tensionlab.viewer.solver_comparison import SolverPanel
from tensionlab.viewer.state import DesignState, selected_module
from tensionlab.viewer.workspace import COARSE, Volume, usable_metrics
from tensionlab.workspace.layout.task import load_task
from tensionlab.workspace.metrics import metric
from tensionlab.workspace.orientations import roll_pitch_yaw, roll_pitch_yaw_of
from tensionlab.workspace.shares import describe_step

if TYPE_CHECKING:
    import viser

NONE, AS_LOADED = "none", "as loaded"
DEFAULT_POLICY = "the solver's own"
STEP_M, STEP_N, STEP_DEG = 0.01, 0.1, 1.0
LEVEL_STEPS = 50
SUFFIX = ".toml"  # of files of rigs and spaces
NOTICE_S = 8.0  # duration of a notice that something was saved
Change = Callable[[DesignState, Any], DesignState]  # change of a state by what is entered in a field


class DesignPanel:
    """Fields of the design page; `show` brings them up to date."""

    def __init__(self, server: viser.ViserServer, queue: EditQueue, rig: Rig, source: str) -> None:
        """``source`` is the name or the file of the rig; it is saved there by default."""
        self._server, self._queue, self._rig = server, queue, rig
        self._gui: Any = server.gui
        self._folder = Path.cwd()
        self._fields: list[tuple[Any, Callable[[DesignState], Any]]] = []  # with functions that read their values
        gui = self._gui
        self._status, self._legend, self._problem, self._tensions = (gui.add_html("") for _ in range(4))
        both = gui.add_button_group("", ("Undo", "Redo"))
        on_press(both, lambda: queue.undo() if both.value == "Undo" else queue.redo())
        on_press(gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), queue.undo)
        on_press(gui.add_command("Redo", hotkey="Y", modifier="cmd/ctrl"), queue.redo)
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
            self._add_file(source if is_path(source, SUFFIX) else f"{rig.name}{SUFFIX}")

    def _bind(self, field: Any, read: Callable[[DesignState], Any], change: Change) -> Any:
        """Show a part of the state in a field, and make what is entered there an edit; undo takes all back.

        ``read`` gives the value in a state, None to leave the field as it is.
        """
        self._fields.append((field, read))

        def edit() -> None:
            value = field.value
            self._queue.edit(lambda state: change(state, value), field)

        return on_input(field, edit)

    def _bind_attribute(self, field: Any, name: str) -> Any:
        """Show an attribute of the state in a field."""
        return self._bind(field, lambda s: getattr(s, name), lambda s, value: replace(s, **{name: value}))

    def _bind_module(
        self,
        field: Any,
        read: Callable[[DesignState, Module], Any],
        change: Callable[[DesignState, str, Any], DesignState],
    ) -> Any:
        """Show a part of the selected module in a field."""
        return self._bind(
            field,
            lambda state: read(state, module) if (module := selected_module(state)) else None,
            lambda state, value: change(state, state.selected, value) if selected_module(state) else state,
        )

    def _vector(self, label: str, size: int, step: float) -> Any:
        """Add a field for a vector in the plane or in space, or for a number."""
        if size == 1:
            return self._gui.add_number(label, 0.0, step=step)
        add = self._gui.add_vector2 if size == 2 else self._gui.add_vector3
        return add(label, (0.0,) * size, step=step)

    def _add_hand(self) -> None:
        gui, d, n = self._gui, self._rig.dimension, self._rig.n
        position = self._vector("position m", d, STEP_M)
        self._position = self._bind(position, lambda state: state.position, edits.move_hand)
        if n > d:
            self._bind(self._vector("turned °", n - d, STEP_DEG), angles_deg, turn_by_degrees)
        force = self._vector("force N", d, STEP_N)
        self._bind(force, lambda s: s.wrench[:d], lambda s, v: edits.set_wrench(s, [*v, *s.wrench[d:]]))
        if n > d:
            torque = self._vector("torque N·m", n - d, STEP_N)
            self._bind(
                torque, lambda s: s.wrench[d:], lambda s, v: edits.set_wrench(s, np.append(s.wrench[:d], v))
            )
        self._solver = self._bind_attribute(gui.add_dropdown("solver", solver_names(self._rig)), "solver")
        self._bind(
            gui.add_dropdown("if infeasible", (DEFAULT_POLICY, *POLICIES)),
            lambda state: state.policy or DEFAULT_POLICY,
            lambda state, name: replace(state, policy=None if name == DEFAULT_POLICY else name),
        )

    def _add_modules(self) -> None:
        gui, names, queue = self._gui, tuple(module.name for module in self._rig.modules), self._queue
        self._selected = self._bind(
            gui.add_dropdown("module", (NONE, *names)),
            lambda state: state.selected if selected_module(state) else NONE,
            lambda state, name: replace(state, selected="" if name == NONE else name),
        )
        with gui.add_folder(None) as self._own:
            self._add_selected_module()
        on_press(gui.add_button("Add a module"), lambda: queue.edit(edits.add_module))
        self._grid = self._bind_attribute(gui.add_number("snap to grid m", 0.0, min=0.0, step=STEP_M), "grid_m")
        hint = "Walls for modules: a space that comes with tensionlab, or a file in the folder of this page"
        space = gui.add_dropdown(
            "snap to space", (NONE, *list_names("spaces"), *own_spaces(self._folder)), hint=hint
        )
        self._space = on_input(space, lambda: self._snap_to(space.value))
        self._walls = gui.add_html("")
        ghost = gui.add_dropdown("compare with", (NONE, AS_LOADED, *list_names("rigs")))
        on_input(ghost, lambda: self._compare_with(ghost.value))

    def _add_selected_module(self) -> None:
        gui, d, bind = self._gui, self._rig.dimension, self._bind_module
        bind(gui.add_text("name", ""), lambda _, module: module.name, edits.rename)
        anchor = self._vector("anchor m", d, STEP_M)
        bind(anchor, lambda state, module: state.anchors[state.names.index(module.name)], edits.move_anchor)
        if self._rig.n > d:
            bind(
                self._vector("attachment m", d, STEP_M),
                lambda _, module: np.asarray(module.attachment),
                lambda s, name, v: edits.change_module(s, name, attachment=np.asarray(v, np.float64)),
            )
        low, high = (gui.add_number(f"{end} limit N", 0.0, min=0.0, step=STEP_N) for end in ("lower", "upper"))

        def set_limits(state: DesignState, name: str, _: float) -> DesignState:
            return edits.change_module(state, name, lower=float(low.value), upper=float(high.value))

        bind(low, lambda _, module: module.lower, set_limits)
        bind(high, lambda _, module: module.upper, set_limits)
        bind(gui.add_text("body frame", ""), lambda _, module: module.frame, edits.set_frame)
        self._body = bind(self._vector("body at m", d, STEP_M), body_position, edits.move_body)
        remove = gui.add_button("Remove this module", color="gray")
        on_press(remove, lambda: self._queue.edit(lambda state: edits.remove_module(state, state.selected)))

    def _add_workspace(self) -> None:
        gui = self._gui
        self._bind_attribute(gui.add_checkbox("show", False), "show_workspace")
        self._bind_attribute(gui.add_dropdown("metric", usable_metrics(self._rig)), "metric")
        level = gui.add_slider("level", 0.0, 1.0, 0.01, 0.0)
        on_input(level, lambda: self._queue.edit(edits.set_fields(level=level.value), level))
        self._level, self._share = level, gui.add_html("")

    def _add_file(self, file: str) -> None:
        gui, edit = self._gui, self._queue.edit
        name = gui.add_text("rig", self._rig.name)
        self._bind(name, lambda s: s.rig.name, lambda s, value: replace(s, rig=replace(s.rig, name=value)))
        home = gui.add_button("Make the hand's place home", color="gray")
        on_press(home, lambda: edit(edits.make_home))
        self._file = gui.add_text("file", file)
        on_press(gui.add_button("Save"), lambda: self.save(self._file.value))

    def _snap_to(self, space: str) -> None:
        def snap(state: DesignState) -> DesignState:
            place = place_below(self._folder, space) if is_path(space, SUFFIX) else space
            return replace(state, task=None if space == NONE else load_task(place))

        self._queue.edit(snap)

    def _compare_with(self, name: str) -> None:
        rig = None if name == NONE else self._rig if name == AS_LOADED else load_rig(name)
        self._queue.edit(edits.set_fields(ghost=rig))

    def save(self, path: str) -> None:
        """Have the rig saved, if it can work."""

        def act() -> None:
            place = save_below(self._folder, self._queue.history.present.rig, path)
            for client in self._server.get_clients().values():
                client.add_notification("Saved", str(place), auto_close_seconds=NOTICE_S)

        self._queue.put(act)

    def show(self, state: DesignState, found: StateEvaluation, problem: str) -> None:
        """Bring all fields up to date; a field whose entry was refused keeps it, to be corrected."""
        self._status.content = status_html(state, found)
        self._legend.content = render("common.legend", legend(state, found))
        self._problem.content = render("design.problem", problem)
        self._tensions.content = tensions_html(state, found)
        if problem:
            return
        names = (NONE, *state.names)
        if self._selected.options != names:
            self._selected.options = names
        module = selected_module(state)
        self._own.visible = module is not None
        self._body.visible = module is not None and module.frame in state.rig.frames
        for field, read in self._fields:
            if (value := read(state)) is not None:
                field.value = shown_value(value)
        self._walls.content = render("design.walls", state.task)

    def show_volume(self, state: DesignState, volume: Volume, ghost: Volume | None) -> None:
        """Show the share of the box that the workspace has, and let the level range over the values."""
        low, high = volume.extent
        if len(volume.axes[0]) > COARSE and high > low:  # or it would move during a drag
            decimals = -math.floor(math.log10((high - low) / LEVEL_STEPS))
            self._level.step = step = 10.0**-decimals
            self._level.min = round(math.floor(low / step) * step, decimals)
            self._level.max = round(math.ceil(high / step) * step, decimals)
        self._level.value = float(state.level)
        steps = describe_step(volume.axes)
        self._share.content = render("design.share", metric(state.metric), volume, state.level, steps, ghost)


def solver_names(rig: Rig) -> list[str]:
    """Return the names of the solvers that serve rigs of this size."""
    return list(dict.fromkeys(entry.name for entry in select_solvers(size=(rig.n, rig.m))[0]))


def angles_deg(state: DesignState) -> Floats | None:
    """Return roll, pitch and yaw of the platform, or its angle in the plane, in degrees; None for a point."""
    if state.rotation is None:
        return None
    return np.degrees(roll_pitch_yaw_of(state.rotation[None])[0] if state.rig.dimension == 3 else state.rotation)


def turn_by_degrees(state: DesignState, angles: Any) -> DesignState:
    """Turn the platform by roll, pitch and yaw, or in the plane by an angle, in degrees."""
    turn = np.radians(np.atleast_1d(angles))
    return edits.turn_platform(state, roll_pitch_yaw(*turn)[0] if len(turn) == 3 else turn[0])


def body_position(state: DesignState, module: Module) -> Floats | None:
    """Return where the body of a module is at rest, (d,), in m; None for a module in the world."""
    frame = module.frame
    return np.asarray(state.rig.at_rest[frame].position) if frame in state.rig.frames else None


def shown_value(value: Any) -> Any:
    """Return a value as a field has it: vectors as tuples of rounded numbers."""
    if not isinstance(value, np.ndarray):
        return value
    rounded = np.round(np.atleast_1d(value), 6) + 0.0
    return tuple(rounded.tolist()) if len(rounded) > 1 else float(rounded[0])


def status_html(state: DesignState, found: StateEvaluation) -> str:
    """Return the status, the forces and the margin."""
    return render("design.status", state, found, 1.0 / force_scale(state.rig))


def legend(state: DesignState, found: StateEvaluation) -> list[tuple[str, str]]:
    """Return what is drawn, with its colour."""
    missed = found.allocation is not None and found.allocation.status != Status.EXACT
    entries = {
        "desired force": (ORANGE, bool(state.wrench[: state.rig.dimension].any())),
        "rendered force": (BLUE, missed),
        "error": (GREY, missed),
        "proof that it is infeasible": (PURPLE, found.certificate is not None),
        "available forces": (BLUE, found.available is not None),
        "workspace": (GREEN, state.show_workspace),
        "other rig": (GREY, state.ghost is not None),
    }
    return [(text, colour) for text, (colour, shown) in entries.items() if shown]


def tensions_html(state: DesignState, found: StateEvaluation) -> str:
    """Return each module's tension as a bar between zero and the largest limit."""
    if found.allocation is None:
        return ""
    colours = tension_colours(state.rig, found)
    lines = list(zip(state.rig.modules, found.allocation.tensions.tolist(), colours, strict=True))
    return render("design.tensions", lines, float(state.rig.limits.upper.max()) or 1.0)


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


def own_spaces(folder: Path) -> list[str]:
    """Return the names of the files in a folder that are spaces for modules."""
    names = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        with suppress(TensionlabError):
            names += [path.name] * ("counts" in read_toml(path, "a space", RigError))
    return names
