"""Trajectories of a platform, and the wrenches that move it along them.

A trajectory has samples: times, poses, and the platform's velocities and accelerations there, in world axes. Those
that are not given are the derivatives of cubic splines through the poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import DataError, InputError, RigError, ShapeError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import GRAVITY_M_S2, MAX_MASS, Platform
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, pad_last_axis, require_finite
from tensionlab.support.files.reading import as_path, brief, read_toml
from tensionlab.support.files.tables import read_columns
from tensionlab.support.formatting import format_count
from tensionlab.workspace.poses import ROTATION_COLUMNS, PoseList, poses_from_columns, wrench_columns

Timing = Literal["quintic", "trapezoidal"]
MAX_SAMPLES = 1_000_000  # more are taken for a mistaken step


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Motion of a platform, sampled at K times. ShapeError names an array that does not fit.

    Attributes
    ----------
    times : (K,) array
        Times of the samples, in s, ascending; two at least.
    position : (K, d) array
        Positions of the reference point, in m.
    rotation : (K, 3, 3) array, (K,) array or None
        Orientations, as in `Rig.structure_matrix`; None for a platform that does not turn.
    velocity : (K, d) or (K, n) array
        Velocity of the reference point, in m/s, and with orientations the angular velocity, in rad/s.
    acceleration : (K, d) or (K, n) array
        The derivative of the velocity, in m/s² and rad/s².
    wrench : (K, d) or (K, n) array or None
        Wrench that the cables exert in addition to moving the platform, in N and N·m.

    Examples
    --------
    >>> import tensionlab as tl
    >>> lift = tl.Trajectory.through([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]], times=[0.0, 2.0])
    >>> lift
    <Trajectory of 201 samples: 2 s, at most 0.938 m/s and 1.44 m/s²>
    >>> lift.position[50].round(3)
    array([0.   , 0.   , 1.104])
    """

    times: Floats
    position: Floats
    rotation: Floats | None = None
    velocity: Floats = None  # type: ignore[assignment]  # becomes an array
    acceleration: Floats = None  # type: ignore[assignment]
    wrench: Floats | None = None

    def __post_init__(self) -> None:
        times = require_finite("times", self.times, 1)
        if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0.0).all():
            raise ShapeError(f"times {brief(times.tolist())}: give two or more in s, ascending")
        poses = PoseList(self.position, self.rotation, self.wrench)
        if len(poses.position) != len(times):
            raise ShapeError(f"{len(poses.position)} positions for {len(times)} times; give as many")
        derived: dict[str, Floats] = {}
        if self.velocity is None or self.acceleration is None:
            derived = _derivatives(times, poses)
        shape = (len(times), poses.dimension if poses.rotation is None else 3 * (poses.dimension - 1))
        for name in ("velocity", "acceleration"):
            values = require_finite(name, derived[name] if getattr(self, name) is None else getattr(self, name), 2)
            if values.shape != shape:
                raise ShapeError(f"{name} has shape {values.shape}; give {shape}")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "times", times)
        for name in ("position", "rotation", "wrench"):
            object.__setattr__(self, name, getattr(poses, name))

    @classmethod
    def through(
        cls,
        position: ArrayLike,
        times: ArrayLike,
        rotation: ArrayLike | None = None,
        timing: Timing = "quintic",
        step: float = 0.01,
    ) -> Trajectory:
        """Return a trajectory that goes straight from point to point and rests at each of them.

        Parameters
        ----------
        position : (P, d) array
            The points, in m.
        times : (P,) array
            Times at the points, in s, ascending.
        rotation : (P, 3, 3) or (P,) array, optional
            Its orientations there, as in `Rig.structure_matrix`; between them it turns about a fixed axis.
        timing : {"quintic", "trapezoidal"}
            Quintic: without jumps of the acceleration. Trapezoidal: acceleration, constant speed and deceleration,
            a third of the time each.
        step : float
            Time between samples, in s; shortened to divide each segment evenly.

        Raises
        ------
        InputError, ShapeError
            If the timing is unknown, the step does not fit, or the points do not.
        """
        points = cls(require_finite("times", times, 1), np.asarray(position), rotation)  # type: ignore[arg-type]
        if timing not in ("quintic", "trapezoidal"):
            raise InputError(f'timing is {brief(timing)}; give "quintic" or "trapezoidal"')
        spans = np.diff(points.times)
        if not step > 0.0 or points.times[-1] - points.times[0] > step * MAX_SAMPLES:
            raise InputError(f"step is {step}; give a time in s above zero, for at most {MAX_SAMPLES:,} samples")
        counts = np.ceil(spans / step - 1e-9).astype(int)
        part = np.append(np.repeat(np.arange(len(counts)), counts), len(counts) - 1)
        share = np.append(np.concatenate([np.arange(count) / count for count in counts]), 1.0)
        way, rate, change = _time_law(timing, share)
        rate, change = rate / spans[part], change / spans[part] ** 2
        turns = turns_between(points.poses)
        steps = np.hstack([np.diff(points.position, axis=0), turns])[part]
        rotations = points.rotation
        if rotations is not None:
            rotations = turn_by(rotations[part], way[:, None] * turns[part])
        return cls(
            times=points.times[part] + share * spans[part],
            position=points.position[part] + way[:, None] * steps[:, : points.poses.dimension],
            rotation=rotations,
            velocity=rate[:, None] * steps,
            acceleration=change[:, None] * steps,
        )

    def __repr__(self) -> str:
        speed, acceleration = (
            float(np.linalg.norm(derivative[:, : self.poses.dimension], axis=1).max())
            for derivative in (self.velocity, self.acceleration)
        )
        motion = f"at most {speed:.3g} m/s and {acceleration:.3g} m/s²"
        return f"<Trajectory of {format_count(len(self.times), 'sample')}: {np.ptp(self.times):g} s, {motion}>"

    @property
    def poses(self) -> PoseList:
        """Poses of the samples, as `tensionlab.sweep` takes them."""
        return PoseList(self.position, self.rotation)

    def check_rig(self, rig: Rig) -> None:
        """Refuse a rig of another dimension, or that cannot turn as the trajectory does."""
        rig.require_position("trajectories")
        d = self.poses.dimension
        if d != rig.dimension:
            raise ShapeError(f"the trajectory has {d} coordinates; {rig.name} needs {rig.dimension}")
        if self.rotation is not None and rig.n == d:
            raise ShapeError(f"the trajectory turns; {rig.name} is a {rig.kind} rig and cannot")
        if self.wrench is not None and self.wrench.shape[1] > rig.n:
            raise ShapeError(f"the trajectory has torques; {rig.name} is a {rig.kind} rig and exerts none")

    def twist(self, rig: Rig) -> Floats:
        """Return velocity and angular velocity of a rig's platform, (K, n), in m/s and rad/s."""
        return pad_last_axis(self.velocity, rig.n)


