"""The state of the design page and its edits: pure functions from state to state."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import RigError, TensionlabError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import WORLD, Module
from tensionlab.model.pose import RestPose
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Policy
from tensionlab.support.arrays import Floats, readonly_copy
from tensionlab.workspace.layout.space import Space
from tensionlab.workspace.layout.task import LayoutTask
from tensionlab.workspace.wrench_set import required_margin

HAND = "hand"  # name of the hand, or the platform, among the names of modules
DECIMALS = 4  # decimals of coordinates in m and forces in N that are dragged
Study = Literal["force in a circle", "force in all directions", "hand in a circle"]
STUDIES: tuple[Study, ...] = get_args(Study)  # problems at which solvers are compared


@dataclass(frozen=True, eq=False)
class DesignState:
    """Everything that a person can change on the design page."""

    rig: Rig
    position: Floats  # hand, or the platform's reference point, (d,), in m
    rotation: Floats | None  # platform: (3, 3) in space, an angle in rad in the plane; None for a point
    wrench: Floats  # desired, (n,), in N and N·m, in addition to what the rig requires
    solver: str = "newton"  # as `tensionlab.allocate` takes it
    policy: Policy | None = None
    compared: tuple[str, ...] = ()  # solvers that are compared with that one
    study: Study = STUDIES[0]  # problems of their comparison
    metric: str = "capacity-margin"  # of `tensionlab.workspace.METRICS`
    level: float = 0.0  # the workspace is drawn where the metric is above it
    show_workspace: bool = False
    selected: str = ""  # module, `HAND` or nothing: where the handle with arrows is
    grid_m: float = 0.0  # step of the grid to which dragged points snap; 0 for none
    task: LayoutTask | None = None  # space to whose surfaces anchors snap
    ghost: Rig | None = None  # other rig, drawn for comparison

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the modules."""
        return tuple(module.name for module in self.rig.modules)

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
        """Wrench that the cables exert, (n,): the desired one, and what the rig requires."""
        return self.wrench + self.rig.required.middle(self.rig, self.rotation)


Edit = Callable[[DesignState], DesignState]  # a change of the state; RigError for what no rig can be


def begin(rig: Rig) -> DesignState:
    """Return the state in which a rig is first shown: the hand at home, no force desired."""
    return DesignState(
        rig=rig, position=rig.home, rotation=rig.home_orientation, wrench=readonly_copy(np.zeros(rig.n))
    )


def opening(rig: Rig) -> DesignState:
    """Return the state in which a page opens: the workspace, and a force of half the margin across the view."""
    state, wrench = replace(begin(rig), show_workspace=True), np.zeros(rig.n)
    with suppress(TensionlabError):  # a cable has no length at home
        structure = rig.structure_matrix(state.position, state.rotation, rig.at_rest)
        margin = float(required_margin(rig, structure, rig.required, state.rotation))
        wrench[("xyz".index(rig.vertical) - 1) % rig.dimension] = float(f"{max(0.5 * margin, 0.0):.2g}")
    return set_wrench(state, wrench)


def selected_module(state: DesignState) -> Module | None:
    """Return the selected module; None if something else, or nothing, is selected."""
    return find(state, state.selected) if state.selected in state.names else None


def find(state: DesignState, name: str) -> Module:
    """Return a module by its name; RigError if there is none."""
    if name not in state.names:
        raise RigError(f'rig "{state.rig.name}" has no module "{name}"; it has {", ".join(state.names)}')
    return state.rig.modules[state.names.index(name)]


def change_module(state: DesignState, name: str, /, **changes: Any) -> DesignState:
    """Change attributes of a module, such as ``lower`` and ``upper``."""
    old = find(state, name)
    new = replace(old, **changes)
    return _with_modules(state, tuple(new if module is old else module for module in state.rig.modules))


def _with_modules(state: DesignState, modules: tuple[Module, ...]) -> DesignState:
    """Return the state with other modules, without the rest poses of frames that carry nothing."""
    carried = {module.frame for module in modules} | {body.frame for body in state.rig.bodies}
    rest = tuple(at_rest for at_rest in state.rig.rest if at_rest.name in carried)
    return replace(state, rig=replace(state.rig, modules=modules, rest=rest))


def _in_frame(rig: Rig, frame: str, point: Floats) -> Floats:
    """Return a place in the world, (d,), in the axes of a frame at rest."""
    at_rest = rig.at_rest.get(frame)
    if at_rest is None:  # the world, or a frame without modules yet: at the origin
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


def nearest_on_surfaces(space: Space, place: Floats) -> Floats:
    """Return the point of the surfaces nearest to a place, (d,), in m; the place if none is in the world."""
    points = []
    for surface in (surface for surface in space.surfaces if surface.frame == WORLD):
        # Of a rectangle or a box this is the nearest point, of a skew surface one that is near.
        share = np.linalg.lstsq(surface.edges.T, place - surface.corner, rcond=None)[0]
        points.append(surface.corner + np.clip(share, 0.0, 1.0) @ surface.edges)
    return min(points, key=lambda point: float(np.linalg.norm(point - place)), default=place)


