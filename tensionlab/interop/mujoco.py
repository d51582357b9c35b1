"""Cables in MuJoCo: structure matrices of its tendons, an allocator for its actuators, and a `World`'s body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import repeat
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.allocation import Allocation, Allocator, Policy, Solver
from tensionlab.demand import Pose
from tensionlab.errors import InputError, optional_import
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model.pose import place_anchors, to_module_frames
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

__all__ = ["RigBody", "TendonAllocator", "gravity", "structure_matrix"]

MAX_STEP_S = 1e-3  # longest integration step of MuJoCo for a `RigBody`
AXIS_TOLERANCE = 1e-9  # smaller parts of a joint's motion along an axis of the world are rounding


def structure_matrix(model: Any, data: Any, tendons: Sequence[str], body: str) -> Floats:
    """Return the structure matrix of tendons that pull at a body, where it is now.

    It comes from MuJoCo's Jacobian of the tendons, which includes pulleys and sites on moving bodies. The joints
    of the body itself decide which components a wrench has; bodies attached to it move with it, and the bodies
    that carry it are at rest. Source: virtual work, as in Verhoeven 2004; Todorov, Erez and Tassa, "MuJoCo: A
    physics engine for model-based control", 2012.

    Parameters
    ----------
    model, data : mujoco.MjModel, mujoco.MjData
        The positions must have been computed, as by ``mj_forward`` or ``mj_step1``; after ``mj_step`` they are
        those before the step.
    tendons : sequence of str
        Names of the cables, in the order of the columns.
    body : str
        Name of the body that they hold.

    Returns
    -------
    (n, m) array
        ``W @ tensions`` is the wrench on the body at the origin of its frame, along the axes of the world in which
        it can move: force and moment (6) for a free body, the force (3) for one that only slides, forces along x
        and y and the moment about z (3) for one in that plane.

    Raises
    ------
    InputError
        No such tendon or body, or a body whose joints are not motions along and about axes of the world.
    MissingDependency
        If MuJoCo is not installed.

    Examples
    --------
    >>> import mujoco
    >>> import tensionlab as tl
    >>> from tensionlab.interop.mjcf import rig_to_mjcf
    >>> from tensionlab.interop.mujoco import structure_matrix
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> model = mujoco.MjModel.from_xml_string(rig_to_mjcf(rig))
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_forward(model, data)
    >>> W = structure_matrix(model, data, [module.name for module in rig.modules], "platform")
    >>> bool(abs(W - rig.structure_matrix(rig.home)).max() < 1e-12)
    True
    """
    mujoco = _import_mujoco("a structure matrix of MuJoCo's tendons")
    number = _number(model, "body", body)
    rows = [_number(model, "tendon", name) for name in tendons]
    own, axes, twist = _motions(mujoco, model, data, number, body)
    # A twist v = J q' does the work w·v, and shortens the cables by -L q'.
    pull = -_tendon_jacobian(mujoco, model, data)[np.ix_(rows, own)]
    return np.asarray(np.linalg.solve(twist[axes].T, pull.T), dtype=np.float64)


def gravity(model: Any, data: Any, body: str) -> Floats:
    """Return the wrench (n,) of gravity on a body and those attached to it, as in `structure_matrix`.

    It is at the origin of the body's frame, in N and N·m; the cables must exert the opposite.
    Arguments and errors are as in `structure_matrix`.

    Examples
    --------
    >>> import mujoco
    >>> from tensionlab.interop.mujoco import gravity
    >>> ball = '<body name="ball"><freejoint/><geom size="0.1" mass="2"/></body>'
    >>> model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_forward(model, data)
    >>> gravity(model, data, "ball").round(2)
    array([  0.  ,   0.  , -19.62,   0.  ,   0.  ,   0.  ])
    """
    mujoco = _import_mujoco("gravity in MuJoCo")
    number = _number(model, "body", body)
    _, axes, _ = _motions(mujoco, model, data, number, body)
    force = model.body_subtreemass[number] * model.opt.gravity
    moment = np.cross(data.subtree_com[number] - data.xpos[number], force)
    wrench: Floats = np.concatenate([force, moment])[axes] + 0.0  # no -0.0
    return wrench


class TendonAllocator:
    """Tension allocation for a body of a MuJoCo model, written to the controls of its actuators.

    Each tendon has one actuator without dynamics whose force is its control times a gain. The limits of the
    tension are ``ctrlrange`` times gain and gear; ``forcerange``, and ``actuatorfrcrange`` of the tendon, times
    gear; and zero, since cables cannot push. The tendon's passive forces (stiffness, damping, friction) come on
    top.

    Parameters
    ----------
    model : mujoco.MjModel
    tendons : sequence of str
        Names of the cables.
    body : str
        Name of the body that they hold.
    solver, reference, policy, wrench_weights
        As in `tensionlab.Allocator`.

    Attributes
    ----------
    lower, upper : (m,) arrays
        Limits of the tensions, in N.

    Raises
    ------
    InputError
        What `structure_matrix` raises when called; a tendon without an actuator, with several, or with one whose
        force is not its control times a gain; one without an upper limit, or that cannot pull.

    Examples
    --------
    >>> import mujoco
    >>> import tensionlab as tl
    >>> from tensionlab.interop.mjcf import rig_to_mjcf
    >>> from tensionlab.interop.mujoco import TendonAllocator
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> model = mujoco.MjModel.from_xml_string(rig_to_mjcf(rig))
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_forward(model, data)
    >>> allocate = TendonAllocator(model, [module.name for module in rig.modules], "platform", reference="middle")
    >>> allocate(data, [0.0, 0.0, 1.5]).tensions.round(3)
    array([2.899, 3.875, 1.923, 4.011])
    >>> data.ctrl.round(3)
    array([2.899, 3.875, 1.923, 4.011])
    """

    def __init__(
        self,
        model: Any,
        tendons: Sequence[str],
        body: str,
        solver: str | Solver = "newton",
        reference: ArrayLike | Literal["lower", "middle"] | None = None,
        policy: Policy | None = None,
        wrench_weights: ArrayLike | None = None,
    ) -> None:
        mujoco = _import_mujoco("an allocator for MuJoCo's actuators")
        self._model, self._tendons, self._body = model, tuple(tendons), body
        if not self._tendons:
            raise InputError("tendons is empty; give the names of the cables")
        _number(model, "body", body)
        self._actuators = [_actuator(mujoco, model, name) for name in self._tendons]
        ranges = map(_pulls, repeat(model), self._tendons, self._actuators)
        self._newton_per_control, self.lower, self.upper = np.array(list(ranges)).T
        self._allocate = Allocator((self.lower, self.upper), solver, reference, policy, wrench_weights)

    def __call__(self, data: Any, wrench: ArrayLike) -> Allocation:
        """Choose tensions for a wrench (n,) on the body, and write them to ``data.ctrl``.

        Where the status is FAILED there are none, and the controls stay as they are.
        """
        structure = structure_matrix(self._model, data, self._tendons, self._body)
        allocation = self._allocate(structure, wrench)
        if np.isfinite(allocation.tensions).all():
            data.ctrl[self._actuators] = allocation.tensions / self._newton_per_control
        return allocation


class RigBody:
    """Point or platform of a rig, moved by MuJoCo: the motion of a `tensionlab.hardware.World`.

    Masses and gravity are those of `rig_to_mjcf`. Tensions are not limited. Body frames are at rest.

    Parameters
    ----------
    rig : Rig
    position : (d,) array, optional
        Its first position, turned as at home; `Rig.home` if left out.

    Attributes
    ----------
    model, data : mujoco.MjModel, mujoco.MjData
        May be changed before time passes: geometry to collide with, a push in ``data.xfrc_applied``.
    held : bool
        Whether it is held in place: at first, since a platform that hangs would fall before its modules pull.
        Set it to False to let it move.

    Raises
    ------
    MissingDependency
        If MuJoCo is not installed.
    RigError
        What `rig_to_mjcf` refuses.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import World
    >>> from tensionlab.interop.mujoco import RigBody
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> body = RigBody(rig)
    >>> world = World(rig, body)
    >>> world.advance(0.1)
    >>> body.held = False  # its modules are idle, so that it falls
    >>> world.advance(0.1)
    >>> (world.pose.position - rig.home).round(3)
    array([ 0.   , -0.048,  0.   ])
    """

    def __init__(self, rig: Rig, position: ArrayLike | None = None) -> None:
        self._mujoco = _import_mujoco("a body moved by MuJoCo")
        self._rig = rig
        self.model = self._mujoco.MjModel.from_xml_string(rig_to_mjcf(rig))
        self.model.actuator_ctrllimited[:] = 0
        self.data = self._mujoco.MjData(self.model)
        if position is not None:
            self.data.qpos[: rig.dimension] = position
        self.held = True
        self._number = _number(self.model, "body", "platform")
        self._time = 0.0
        # In the plane, pulleys do not swivel.
        swivels = rig.pulleys is not None and rig.dimension == 3
        self._swivels = [i for i, module in enumerate(rig.modules) if swivels and module.pulley_radius is not None]
        names = [f"{rig.modules[i].name} pulley" for i in self._swivels]
        self._swivel_bodies = [_number(self.model, "body", name) for name in names]
        self._swivels_at_first = np.array([self.model.geom(name).pos for name in names])  # across the axis
        self._swivel_axes = np.zeros((0, 3)) if rig.pulleys is None else rig.pulleys.axes[self._swivels]
        self._anchors = place_anchors(rig.modules, rig.anchors, rig.at_rest)
        self.turn_pulleys()
        self._mujoco.mj_step1(self.model, self.data)

    @property
    def lengths(self) -> Floats:
        """Lengths of the cables, (m,) in m."""
        lengths: Floats = self.data.ten_length.copy()
        return lengths

    def apply_tensions(self, tensions: Floats) -> None:
        """Set the tensions of the cables from now on, (m,) in N."""
        self.data.ctrl[:] = tensions

    def __call__(self, time: float) -> Pose:
        """Return the pose at a time in s, which must not go back."""
        seconds, self._time = time - self._time, time
        if not self.held:
            steps = math.ceil(seconds / MAX_STEP_S - 1e-6)
            for _ in range(steps):
                self.model.opt.timestep = seconds / steps
                # In this order, lengths and pose are those after the step.
                self._mujoco.mj_step2(self.model, self.data)
                self.turn_pulleys()
                self._mujoco.mj_step1(self.model, self.data)
        return self._pose()

    def turn_pulleys(self) -> None:
        """Turn the rig's pulleys to where the cables are; only after you have changed ``data.qpos``.

        A pulley turns at once: its inertia is negligible against the pull of its cable.
        """
        rig = self._rig
        if not self._swivels:
            return
        attachments = rig.attachments
        if rig.kind == "platform":
            turn = np.zeros(9)
            self._mujoco.mju_quat2Mat(turn, self.data.qpos[3:7])
            attachments = attachments @ turn.reshape(3, 3).T
        away = to_module_frames(rig.modules, self.data.qpos[:3] + attachments - self._anchors, rig.at_rest)
        away, axes, first = away[self._swivels], self._swivel_axes, self._swivels_at_first
        sine = np.einsum("pi,pi->p", axes, np.cross(first, away))
        half = 0.5 * np.arctan2(sine, np.einsum("pi,pi->p", first, away))[:, None]
        self.model.body_quat[self._swivel_bodies] = np.hstack([np.cos(half), np.sin(half) * axes])

    def _pose(self) -> Pose:
        rig, data = self._rig, self.data
        place = data.qpos[: rig.dimension].copy()
        rotation = None
        if rig.kind == "platform":
            rotation = data.xmat[self._number].reshape(3, 3).copy()
        elif rig.kind == "planar":
            rotation = np.array(data.qpos[2])
        return Pose(place, rotation, rig.at_rest)


def _import_mujoco(what: str) -> ModuleType:
    """Return the library; MissingDependency, which says what needs it, if it is not installed."""
    with optional_import("mujoco", what):
        import mujoco
    module: ModuleType = mujoco
    return module


def _number(model: Any, kind: Literal["body", "tendon"], name: str) -> int:
    """Return the index of a body or a tendon."""
    try:
        return int(getattr(model, kind)(name).id)
    except KeyError:
        count = model.nbody if kind == "body" else model.ntendon
        names = ", ".join(repr(getattr(model, kind)(index).name) for index in range(count))
        raise InputError(f"the model has no {kind} {name!r}; it has {names or 'none'}") from None


def _motions(
    mujoco: ModuleType, model: Any, data: Any, number: int, name: str
) -> tuple[list[int], list[int], Floats]:
    """Return a body's own degrees of freedom, the components of its twist, and that by the velocities, (6, n)."""
    own = list(range(model.body_dofadr[number], model.body_dofadr[number] + model.body_dofnum[number]))
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacBody(model, data, linear, angular, number)
    twist = np.concatenate([linear, angular])[:, own]
    axes = np.flatnonzero(np.abs(twist).max(axis=1, initial=0.0) > AXIS_TOLERANCE).tolist()
    if not own:
        raise InputError(f"body {name!r} has no joint, so that no cable can move it; give it one, or another body")
    if len(axes) != len(own) or np.linalg.matrix_rank(twist[axes]) < len(own):
        raise InputError(
            f"body {name!r} moves by {len(own)} joint velocities along or about {len(axes)} axes of the world; "
            "give it a free joint, or joints along and about axes of the world"
        )
    return own, axes, twist