def read_trajectory(path: str | PathLike[str]) -> Trajectory:
    r"""Return the trajectory in a file.

    A table (.csv, .parquet) has the columns t in s and x, y and z in m, in the plane x and y, of each sample. It
    may have the orientation, as rx, ry, rz, the axis times the angle in rad, in the plane as angle in rad; and a
    wrench that the cables exert in addition to moving the platform, as Fx, Fy, Fz in N and Mx, My, Mz in N·m, in
    the plane Fx, Fy and Mz. A program (.toml) has the arguments of `Trajectory.through`: a list of ``[[points]]``,
    each with ``time_s``, ``position`` and perhaps ``rotation``, axis times angle, in the plane an angle; and
    ``timing`` and ``step_s``. DataError names the file and what is wrong in it.

    Examples
    --------
    >>> from pathlib import Path
    >>> import tensionlab as tl
    >>> points = "{time_s = 0.0, position = [0.0, 0.5]}, {time_s = 1.0, position = [0.3, 0.5]}"
    >>> _ = Path("path.toml").write_text(f'timing = "trapezoidal"\npoints = [{points}]\n')
    >>> tl.read_trajectory("path.toml")
    <Trajectory of 101 samples: 1 s, at most 0.45 m/s and 1.35 m/s²>
    """
    toml = as_path(path).suffix.lower() == ".toml"
    if toml:
        document = read_toml(path, "a trajectory (*.toml)", DataError)
    else:
        names = ["z", *ROTATION_COLUMNS, "angle", *wrench_columns(3, 6)]
        document = read_columns(path, ["t", "x", "y"], names, DataError, "a trajectory")
    try:
        if toml:
            return _through_points(document)
        times, poses = document.pop("t"), poses_from_columns(document)
        return Trajectory(times, poses.position, poses.rotation, wrench=poses.wrench)
    except (DataError, ShapeError, InputError) as error:
        raise DataError(f"{path}: {error}") from None