def outlines(space: Space) -> Floats:
    """Return the edges of all surfaces as line segments (k, 2, d), in m."""
    segments: list[Floats] = []
    for surface in (surface for surface in space.surfaces if surface.frame == WORLD):
        edges = surface.edges
        corners = surface.corner + np.array(list(product((0.0, 1.0), repeat=len(edges)))) @ edges
        pairs = product(range(len(corners)), (1 << bit for bit in range(len(edges))))
        segments += [corners[[i, i | step]] for i, step in pairs if not i & step]
    return np.stack(segments) if segments else np.empty((0, 2, space.dimension))


def move_anchor(state: DesignState, name: str, place: ArrayLike) -> DesignState:
    """Put an anchor at a place in the world, (d,), in m, or at the nearest point of the grid and the surfaces."""
    module, point = find(state, name), snap(state, place)
    if state.task is not None and state.task.space.dimension == state.rig.dimension:
        point = np.round(nearest_on_surfaces(state.task.space, point), DECIMALS) + 0.0
    anchor = _in_frame(state.rig, module.frame, point)
    return state if np.array_equal(anchor, module.anchor) else change_module(state, name, anchor=anchor)


def rename(state: DesignState, name: str, new: str) -> DesignState:
    """Give a module another name."""
    renamed = change_module(state, name, name=new)
    return replace(renamed, selected=new) if state.selected == name else renamed


def set_frame(state: DesignState, name: str, frame: str) -> DesignState:
    """Put a module on a body frame, or in the world, where it is; a new frame is at the origin of the world."""
    place, frame = state.anchors[state.names.index(name)], frame or WORLD
    return change_module(state, name, frame=frame, anchor=_in_frame(state.rig, frame, place))


def move_body(state: DesignState, name: str, position: ArrayLike) -> DesignState:
    """Move the body of a module, with all modules on it, to a place, (d,), in m; a module in the world stays."""
    frame, rest = find(state, name).frame, {at_rest.name: at_rest for at_rest in state.rig.rest}
    if frame not in state.rig.frames:
        return state
    rotation = rest[frame].rotation if frame in rest else None
    rest[frame] = RestPose(frame, np.asarray(position, np.float64), rotation)
    return replace(state, rig=replace(state.rig, rest=tuple(rest.values())))


def add_module(state: DesignState) -> DesignState:
    """Add a module above the hand, as far from it as the nearest one, with the limits of the first; select it."""
    rig = state.rig
    number = next(i for i in range(1, rig.m + 2) if f"module {i}" not in state.names)
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
    """Remove a module; RigError for the last one."""
    removed = find(state, name)
    if state.rig.m == 1:
        raise RigError(f'"{name}" is the only module of the rig; add another before it is removed')
    others = tuple(module for module in state.rig.modules if module is not removed)
    return replace(_with_modules(state, others), selected="" if state.selected == name else state.selected)


def move_hand(state: DesignState, place: ArrayLike) -> DesignState:
    """Put the hand, or the platform's reference point, at a place, (d,), in m, or the nearest grid point."""
    return replace(state, position=readonly_copy(snap(state, place)))


def make_home(state: DesignState) -> DesignState:
    """Make the pose of the hand or platform the rig's home."""
    from scipy.spatial.transform import Rotation

    turn = state.rotation
    if turn is not None and state.rig.dimension == 3:
        turn = Rotation.from_matrix(turn).as_rotvec().round(DECIMALS) + 0.0
    turn = None if turn is None or not turn.any() else turn
    return replace(state, rig=replace(state.rig, home=state.position, home_rotation=turn))


def turn_platform(state: DesignState, rotation: ArrayLike) -> DesignState:
    """Turn the platform: a matrix (3, 3) in space, an angle in rad in the plane; nothing for a point."""
    if state.rotation is None:
        return state
    return replace(state, rotation=readonly_copy(np.asarray(rotation, np.float64)))


def set_wrench(state: DesignState, wrench: ArrayLike) -> DesignState:
    """Set the desired wrench, (n,), in N and N·m."""
    return replace(state, wrench=readonly_copy(np.asarray(wrench, np.float64)))


def ghost_state(state: DesignState) -> DesignState | None:
    """Return the state of the other rig, at the same place and turned alike if it can be; None without one."""
    ghost = state.ghost
    if ghost is None or ghost.dimension != state.rig.dimension:
        return None
    same = ghost.n > ghost.dimension and state.rotation is not None
    wrench = state.wrench if ghost.n == state.rig.n else readonly_copy(np.zeros(ghost.n))
    return replace(state, rig=ghost, rotation=state.rotation if same else ghost.home_orientation, wrench=wrench)


def set_fields(**changes: Any) -> Edit:
    """Return the edit that sets attributes of the state, such as ``solver`` or ``level``."""
    return lambda state: replace(state, **changes)
