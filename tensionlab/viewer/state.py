"""The state of the design page, and its edits: pure functions from state to state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import RigError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import WORLD, Module
from tensionlab.model.pose import RestPose
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Policy
from tensionlab.support.arrays import Floats, readonly_copy
from tensionlab.viewer.snapping import nearest_on_surfaces
from tensionlab.workspace.layout.task import LayoutTask

HAND = "hand"  # name of the hand, or the platform, among the names of modules

DECIMALS = 4  # decimals of coordinates in m and forces in N that are dragged

Display = Literal["surface", "off"]
Study = Literal["force in a circle", "force in all directions", "hand in a circle"]
STUDIES: tuple[Study, ...] = get_args(Study)  # problems at which solvers are compared


@dataclass(frozen=True, eq=False)
class DesignState:
    """Everything that a person can change on the design page.

    Attributes
    ----------
    rig : Rig
        As it is designed.
    position : (d,) array
        Of the hand, or of the platform's reference point, in m.
    rotation : (3, 3) array, number or None
        Of the platform: a matrix in space, an angle in rad in the plane; None for a point.
    wrench : (n,) array
        Desired wrench, in N and N·m, in addition to what the rig requires.
    solver, policy : str, and a policy or None
        As `tensionlab.allocate` takes them.
    compared : tuple of str
        Solvers that are compared with that one.
    study : str
        Problems of their comparison, in addition to the desired wrench; one of `STUDIES`.
    metric : str
        Of the workspace, by its name in `tensionlab.workspace.METRICS`.
    level : float
        Of the metric, above which the workspace is drawn.
    display : "surface" or "off"
        How the workspace is drawn.
    show_available : bool
        Whether the forces that are available at the hand are drawn.
    selected : str
        Name of a module, `HAND`, or nothing: what the handle with arrows is at.
    grid_m : float
        Step of the grid to which what is dragged snaps, in m; 0 for none.
    task : LayoutTask or None
        Of a space file: to its surfaces anchors snap, and for its target layouts are searched for.
    ghost : Rig or None
        Other rig that is drawn for comparison.
    dark : bool
        Whether the page is dark.
    """

    rig: Rig
    position: Floats
    rotation: Floats | None
    wrench: Floats
    solver: str = "newton"
    policy: Policy | None = None
    compared: tuple[str, ...] = ()
    study: Study = STUDIES[0]
    metric: str = "capacity-margin"
    level: float = 0.0
    display: Display = "off"
    show_available: bool = True
    selected: str = ""
    grid_m: float = 0.0
    task: LayoutTask | None = None
    ghost: Rig | None = None
    dark: bool = False

    @property
    def anchors(self) -> Floats:
        """Anchors in the world, (m, d), in m, with body frames at rest."""
        return pose.place_anchors(self.rig.modules, self.rig.anchors, self.rig.at_rest)

    @property
    def attachments(self) -> Floats:
        """Attachments in the world, (m, d), in m."""
        arms = self.rig.attachments
        if self.rotation is not None:
            arms = kinematics.rotate(pose.rotations(self.rotation, self.rig.dimension, "rotation"), arms)
        return self.position + arms

    @property
    def exerted(self) -> Floats:
        """Wrench that the cables are to exert, (n,): the desired one, and what the rig requires."""
        return self.wrench + self.rig.required.middle(self.rig, self.rotation)


Edit = Callable[[DesignState], DesignState]  # a change of the state; RigError for what no rig can be


def begin(rig: Rig) -> DesignState:
    """Return the state in which a rig is first shown: the hand at home, no force desired.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.viewer import state
    >>> shown = state.begin(tl.load_rig("bartels2026-validation"))
    >>> state.move_anchor(shown, "floor-1", [1.0, 0.0, 0.0]).rig.modules[0].anchor
    array([1., 0., 0.])
    """
    return DesignState(rig=rig, position=rig.home, rotation=_upright(rig), wrench=readonly_copy(np.zeros(rig.n)))


def _upright(rig: Rig) -> Floats | None:
    if rig.n == rig.dimension:
        return None
    return readonly_copy(np.zeros(())) if rig.dimension == 2 else readonly_copy(np.eye(3))


def find(state: DesignState, name: str) -> Module:
    """Return a module by its name.

    Raises
    ------
    RigError
        If there is none of that name.
    """
    for module in state.rig.modules:
        if module.name == name:
            return module
    names = ", ".join(module.name for module in state.rig.modules)
    raise RigError(f'rig "{state.rig.name}" has no module "{name}"; it has {names}')


def _replaced(state: DesignState, old: Module, **changes: Any) -> DesignState:
    """Return the state with some keys of a module changed."""
    new = replace(old, **changes)
    modules = tuple(new if each is old else each for each in state.rig.modules)
    return replace(state, rig=with_modules(state.rig, modules))


def with_modules(rig: Rig, modules: tuple[Module, ...]) -> Rig:
    """Return the rig with other modules, without the rest poses of frames that carry none of them."""
    carried = {module.frame for module in modules}
    return replace(rig, modules=modules, rest=tuple(each for each in rig.rest if each.name in carried))


def in_frame(rig: Rig, frame: str, place: ArrayLike) -> Floats:
    """Return a place in the world, (d,), in the axes of a frame, which is where it is at rest."""
    point = np.asarray(place, np.float64)
    at_rest = rig.at_rest.get(frame)
    if at_rest is None:  # the world, or a frame that no module is on yet: at the origin
        return point
    offset: Floats = point - np.asarray(at_rest.position)
    if at_rest.rotation is None:
        return offset
    return np.asarray(pose.rotations(at_rest.rotation, rig.dimension, "rotation").T @ offset)


def snap(state: DesignState, place: ArrayLike) -> Floats:
    """Return the nearest point of the grid, (d,), in m; without a grid the place, to a tenth of a mm."""
    point = np.asarray(place, np.float64)
    if not state.grid_m:
        return np.asarray(np.round(point, DECIMALS) + 0.0)
    return np.asarray(np.round(point / state.grid_m) * state.grid_m + 0.0)


def move_anchor(state: DesignState, name: str, place: ArrayLike) -> DesignState:
    """Put an anchor at a place in the world, (d,), in m, or at the nearest point of the grid and the surfaces."""
    module, point = find(state, name), snap(state, place)
    if state.task is not None and state.task.space.dimension == state.rig.dimension:
        point = np.round(nearest_on_surfaces(state.task.space, point), DECIMALS) + 0.0
    anchor = in_frame(state.rig, module.frame, point)
    return state if np.array_equal(anchor, module.anchor) else _replaced(state, module, anchor=anchor)


def move_attachment(state: DesignState, name: str, place: ArrayLike) -> DesignState:
    """Put an attachment at a place in platform axes, (d,), in m."""
    return _replaced(state, find(state, name), attachment=np.asarray(place, np.float64))


def relimit(state: DesignState, name: str, lower: float, upper: float) -> DesignState:
    """Give a module other tension limits, in N."""
    return _replaced(state, find(state, name), lower=float(lower), upper=float(upper))


def rename(state: DesignState, name: str, new: str) -> DesignState:
    """Give a module another name."""
    changed = _replaced(state, find(state, name), name=new)
    return replace(changed, selected=new) if state.selected == name else changed


def set_frame(state: DesignState, name: str, frame: str) -> DesignState:
    """Put a module on a body frame, or in the world, where it is; a new frame is at the origin of the world."""
    module = find(state, name)
    place = state.anchors[state.rig.modules.index(module)]
    return _replaced(state, module, frame=frame or WORLD, anchor=in_frame(state.rig, frame or WORLD, place))


def move_frame(state: DesignState, name: str, position: ArrayLike) -> DesignState:
    """Put a body frame, with its modules, elsewhere: its origin, (d,), in m."""
    rest = {each.name: each for each in state.rig.rest}
    turn = rest[name].rotation if name in rest else None
    rest[name] = RestPose(name, np.asarray(position, np.float64), turn)
    return replace(state, rig=replace(state.rig, rest=tuple(rest.values())))


def add_module(state: DesignState) -> DesignState:
    """Add a module above the hand, as far from it as the nearest one, with the limits of the first; select it."""
    rig, taken = state.rig, {module.name for module in state.rig.modules}
    number = next(i for i in range(1, rig.m + 2) if f"module {i}" not in taken)
    away = float(np.linalg.norm(state.anchors - state.position, axis=1).min()) or 1.0
    up = rig.upward if rig.up is not None else np.eye(rig.dimension)[1]
    new = replace(
        rig.modules[0],
        name=f"module {number}",
        anchor=snap(state, state.position + away * up),
        attachment=np.zeros(rig.dimension),
        frame=WORLD,
    )
    return replace(state, rig=replace(rig, modules=(*rig.modules, new)), selected=new.name)


def remove_module(state: DesignState, name: str) -> DesignState:
    """Remove a module. RigError for the last one."""
    gone = find(state, name)
    if state.rig.m == 1:
        raise RigError(f'"{name}" is the only module of the rig; add another before it is removed')
    rig = with_modules(state.rig, tuple(each for each in state.rig.modules if each is not gone))
    return replace(state, rig=rig, selected="" if state.selected == name else state.selected)


def name_rig(state: DesignState, name: str) -> DesignState:
    """Give the rig another name."""
    return replace(state, rig=replace(state.rig, name=name))


def set_home(state: DesignState) -> DesignState:
    """Make the place of the hand the home of the rig."""
    return replace(state, rig=replace(state.rig, home=state.position))


def move_hand(state: DesignState, place: ArrayLike) -> DesignState:
    """Put the hand, or the platform's reference point, at a place, (d,), in m, or the nearest grid point."""
    return replace(state, position=readonly_copy(snap(state, place)))


def turn_platform(state: DesignState, rotation: ArrayLike) -> DesignState:
    """Turn the platform: a matrix (3, 3) in space, an angle in rad in the plane; nothing for a point."""
    if state.rotation is None:
        return state
    return replace(state, rotation=readonly_copy(np.asarray(rotation, np.float64)))


def set_wrench(state: DesignState, wrench: ArrayLike) -> DesignState:
    """Set the desired wrench, (n,), in N and N·m."""
    return replace(state, wrench=readonly_copy(np.asarray(wrench, np.float64)))


def of_ghost(state: DesignState, ghost: Rig) -> DesignState:
    """Return the state with another rig of as many dimensions, at the same place and turned alike if it can be."""
    turns = ghost.n > ghost.dimension
    rotation = state.rotation if turns and state.rotation is not None else _upright(ghost)
    wrench = state.wrench if ghost.n == state.rig.n else readonly_copy(np.zeros(ghost.n))
    return replace(state, rig=ghost, rotation=rotation, wrench=wrench)


def set_fields(**changes: Any) -> Edit:
    """Return the edit that sets attributes of the state, such as ``solver`` or ``level``."""
    return lambda state: replace(state, **changes)