def _through_points(document: dict[str, Any]) -> Trajectory:
    """Return the trajectory of a program."""
    from tensionlab.model.schema import TrajectoryFile
    from tensionlab.support.validation import validate

    file = validate(TrajectoryFile, document, DataError)
    position = [point.position for point in file.points]
    turns = [point.rotation for point in file.points if point.rotation is not None]
    if len({len(row) for row in position}) > 1 or len({len(row) for row in turns}) > 1:
        raise DataError("the points have different numbers of coordinates; give each two, or each three")
    if turns and (len(turns) < len(position) or len(turns[0]) != (1 if len(position[0]) == 2 else 3)):
        raise DataError('key "rotation": give each point three numbers, in the plane one, or none to any point')
    rotation = np.array(turns, dtype=np.float64) if turns else None
    if rotation is not None:
        rotation = rotation[:, 0] if len(rotation[0]) == 1 else kinematics.exponential(rotation)
    times = [point.time_s for point in file.points]
    return Trajectory.through(position, times, rotation, file.timing, file.step_s)


def inverse_dynamics(rig: Rig, trajectory: Trajectory, payload: float = 0.0) -> Floats:
    """Return the wrenches (K, n), in N and N·m, that the cables exert to move the platform along a trajectory.

    They are at the reference point and in world axes: what accelerates the platform, by the equations of Newton
    and Euler with its mass, centre of mass and inertia, and the payload; the middle of what the rig requires; and
    the trajectory's own wrenches. Weights count where the rig requires them, ``[required] gravity = true``. Cables
    and winches have no inertia. `tensionlab.allocate` and `tensionlab.compare` take the wrenches as they are.

    Parameters
    ----------
    rig : Rig
    trajectory : Trajectory
    payload : float
        Mass that the platform carries at its reference point, in kg.

    Raises
    ------
    RigError
        If the rig has no ``[platform]`` and no other wrenches are given, or no inertia though it turns.
    ShapeError, InputError
        If the trajectory does not suit the rig, or the payload is negative.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("cogiro")
    >>> lift = tl.Trajectory.through([rig.home, rig.home + [0.0, 0.0, 1.0]], times=[0.0, 2.0])
    >>> wrenches = tl.inverse_dynamics(rig, lift)
    >>> tl.allocate(rig.structure_matrix(lift.position), wrenches, rig.limits).exact.all()
    np.True_
    """
    trajectory.check_rig(rig)
    if not 0.0 <= payload <= MAX_MASS:
        raise InputError(f"payload is {payload}; give a mass in kg, 0 or more")
    if rig.platform is None and not payload and trajectory.wrench is None:
        raise RigError(f'rig "{rig.name}": [platform] is missing; give its mass, or wrenches')
    d, count = rig.dimension, len(trajectory.times)
    wrench = np.broadcast_to(rig.required.middle(rig, trajectory.rotation), (count, rig.n)).copy()
    if trajectory.wrench is not None:
        wrench += pad_last_axis(trajectory.wrench, rig.n)
    acceleration = trajectory.acceleration[:, :d]
    wrench[:, :d] += payload * acceleration
    if rig.required.gravity and payload:
        wrench[:, :d] += payload * GRAVITY_M_S2 * rig.upward
    if rig.platform is not None:
        moving = _newton_euler(rig.platform, trajectory)
        wrench += moving[:, [*range(d), *((5,) if d == 2 else (3, 4, 5))][: rig.n]]
    return wrench


