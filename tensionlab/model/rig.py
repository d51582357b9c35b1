"""Rigs: a set of modules around a point or a platform, with its geometry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import RigError, ShapeError
from tensionlab.model import kinematics, pose
from tensionlab.model.bodies import HAND, Body
from tensionlab.model.kinematics import PoseEstimate
from tensionlab.model.module import (
    GRAVITY_M_S2,
    KINDS,
    WORLD,
    ArrayRecord,
    Kind,
    Module,
    Platform,
    TensionLimits,
    require_name,
    require_up,
    upward,
    vector,
)
from tensionlab.model.pose import CoordinateFrame, Frames, RestPose
from tensionlab.model.pulleys import Pulleys, route_cables
from tensionlab.model.requirement import Requirement
from tensionlab.support.arrays import Floats, common_axes, readonly_copy
from tensionlab.support.files.reading import brief
from tensionlab.support.formatting import format_count, format_range, format_vector
from tensionlab.support.table import Column, Table

if TYPE_CHECKING:
    from tensionlab.allocation import Allocation, Policy, Solver


class Cables(NamedTuple):
    """Cables of a rig at a pose, in world axes and m."""

    lengths: Floats  # (..., m)
    directions: Floats  # unit vectors from the attachments along the cables, (..., m, d)
    arms: Floats | None  # from the reference point to the attachments, (..., m, d); None for a point
    straight: Floats  # lengths without what lies on a pulley, (..., m)


@dataclass(frozen=True, eq=False)
class Rig(ArrayRecord):
    """Set of modules around a point or a platform.

    RigError names the module and the wrong key. Parallel cables (same anchor, same attachment) are allowed.

    Attributes
    ----------
    kind : str
        A key of `KINDS`: "planar-point", "point", "planar", "platform" or "spherical".
    home : (d,) read-only array
        Nominal position of the point or of the platform's reference point, in m, and the default guess of the
        forward kinematics; of a spherical rig the fixed point about which its platform turns.
    platform : Platform or None
        Mass and inertia of what the cables hold, if known.
    description, source : str
        Description of the rig, and the source of its numbers.
    up : str or None
        World axis that points up: "x", "y" or "z", with a minus if it points down. None if unknown: such a rig
        has no weight and plays no scenario.
    required : Requirement
        Wrenches that the cables must exert at every pose; none by default.
    rest : tuple of RestPose
        Default poses of the body frames; frames without one are at the origin of the world.
    bodies : tuple of Body
        What the cables must stay clear of, such as the user's head; none by default.
    home_rotation : (3,) or (1,) read-only array, or None
        Orientation at home: axis times angle in space, an angle in the plane, in rad; None for the identity.

    Examples
    --------
    >>> import tensionlab as tl
    >>> anchors = {"left": [-1.5, 2.4], "right": [1.5, 2.4], "floor": [0.0, 0.0]}
    >>> modules = tuple(tl.Module(name, anchor, lower=0.5, upper=6.0) for name, anchor in anchors.items())
    >>> rig = tl.Rig("my-wall", "planar-point", modules, home=[0.0, 1.2], up="y")
    >>> rig.n, rig.m
    (2, 3)
    >>> rig.structure_matrix(rig.home).round(3)
    array([[-0.781,  0.781,  0.   ],
           [ 0.625,  0.625, -1.   ]])
    """

    name: str
    kind: str
    modules: tuple[Module, ...]
    home: Floats
    platform: Platform | None = None
    description: str = ""
    source: str = ""
    up: str | None = None
    required: Requirement = field(default_factory=Requirement)
    rest: tuple[RestPose, ...] = ()
    bodies: tuple[Body, ...] = ()
    home_rotation: Floats | None = None

    def __post_init__(self) -> None:
        require_name(self.name, "rig", "name", "give the rig a name")
        if self.kind not in KINDS:
            raise RigError(f'key "kind" is {brief(self.kind)}; give one of {", ".join(KINDS)}')
        object.__setattr__(self, "modules", tuple(self.modules))
        object.__setattr__(self, "home", vector(self.home, "rig", "home"))
        if not self.modules:
            raise RigError('key "modules" is empty; give at least one module')
        d = self.dimension
        if self.up is not None:
            require_up(self.up, d)
        if self.home.size != d:
            raise RigError(f'key "home" has {self.home.size} coordinates; a {self.kind} rig needs {d}')
        if self.home_rotation is not None:
            if not self._kind.has_orientation:
                raise RigError(f'key "home_rotation": a {self.kind} rig cannot turn; leave it out')
            turn = pose.rotation_vector(self.home_rotation, "rig", "home_rotation", d)
            object.__setattr__(self, "home_rotation", turn)
        numbers: dict[str, int] = {}
        for number, module in enumerate(self.modules, start=1):
            here = f'module "{module.name}"'
            if module.name in numbers:
                raise RigError(
                    f'{here}: key "name" is used by modules {numbers[module.name]} and {number}; give each its own'
                )
            numbers[module.name] = number
            module.check_kind(self.kind)
        if self.platform is not None:
            self.platform.check_kind(self.kind)
        self.required.check_rig(self)
        object.__setattr__(self, "rest", tuple(self.rest))
        object.__setattr__(self, "bodies", tuple(self.bodies))
        self._check_bodies_and_frames()

    def _check_bodies_and_frames(self) -> None:
        """Refuse bodies and poses at rest that share a name, have other coordinates, or belong to nothing."""
        names, known = [pose_at_rest.name for pose_at_rest in self.rest], (*self.frames, *self.free_frames)
        for pose_at_rest in self.rest:
            if pose_at_rest.name not in known or names.count(pose_at_rest.name) > 1:
                why = "is there twice" if pose_at_rest.name in known else "carries no module and no body"
                others = f"the frames are {', '.join(known)}" if known else "no module has a frame, leave it out"
                raise RigError(f'frame "{pose_at_rest.name}" {why}; {others}')
            if pose_at_rest.position.size != self.dimension:
                raise RigError(
                    f'frame "{pose_at_rest.name}": key "position" must have {self.dimension} coordinates'
                )
        names = [body.name for body in self.bodies]
        for body in self.bodies:
            if names.count(body.name) > 1:
                raise RigError(f'body "{body.name}": key "name" is used twice; give each body its own')
            if (size := body.start.size) != self.dimension:
                raise RigError(f'body "{body.name}" has {size} coordinates, where the rig has {self.dimension}')
            if body.frame == HAND and HAND in self.frames:
                raise RigError(f'frame "{HAND}" is the held point where bodies are; rename that of the modules')

    def __repr__(self) -> str:
        names = ", ".join(module.name for module in self.modules[:4]) + ", …" * (self.m > 4)
        limits = format_range(self.limits.lower, self.limits.upper)
        return f"<Rig {self.name}: {self.kind}, {format_count(self.m, 'module')} ({names}), {limits} N>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return a table of the modules: positions, limits and hardware."""
        lengths = self.lengths(self.home, frames=self.at_rest)
        rows = [
            [module.name, module.frame if self.frames else None, module.anchor,
             module.attachment if self._kind.has_orientation else None, length, module.lower, module.upper,
             module.brake, module.newton_per_ampere, module.spool_radius, module.pulley_radius, module.pulley_axis,
             module.friction_coulomb, module.friction_viscous, module.cable_stiffness]
            for module, length in zip(self.modules, lengths, strict=True)
        ]  # fmt: skip
        columns = [
            "module", "frame", Column("anchor", "m"), Column("attachment", "m"),
            Column("cable at home", "m", ".3f"), Column("lower", "N"), Column("upper", "N"), Column("brake", "N"),
            Column("N/A", wide=True), Column("spool radius", "m", wide=True), Column("pulley radius", "m"),
            Column("pulley axis", wide=True), Column("dry friction", "N", wide=True),
            Column("viscous friction", "N s/m", wide=True), Column("cable stiffness", "N", wide=True),
        ]  # fmt: skip
        held = "" if self.platform is None else f", platform of {self.platform.mass:g} kg"
        modules = format_count(self.m, "module")
        turned = "" if self.home_rotation is None else f" turned by {format_vector(self.home_rotation)} rad"
        title = f"{self.name}: {self.kind}, {modules}{held}, home {format_vector(self.home)} m{turned}"
        return Table(columns, rows, title, [self.description] if self.description else [])

    @property
    def _kind(self) -> Kind:
        return KINDS[self.kind]

    @property
    def dimension(self) -> int:
        """Dimension d of space: 2 or 3."""
        return self._kind.dimension

    @property
    def has_position(self) -> bool:
        """Whether the platform moves, rather than turning about a fixed point alone."""
        return self._kind.has_position

    @property
    def n(self) -> int:
        """Number of wrench components."""
        return self._kind.dof

    @property
    def m(self) -> int:
        """Number of cables."""
        return len(self.modules)

    @property
    def upward(self) -> Floats:
        """Unit vector that points up, (d,); RigError if the rig does not say which axis is up."""
        if self.up is None:
            raise RigError(f'rig "{self.name}": key "up" is missing; give the axis that points up, as in up = "z"')
        return upward(self.up, self.dimension)

    def gravity(self, rotation: ArrayLike | None = None) -> Floats:
        """Return the wrench of gravity on the platform, (..., n), in N and N·m.

        The rotation is as in `structure_matrix`: the centre of mass turns with the platform. RigError if the mass
        or ``up`` is unknown.
        """
        if self.platform is None:
            raise RigError(f'rig "{self.name}": [platform] is missing; give its mass')
        force = -self.platform.mass * GRAVITY_M_S2 * self.upward
        if not self._kind.has_orientation:
            return force
        arm = np.zeros((1, self.dimension)) if self.platform.com is None else self.platform.com[None]
        turn = self.home_matrix if rotation is None else pose.rotations(rotation, self.dimension, "rotation")
        arm = kinematics.rotate(turn, arm)
        return self._own(kinematics.structure_matrix(np.broadcast_to(force, arm.shape), arm))[..., 0]

    def _own(self, structure: Floats) -> Floats:
        """Return the rows of structure matrices that are components of the rig's wrenches."""
        return structure if self.has_position else structure[..., self.dimension :, :]

    def require_position(self, what: str) -> None:
        """Refuse a spherical rig; ``what`` is what needs one whose platform moves, in the plural."""
        if not self.has_position:
            raise RigError(f'rig "{self.name}" is spherical and turns about its home: {what} need another kind')

    @cached_property
    def home_orientation(self) -> Floats | None:
        """Orientation at home as in `structure_matrix`: a matrix, an angle in the plane, None for a point."""
        if not self._kind.has_orientation:
            return None
        turn = np.zeros(2 * self.dimension - 3) if self.home_rotation is None else self.home_rotation
        return readonly_copy(turn[0] if self.dimension == 2 else kinematics.exponential(turn))

    @cached_property
    def home_matrix(self) -> Floats:
        """Orientation at home as a matrix, (d, d); the identity for a point."""
        home, d = self.home_orientation, self.dimension
        return np.eye(d) if home is None else pose.rotations(home, d, "home_rotation")

    @property
    def weight(self) -> Floats | None:
        """Wrench of gravity on the platform at home, (n,), in N and N·m; None if ``up`` or the mass is unknown."""
        return None if self.up is None or self.platform is None else self.gravity()

    @property
    def characteristic_length(self) -> float:
        """Length in m by which torques are divided to be compared with forces.

        The length of `required`, or else the root mean square distance of the attachments from the reference
        point; 1 m for a point rig, or if all attachments are at the reference point. A characteristic length
        is due to Angeles, "Fundamentals of Robotic Mechanical Systems", 2014; the choice of the mean is ours.
        """
        if self.required.length is not None:
            return self.required.length
        return float(np.sqrt((self.attachments**2).sum(axis=1).mean())) or 1.0

    @property
    def vertical(self) -> str:
        """Vertical axis of pictures: the axis of ``up``, or y if that is unknown."""
        return "y" if self.up is None else self.up[-1]

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Names of the body frames that modules are attached to: their poses must be given."""
        return tuple(dict.fromkeys(module.frame for module in self.modules if module.frame != WORLD))

    @cached_property
    def free_frames(self) -> tuple[str, ...]:
        """Names of the body frames that carry bodies only: at rest unless their poses are given."""
        fixed = (WORLD, HAND, *self.frames)
        return tuple(dict.fromkeys(body.frame for body in self.bodies if body.frame not in fixed))

    @property
    def at_rest(self) -> dict[str, CoordinateFrame]:
        """Default poses of all body frames: those of `rest`, or the origin of the world."""
        names = (*self.frames, *self.free_frames)
        origin = {name: CoordinateFrame(np.zeros(self.dimension)) for name in names}
        return origin | {pose_at_rest.name: pose_at_rest.frame for pose_at_rest in self.rest}

    @cached_property
    def limits(self) -> TensionLimits:
        """Tension limits of all cables."""
        return TensionLimits(
            lower=np.array([module.lower for module in self.modules]),
            upper=np.array([module.upper for module in self.modules]),
        )

    @cached_property
    def anchors(self) -> Floats:
        """Anchors of all modules, (m, d), each in the axes of its own frame, in m. Read-only."""
        return readonly_copy(np.stack([module.anchor for module in self.modules]))

    @cached_property
    def attachments(self) -> Floats:
        """Attachments of all cables, (m, d), in platform axes, in m; zeros for a point rig. Read-only."""
        return readonly_copy(np.stack([np.asarray(module.attachment) for module in self.modules]))

    @cached_property
    def pulleys(self) -> Pulleys | None:
        """Pulleys of all modules, axes each in its own frame; None if there is none. Read-only."""
        if all(module.pulley_radius is None for module in self.modules):
            return None
        nowhere = np.zeros(self.dimension)
        axes = np.stack([nowhere if module.pulley_axis is None else module.pulley_axis for module in self.modules])
        lengths = np.linalg.norm(axes, axis=1, keepdims=True)
        radii = np.array([module.pulley_radius or 0.0 for module in self.modules])
        return Pulleys(readonly_copy(radii), readonly_copy(axes / np.where(lengths > 0.0, lengths, 1.0)))

    def pulleys_in_world(self, frames: Frames | None = None) -> Pulleys | None:
        """Return the pulleys of all modules with axes in the world; ``frames`` as in `structure_matrix`."""
        own = self.pulleys
        return None if own is None else Pulleys(own.radii, pose.place_axes(self.modules, own.axes, frames))

    def cables(
        self, position: ArrayLike, rotation: ArrayLike | None = None, frames: Frames | None = None
    ) -> Cables:
        """Return lengths, directions and arms of the cables at a pose; see `structure_matrix`."""
        p, R, anchors = self._pose(position, rotation, frames)
        arms = None if R is None else kinematics.rotate(R, self.attachments)
        pulleys = self.pulleys_in_world(frames)
        if pulleys is None:
            lengths, directions = kinematics.cables(anchors, p, arms)
            straight = lengths
        else:
            lengths, directions, straight = route_cables(kinematics.to_anchors(anchors, p, arms), pulleys)
        if not straight.all():
            *where, index = (int(i) for i in np.argwhere(straight == 0.0)[0])
            at = f" at pose {where}" if where else ""
            lies = "on the anchor" if self.modules[index].pulley_radius is None else "in its pulley"
            raise RigError(
                f'rig "{self.name}": module "{self.modules[index].name}" (index {index}): the attachment '
                f"lies {lies}{at}, so its cable has no direction; move the pose or the anchor"
            )
        return Cables(lengths, directions, arms, straight)

    def lengths(
        self, position: ArrayLike, rotation: ArrayLike | None = None, frames: Frames | None = None
    ) -> Floats:
        """Return the length of each cable from its anchor, (..., m), in m.

        Parameters and errors as in `structure_matrix`.
        """
        return self.cables(position, rotation, frames).lengths

    def structure_matrix(
        self, position: ArrayLike, rotation: ArrayLike | None = None, frames: Frames | None = None
    ) -> Floats:
        """Return the structure matrix at a pose.

        Leading axes of all arguments broadcast. Source: Verhoeven 2004; see `tensionlab.model.kinematics`.

        Parameters
        ----------
        position : (..., d) array
            Position of the reference point in the world, in m; of a spherical rig always its home.
        rotation : (..., 3, 3) array, (...) array or None
            Rotation from platform to world: matrices for a platform rig, angles in rad for a planar one. None is
            the orientation at home. A point rig has no rotation.
        frames : mapping of name to `CoordinateFrame` or (position, rotation), optional
            Poses of the body frames in `Rig.frames`, and of `Rig.free_frames` that are not at rest.

        Returns
        -------
        (..., n, m) array
            W with the columns ``[u; r x u]``, of a spherical rig ``r x u``: ``W @ tensions`` is the wrench on the
            platform, at its reference point and in world axes, and ``-W.T`` is the derivative of the lengths with
            respect to the twist.

        Raises
        ------
        ShapeError
            If a shape is wrong, an entry is NaN or infinite, a matrix is not a rotation, or a point rig is given
            a rotation.
        RigError
            If a body frame is missing or unknown, or an attachment lies on its anchor.
        """
        cables = self.cables(position, rotation, frames)
        return self._own(kinematics.structure_matrix(cables.directions, cables.arms))

    def allocate(
        self,
        wrench: ArrayLike,
        position: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        frames: Frames | None = None,
        *,
        solver: str | Solver = "newton",
        reference: ArrayLike | Literal["lower", "middle"] | None = None,
        policy: Policy | None = None,
        wrench_weights: ArrayLike | None = None,
    ) -> Allocation:
        """Return tensions that render a wrench at a pose in addition to the rig's required wrench.

        The cables render the sum of ``wrench`` and the middle of `required`, such as the weight of the platform.

        Parameters
        ----------
        wrench : (..., n) array
            Desired, in N and N·m. All leading axes broadcast.
        position, rotation, frames
            Pose, as in `structure_matrix`; home and the frames at rest if left out.
        solver, reference, policy, wrench_weights
            As in `tensionlab.allocate`, whose errors are raised as well.

        Returns
        -------
        Allocation
            With the names of the modules, the desired wrench (with what is required) and the position.

        Examples
        --------
        >>> import tensionlab as tl
        >>> rig = tl.load_rig("bartels2026-validation")
        >>> rig.allocate([1.0, 0.5, 1.0]).tensions.round(3)
        array([2.278, 1.801, 0.5  , 2.611])
        """
        from tensionlab.allocation import allocate

        place = pose.points(self.home if position is None else position, self.dimension, "position")
        W = self.structure_matrix(place, rotation, self.at_rest if frames is None else frames)
        desired = pose.points(wrench, self.n, "wrench") + self.required.middle(self, rotation)
        allocation = allocate(W, desired, self.limits, solver, reference, policy, wrench_weights)
        names = tuple(module.name for module in self.modules)
        return replace(allocation, modules=names, desired=desired, position=place)

    def forward_kinematics(
        self,
        lengths: ArrayLike,
        position: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        frames: Frames | None = None,
    ) -> PoseEstimate:
        """Estimate the pose of the platform from cable lengths.

        Returns the pose near the guess that fits the lengths best in the least-squares sense. Several poses can
        have the same lengths: anchors in one plane leave a mirror image behind that plane, and a platform can
        flip. The guess decides between them, so start on the right side of the plane, off it. Check the residual.

        Parameters
        ----------
        lengths : (..., m) array
            Measured, in m.
        position, rotation : arrays, optional
            The guess; the pose at home if left out. Errors as in `structure_matrix`; and with fewer cables than
            unknowns, or a length of zero or less.
        """
        self.require_position("forward kinematics")
        if self.m < self.n:
            raise RigError(f'rig "{self.name}": {self.m} cable lengths cannot fix {self.n} unknowns; add modules')
        measured = pose.points(lengths, self.m, "lengths")
        if (measured <= 0).any():
            raise ShapeError(f"lengths{pose.first(measured <= 0)} is not positive; give cable lengths in m")
        guess, turn, anchors = self._pose(self.home if position is None else position, rotation, frames)
        return kinematics.estimate_pose(
            anchors,
            None if turn is None else self.attachments,
            measured,
            guess,
            turn,
            self.pulleys_in_world(frames),
        )

    def _pose(
        self, position: ArrayLike, rotation: ArrayLike | None, frames: Frames | None
    ) -> tuple[Floats, Floats | None, Floats]:
        """Return the position, the rotation matrix (None for a point) and the anchors in the world."""
        p = pose.points(position, self.dimension, "position")
        if not (self.has_position or np.array_equal(p, np.broadcast_to(self.home, p.shape))):
            raise ShapeError(f'rig "{self.name}" is spherical and turns about its home; give that as position')
        if rotation is not None and not self._kind.has_orientation:
            raise ShapeError(f'rig "{self.name}" is a {self.kind} rig and cannot turn; leave rotation out')
        R = None if not self._kind.has_orientation else self.home_matrix
        R = R if rotation is None else pose.rotations(rotation, self.dimension, "rotation")
        anchors = self.anchors
        if frames or self.frames:
            pose.require_known(frames or (), (*self.frames, *self.free_frames))
            anchors = pose.place_anchors(self.modules, anchors, frames)
        shapes = {"position": p.shape[:-1], "frames": anchors.shape[:-2]}
        common_axes(shapes if R is None else {**shapes, "rotation": R.shape[:-2]})
        return p, R, anchors