def _tendon_jacobian(mujoco: ModuleType, model: Any, data: Any) -> Floats:
    """Return the derivative of all tendons' lengths with respect to the joint velocities, (tendons, nv)."""
    # MuJoCo 4 stores rows of what can be other than zero, and their layout with the model; before, this was so
    # for large models alone, with the data.
    layout = model if hasattr(model, "ten_J_rownnz") else data
    if layout is data and not mujoco.mj_isSparse(model):
        dense: Floats = np.array(data.ten_J, dtype=np.float64).reshape(model.ntendon, model.nv)
        return dense
    jacobian = np.zeros((model.ntendon, model.nv))
    counts, starts = np.ravel(layout.ten_J_rownnz), np.ravel(layout.ten_J_rowadr)
    columns, values = np.ravel(layout.ten_J_colind), np.ravel(data.ten_J)
    for row, (count, start) in enumerate(zip(counts, starts, strict=True)):
        jacobian[row, columns[start : start + count]] = values[start : start + count]
    return jacobian


def _actuator(mujoco: ModuleType, model: Any, tendon: str) -> int:
    """Return the one actuator that pulls a tendon by its control times a gain."""
    here = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (
        model.actuator_trnid[:, 0] == _number(model, "tendon", tendon)
    )
    actuators = np.flatnonzero(here).tolist()
    names = ", ".join(repr(model.actuator(index).name) for index in actuators)
    if len(actuators) != 1:
        many = f"has {len(actuators)} actuators, {names}" if actuators else "has no actuator"
        raise InputError(f'tendon {tendon!r} {many}; give it one, such as <motor tendon="{tendon}" gear="-1"/>')
    (index,) = actuators
    plain = (
        model.actuator_gaintype[index] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_dyntype[index] == mujoco.mjtDyn.mjDYN_NONE
        and model.actuator_gear[index, 0] * model.actuator_gainprm[index, 0] != 0.0
    )
    if not plain:
        raise InputError(
            f"actuator {names} of tendon {tendon!r} does not pull by its control times a gain; give a <motor>, or "
            "a <general> with a fixed gain other than 0, no bias and no dynamics"
        )
    return int(index)