def _newton_euler(platform: Platform, trajectory: Trajectory) -> Floats:
    """Return the force and the torque at the reference point that accelerate a platform, (K, 6), in space."""
    d = trajectory.poses.dimension
    linear = kinematics.in_space(trajectory.acceleration[:, :d])
    angular, change = (
        np.pad(derivative[:, d:], ((0, 0), (3 + d - derivative.shape[1], 0)))  # in the plane about z alone
        for derivative in (trajectory.velocity, trajectory.acceleration)
    )
    rotation = np.eye(3)
    if trajectory.rotation is not None:
        rotation = np.zeros((len(linear), 3, 3))
        rotation[:, 2, 2] = 1.0
        rotation[:, :d, :d] = pose.rotations(trajectory.rotation, d, "rotation")
    arm = np.zeros(3) if platform.com is None else rotation @ kinematics.in_space(platform.com)
    force = platform.mass * (linear + np.cross(change, arm) + np.cross(angular, np.cross(angular, arm)))
    torque = np.cross(arm, force)
    if angular.any() or change.any():
        if platform.inertia is None:
            raise RigError('[platform]: key "inertia" is missing; give it in kg·m², since the trajectory turns')
        own = np.zeros((3, 3))
        own[3 - len(platform.inertia) :, 3 - len(platform.inertia) :] = platform.inertia
        own = rotation @ own @ np.swapaxes(rotation, -1, -2)
        momentum = (own @ angular[..., None])[..., 0]
        torque = torque + (own @ change[..., None])[..., 0] + np.cross(angular, momentum)
    return np.hstack([force, np.broadcast_to(torque, force.shape)])


def _time_law(timing: Timing, share: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the share of the way at a share of the time, and its first and second derivatives."""
    s = share
    if timing == "quintic":
        return 10 * s**3 - 15 * s**4 + 6 * s**5, 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
    change = 4.5 * (np.where(s < 1 / 3, 1.0, 0.0) - np.where(s >= 2 / 3, 1.0, 0.0))
    rate = 4.5 * np.minimum(np.minimum(s, 1 / 3), 1 - s)
    way = np.where(s < 1 / 3, 2.25 * s**2, np.where(s < 2 / 3, 1.5 * s - 0.25, 1 - 2.25 * (1 - s) ** 2))
    return way, rate, change


def turns_between(poses: PoseList) -> Floats:
    """Return the rotation from each pose to the next, axis times angle, (P - 1, 3); (P - 1, 1) in the plane."""
    if poses.rotation is None:
        return np.zeros((len(poses.position) - 1, 0))
    if poses.dimension == 2:
        return np.diff(poses.rotation)[:, None]
    from scipy.spatial.transform import Rotation

    turned = poses.rotation[1:] @ np.swapaxes(poses.rotation[:-1], -1, -2)
    return np.asarray(Rotation.from_matrix(turned).as_rotvec())


def turn_by(rotation: Floats, turns: Floats) -> Floats:
    """Return orientations (K, 3, 3), or angles (K,) in the plane, turned by rows as of `turns_between`."""
    return rotation + turns[:, 0] if rotation.ndim == 1 else kinematics.exponential(turns) @ rotation


def _derivatives(times: Floats, poses: PoseList) -> dict[str, Floats]:
    """Return velocity and acceleration of splines through poses, (K, d) or (K, n), in world axes."""
    from scipy.interpolate import CubicSpline

    position, rotation = poses.arrays()
    if rotation is not None and poses.dimension == 2:
        position, rotation = np.column_stack([position, rotation]), None
    spline = CubicSpline(times, position)
    velocity, acceleration = spline(times, 1), spline(times, 2)
    if rotation is not None:
        from scipy.spatial.transform import Rotation, RotationSpline

        turning = RotationSpline(times, Rotation.from_matrix(rotation))  # its rates are in axes of the platform
        rates, changes = rotation @ turning(times, 1)[..., None], rotation @ turning(times, 2)[..., None]
        velocity = np.hstack([velocity, rates[..., 0]])
        acceleration = np.hstack([acceleration, changes[..., 0]])
    return {"velocity": velocity, "acceleration": acceleration}
