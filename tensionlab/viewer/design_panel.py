"""The panel of the design page: fields and buttons that become edits, and texts about the state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tensionlab.model.files import load_rig
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig
from tensionlab.solvers import select_solvers
from tensionlab.solvers.base import POLICIES, Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import GREEN, RED
from tensionlab.support.files.named import list_names
from tensionlab.support.table import STATUS_MARKS
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_scene import tension_colours
from tensionlab.viewer.evaluation import StateEvaluation
from tensionlab.viewer.html import norm, number, render, vector
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.server import entered, lay_out, pressed
from tensionlab.viewer.solver_comparison import SolverPanel
from tensionlab.viewer.state import DesignState, Edit, selected_module
from tensionlab.viewer.workspace import COARSE, Volume
from tensionlab.workspace.layout.task import LayoutTask
from tensionlab.workspace.metrics import METRICS, find_metric
from tensionlab.workspace.orientations import roll_pitch_yaw, roll_pitch_yaw_of
from tensionlab.workspace.volume import describe_step

if TYPE_CHECKING:
    import viser

NONE, AS_LOADED = "none", "as loaded"
OWN_POLICY = "the solver's own"
STEP_M, STEP_N, STEP_DEG = 0.01, 0.1, 1.0
LEVEL_STEPS = 50
POLICY_WORDS = {
    "force": "the nearest wrench is rendered",
    "tension": "the tensions nearest to equilibrium are taken",
    "direction": "the longest wrench in the desired direction is rendered",
}  # meaning of each policy where the desired wrench is infeasible
AT_LIMIT_N = 1e-6
Change = Callable[[DesignState, Any], DesignState]  # change of a state by what is entered in a field


class PanelActions(Protocol):
    """Actions of the page that the panel calls."""

    def edit(self, change: Edit, step: object = None, key: object = None) -> None: ...  # noqa: D102
    def undo(self) -> None: ...  # noqa: D102
    def redo(self) -> None: ...  # noqa: D102
    def save(self, path: str) -> None: ...  # noqa: D102
    def snap_to_space(self, word: str) -> None: ...  # noqa: D102


class DesignPanel:
    """Fields of the design page; `show` brings them up to date."""

    def __init__(self, server: viser.ViserServer, page: PanelActions, rig: Rig, file: str) -> None:
        """``file`` is where the rig is saved by default."""
        self._page, self._gui, self._rig = page, server.gui, rig
        self._shown: list[tuple[Any, Callable[[DesignState], Any]]] = []
        gui: Any = self._gui
        lay_out(gui)
        self._status, self._problem, self._tensions = (gui.add_html("") for _ in range(3))
        both = gui.add_button_group("", ("Undo", "Redo"))
        pressed(both, lambda: page.undo() if both.value == "Undo" else page.redo())
        for name, key, act in (("Undo", "Z", page.undo), ("Redo", "Y", page.redo)):
            triggered(gui.add_command(name, hotkey=key, modifier="cmd/ctrl"), act)
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

    # Each field has a function that reads its value from a state, None for nothing, and one that changes a state.

    def _bind(self, field: Any, read: Callable[[DesignState], Any], change: Change) -> Any:
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
        add: Any = self._gui.add_vector2 if size == 2 else self._gui.add_vector3
        return add(label, (0.0,) * size, step=step)

    def _add_hand(self) -> None:
        gui, d, n = self._gui, self._rig.dimension, self._rig.n
        position = self._vector("position m", d, STEP_M)
        self._position = self._bind(position, lambda state: state.position, edits.move_hand)
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

    def _add_modules(self) -> None:
        gui, names = self._gui, tuple(module.name for module in self._rig.modules)
        self._selected = self._bind(
            gui.add_dropdown("module", (NONE, *names)),
            lambda state: state.selected if selected_module(state) else NONE,
            lambda state, name: replace(state, selected="" if name == NONE else name),
        )
        with gui.add_folder(None) as self._own:
            self._add_selected_module()
        pressed(gui.add_button("Add a module"), lambda: self._page.edit(edits.add_module))
        self._grid = self._bind_attribute(gui.add_number("snap to grid m", 0.0, min=0.0, step=STEP_M), "grid_m")
        space: Any = gui.add_text("snap to space", "", hint="Name of a space, or its file: walls for modules")
        self._space = entered(space, lambda: self._page.snap_to_space(space.value))
        self._walls = gui.add_html("")
        ghost: Any = gui.add_dropdown("compare with", (NONE, AS_LOADED, *list_names("rigs")))
        entered(ghost, lambda: self._page.edit(self._compare_with(ghost.value)))

    def _add_selected_module(self) -> None:
        gui, d, bind = self._gui, self._rig.dimension, self._bind_module
        bind(gui.add_text("name", ""), lambda _, module: module.name, edits.rename)
        bind(
            self._vector("anchor m", d, STEP_M),
            lambda state, module: state.anchors[state.names.index(module.name)],
            edits.move_anchor,
        )
        if self._rig.n > d:
            attachment = self._vector("attachment m", d, STEP_M)
            bind(attachment, lambda _, module: np.asarray(module.attachment), edits.move_attachment)
        low, high = (gui.add_number(f"{end} limit N", 0.0, min=0.0, step=STEP_N) for end in ("lower", "upper"))
        bind(low, lambda _, module: module.lower, lambda s, name, v: edits.set_limits(s, name, v, high.value))
        bind(high, lambda _, module: module.upper, lambda s, name, v: edits.set_limits(s, name, low.value, v))
        bind(gui.add_text("body frame", ""), lambda _, module: module.frame, edits.set_frame)
        self._body = bind(self._vector("body at m", d, STEP_M), body_position, edits.move_body)
        remove = gui.add_button("Remove this module", color="gray")
        pressed(remove, lambda: self._page.edit(lambda state: edits.remove_module(state, state.selected)))

    def _add_workspace(self) -> None:
        gui = self._gui
        self._bind_attribute(gui.add_checkbox("show", False), "show_workspace")
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

    def _compare_with(self, name: str) -> Edit:
        rig = None if name == NONE else self._rig if name == AS_LOADED else load_rig(name)
        return edits.set_fields(ghost=rig)

    def show(self, state: DesignState, found: StateEvaluation, problem: str) -> None:
        """Bring all fields up to date; a field whose entry was refused keeps it, to be corrected."""
        self._status.content = status_html(state, found)
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
        for field, read in self._shown:
            if (value := read(state)) is not None:
                field.value = shown_value(value)
        self._walls.content = walls_html(state.task)

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
        self._share.content = share_html(state, volume, ghost)


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


def set_part(state: DesignState, part: Any, start: int) -> DesignState:
    """Set components of the desired wrench, from a first one on."""
    wrench, values = state.wrench.copy(), np.atleast_1d(part)
    wrench[start : start + len(values)] = values
    return edits.set_wrench(state, wrench)


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


def triggered(command: Any, act: Callable[[], None]) -> None:
    """Call a function when a keyboard shortcut is pressed in a browser."""

    async def triggered(event: Any) -> None:
        act()

    command.on_trigger(triggered)


def status_html(state: DesignState, found: StateEvaluation) -> str:
    """Return the status, the forces and the margin."""
    if found.allocation is None:
        return render("design.status", RED, "no answer", found.problem, [], 0.0)
    word, colour, meaning = "EXACT", GREEN, "the desired force is rendered"
    code = Status(int(found.allocation.status))
    if code is Status.NEAREST:
        word, colour = "NEAREST", RED
        meaning = "certified infeasible: " + POLICY_WORDS.get(str(found.policy), "another wrench is rendered")
        if found.policy == "direction" and np.isfinite(found.allocation.scale):
            meaning += f", {100 * float(found.allocation.scale):.3g} % of it"
    elif code is not Status.EXACT:
        word, colour, meaning = code.name, RED, STATUS_MARKS[code].word
    return render("design.status", colour, word, meaning, _lines(state, found), 1.0 / force_scale(state.rig))


def _lines(state: DesignState, found: StateEvaluation) -> list[tuple[str, str, str]]:
    """Return name, value and remark of each line about the wrench and the margin."""
    assert found.allocation is not None
    assert found.rendered is not None
    d, has_torque = state.rig.dimension, state.rig.n > state.rig.dimension
    lines = []
    for name, part, unit in (("force", slice(0, d), "N"), ("torque", slice(d, None), "N·m"))[: 1 + has_torque]:
        for which, wrench in (("desired", state.wrench), ("rendered", found.rendered)):
            lines.append((f"{which} {name}", f"{norm(wrench[part])} {unit}", vector(wrench[part])))
    remark = "N and N·m together" if has_torque else ""
    lines.append(("error", f"{number(float(found.allocation.residual))} N", remark))
    if found.certificate is not None:
        proof = f"along {vector(found.certificate.direction)}; desired {number(found.certificate.desired)} N"
        lines.append(("at most", f"{number(found.certificate.reach)} N", proof))
    lines.append(("capacity margin", f"{found.margin:.3g} N", "at the hand"))
    return lines


def tensions_html(state: DesignState, found: StateEvaluation) -> str:
    """Return each module's tension as a bar between zero and the largest limit."""
    if found.allocation is None:
        return ""
    most, colours = float(state.rig.limits.upper.max()) or 1.0, tension_colours(state.rig, found)
    lines = []
    for module, tension, colour in zip(state.rig.modules, found.allocation.tensions, colours, strict=True):
        limit = "lower limit" if tension <= module.lower + AT_LIMIT_N else ""
        limit = "upper limit" if tension >= module.upper - AT_LIMIT_N else limit
        lines.append((module, float(tension), colour, limit))
    return render("design.tensions", lines, most)


def share_html(state: DesignState, volume: Volume, ghost: Volume | None = None) -> str:
    """Return the share of the box in which the metric is above the level."""
    metric = find_metric(state.metric)
    return render(
        "design.share",
        metric.title,
        "" if metric.unit == "1" else f" {metric.unit}",
        metric.description,
        volume,
        state.level,
        describe_step(volume.axes),
        ghost,
    )


def walls_html(task: LayoutTask | None) -> str:
    """Return the walls of a space."""
    if task is None:
        return render("common.note", "With a space, anchors that are dragged stay on its walls.")
    return render("common.note", f"{task.name}: {', '.join(surface.name for surface in task.space.surfaces)}")