def _pulls(model: Any, tendon: str, actuator: int) -> tuple[float, float, float]:
    """Return the tension for each unit of control, and the limits of the tension, in N."""
    row = _number(model, "tendon", tendon)
    gear, gain = float(model.actuator_gear[actuator, 0]), float(model.actuator_gainprm[actuator, 0])
    lower, upper = 0.0, math.inf  # a force along a tendon lengthens it, and cables cannot push
    for limited, span, factor in (
        (model.actuator_ctrllimited[actuator], model.actuator_ctrlrange[actuator], -gear * gain),
        (model.actuator_forcelimited[actuator], model.actuator_forcerange[actuator], -gear),
        (model.tendon_actfrclimited[row], model.tendon_actfrcrange[row], -gear),
    ):
        if limited:
            low, high = sorted(factor * float(end) + 0.0 for end in span)  # no -0.0
            lower, upper = max(lower, low), min(upper, high)
    name = model.actuator(actuator).name
    if not math.isfinite(upper):
        raise InputError(
            f"actuator {name!r} of tendon {tendon!r} has no limit; give it a ctrlrange or a forcerange"
        )
    if upper < lower or upper <= 0.0:
        raise InputError(
            f"actuator {name!r} of tendon {tendon!r} cannot pull: its range, gain and gear lead to tensions "
            f"from {lower:g} to {upper:g} N; turn the sign of its gear, or correct its ranges"
        )
    return -gear * gain, lower, upper
