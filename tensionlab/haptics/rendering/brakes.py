"""One-way brakes: which to lock so that a wall holds more than the motors can and the hand can leave it, and when.

The user pushes with F newtons against the normal n of a wall. A locked one-way brake holds its cable up to its own
strength. `choose_locks` tries every small set L of cables that may be locked, at the cost of the unresisted force
plus a share of F per lock.

- A cable is locked only if it pulls the hand out of the wall, ``u_i·n > margin``. Then every locked cable reels in
  when the hand withdraws along n, so no set can trap it; a non-negative least squares alone does not ensure that.
- For each L, the tensions nearest to the desired force are a bounded least squares by the exact solver of
  `tensionlab.solvers`, with the brakes' strength as upper limit in L. The motors pull as much of it as they can.
- The force of a brake exists only while the user pushes. It is reported apart from the motors' tensions.

If the motors alone render the force, nothing is locked. A `brake_map` is the choice for many walls.

A brake takes time to lock and its teeth leave slack, so it is locked before the wall is reached; the faster the
approach, the earlier. A fast body is not stopped at all: the force on it would be too large. Brakes stay locked
until the hand has withdrawn by some millimetres, so that a hand at rest does not make them chatter. The rule and
its numbers are this project's own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tensionlab import _native
from tensionlab.allocation import RANK_TOLERANCE, TOLERANCE
from tensionlab.errors import InputError, ShapeError
from tensionlab.haptics.effects.parameters import Number, checked_dataclass
from tensionlab.model import pose
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, as_floats, common_axes, flatten_batch, require_finite

Flags = NDArray[np.bool_]


@checked_dataclass(InputError)
class LockRule:
    """Rule by which sets of brakes are compared."""

    margin: Annotated[Number, Field(gt=0.0, lt=1.0)] = 0.02
    """Smallest ``u·n`` of a cable to lock, above 0 so that no brake traps; a locked one stays locked down to 0."""
    max_locked: Annotated[int, Field(ge=0, le=3)] = 3
    """Largest number of locked cables; three of its cables render any force of a cone."""
    price: Annotated[Number, Field(ge=0.0)] = 0.02
    """Price of each lock, as a share of the desired force."""
    hysteresis: Annotated[Number, Field(ge=0.0)] = 0.05
    """Advantage of another set over the locked one, as a share of the desired force, before it takes its place."""


LOCK_RULE = LockRule()
CONVINCING_ANGLE = np.pi / 4  # largest error of a convincing direction, in rad


class LockSet(NamedTuple):
    """Brakes to lock, and the tensions against a push with the desired force."""

    locked: Flags  # brakes to lock, (..., m)
    motors: Floats  # tensions of the motors, inside their limits, in N, (..., m)
    brakes: Floats  # further tension by each brake, in N, (..., m); 0 if not locked
    unresisted: Floats  # norm of the missing force, in N, (...)
    available: Flags  # brakes that may be locked for this wall, (..., m)


def brake_strengths(rig: Rig) -> Floats:
    """Return the strength of each module's brake in N, (m,); 0 without one."""
    return np.array([module.brake or 0.0 for module in rig.modules])


def choose_locks(
    structure: ArrayLike,
    normal: ArrayLike,
    force: ArrayLike,
    limits: TensionLimits,
    strengths: ArrayLike,
    pushing: ArrayLike = True,
    held: ArrayLike | None = None,
    stiffness_ratio: ArrayLike | None = None,
    rule: LockRule = LOCK_RULE,
) -> LockSet:
    """Return the brakes to lock to hold a push against a wall, and the tensions of the motors.

    Leading axes of all arrays broadcast. `ShapeError` names an array whose shape does not fit, and refuses numbers
    that are not finite, normals that are not of unit length, and negative forces or strengths.

    Parameters
    ----------
    structure : (..., d, m) array
        Structure matrices of a point: unit vectors towards the anchors.
    normal, force : (..., d), (...) arrays
        Unit normals of the walls, towards the free side, and the forces that they should hold, in N.
    limits, strengths : TensionLimits, (m,) array
        Of the motors; largest load of each brake, in N: its strength or a lower cap for safety; 0 for none.
    pushing : (...) array of bool
        Whether the hand moves into the wall or is held by it; otherwise no further brake is locked.
    held : (..., m) array of bool, optional
        Brakes that are locked now.
    stiffness_ratio : (...) array, optional
        Largest stiffness of a locked set, as a multiple of one cable's; below 1 refuses all: see `ImpactCap`.
    """
    m = limits.lower.size
    U, n, F, holds = _checked(structure, normal, force, strengths, m)
    push = np.asarray(pushing, np.bool_)
    now = np.zeros(m, np.bool_) if held is None else np.asarray(held, np.bool_)
    stiff = as_floats("stiffness_ratio", math.inf if stiffness_ratio is None else stiffness_ratio)
    if now.shape[-1:] != (m,):
        raise ShapeError(f"held has shape {now.shape}; give one bool for each of {m} cables")
    shape = common_axes(
        {
            "structure": U.shape[:-2],
            "normal": n.shape[:-1],
            "force": F.shape,
            "pushing": push.shape,
            "held": now.shape[:-1],
            "stiffness_ratio": stiff.shape,
        }
    )
    locked, tensions, unresisted, available = _native.choose_locks(
        flatten_batch(U, shape, 2),
        flatten_batch(n, shape, 1),
        flatten_batch(F, shape, 0),
        flatten_batch(push, shape, 0),
        flatten_batch(now, shape, 1),
        flatten_batch(stiff, shape, 0),
        np.stack([limits.lower, limits.upper, np.maximum(limits.upper, holds)]),
        holds > 0.0,
        rule.margin,
        rule.max_locked,
        rule.price,
        rule.hysteresis,
        TOLERANCE,
        RANK_TOLERANCE,
    )
    motors = np.minimum(tensions, limits.upper)

    def whole(found: NDArray[Any]) -> NDArray[Any]:
        return found.reshape((*shape, m))

    brakes = tensions - motors
    return LockSet(whole(locked), whole(motors), whole(brakes), unresisted.reshape(shape), whole(available))


def _checked(
    structure: ArrayLike, normal: ArrayLike, force: ArrayLike, strengths: ArrayLike, m: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return structure matrices, unit normals, forces and strengths as arrays of fitting shapes."""
    U, n = require_finite("structure", structure, 0), require_finite("normal", normal, 0)
    if U.shape[-2:] not in ((2, m), (3, m)) or n.shape[-1:] != U.shape[-2:-1]:
        problem = f"structure {U.shape}, normal {n.shape} and limits of {m} cables do not fit"
        raise ShapeError(f"{problem}; give (..., d, m), (..., d) and m, with d = 2 or 3 for a point")
    F, holds = require_finite("force", force, 0), pose.points(strengths, m, "strengths")
    if F.min(initial=0.0) < 0.0 or holds.min(initial=0.0) < 0.0:
        raise ShapeError("force and strengths must be 0 N or more; reverse the normal for a force the other way")
    if np.abs(np.einsum("...i,...i->...", n, n) - 1.0).max(initial=0.0) > 2e-6:
        raise ShapeError("normal is not a unit vector; divide it by its length")
    return U, n, F, holds


class BrakeMap(NamedTuple):
    """Resistance to a push with a force in N against many walls with unit normals (k, d), towards the free side.

    The lock sets have leading axes (..., k); ``angles`` (..., k) are between the normal and the resisting force,
    in rad; pi where no force resists.
    """

    normals: Floats
    force: float
    chosen: LockSet
    angles: Floats

    def share(self, within: float = CONVINCING_ANGLE) -> Floats:
        """Return the share (...) of walls whose resisting force is within an angle of the normal, in rad."""
        return np.asarray((self.angles <= within).mean(axis=-1))


def brake_map(
    structure: ArrayLike,
    normals: ArrayLike,
    force: float,
    limits: TensionLimits,
    strengths: ArrayLike,
) -> BrakeMap:
    """Return how motors and brakes resist a push against walls with unit normals (k, d).

    The force is in N, above 0; other arguments and errors are as in `choose_locks`. Strengths of 0 make a map of
    the motors alone.
    """
    U, n = require_finite("structure", structure, 0), require_finite("normals", normals, 0)
    if not force > 0.0 or U.ndim < 2 or n.ndim != 2:
        given = f"force is {force}, structure has shape {U.shape} and normals {n.shape}"
        raise ShapeError(f"{given}; give a force above 0 N, (..., d, m) and (k, d)")
    chosen = choose_locks(U[..., None, :, :], n, force, limits, strengths)
    met = np.einsum("...im,...km->...ki", U, chosen.motors + chosen.brakes)
    along = np.einsum("...ki,ki->...k", met, n)
    across = np.linalg.norm(met - along[..., None] * n, axis=-1)
    angles = np.where((along == 0.0) & (across == 0.0), np.pi, np.arctan2(across, along))
    return BrakeMap(n, float(force), chosen, angles)


# Reasons: brakes are locked; the motors suffice, or no set of brakes is worth its price; no brake may be locked
# for this wall; the impact would exceed the cap; the wall is not near yet; the hand does not move into it.
Reason = Literal["locked", "motors", "no cable", "too fast", "not near", "leaving"]


@checked_dataclass(InputError)
class Timing:
    """Times and distances at which brakes lock and are released."""

    latency: Annotated[Number, Field(ge=0.0)] = 0.080
    """Time from the decision to a locked brake, in s."""
    slack: Annotated[Number, Field(ge=0.0)] = 0.003
    """Cable that pays out before the pawl meets a tooth, in m."""
    release: Annotated[Number, Field(ge=0.0)] = 0.005
    """Withdrawal along the normal, from where the hand was held, at which brakes are released, in m."""

    def near(self, distance: ArrayLike, approach: ArrayLike) -> Flags:
        """Return whether brakes must be locked now, so that they hold at the wall.

        The distance to the wall is in m, below zero inside it; the approach ``-n·v`` in m/s.
        """
        return np.asarray(np.asarray(distance) <= np.maximum(0.0, approach) * self.latency + self.slack)


TIMING = Timing()


@checked_dataclass(InputError)
class ImpactCap:
    """Cap on the force with which a body is stopped.

    A body of mass m, stopped by a cable of stiffness k, meets at most ``v sqrt(k m)``. That is the impact only: a
    body that keeps pushing is held with the whole strength of the brakes, which no sensor measures. So breakaway
    links below the cap are part of it: without them, 23 of 1,000 random heads met more. A scenario refuses a rig
    whose motors and brakes could together pull harder than its cap.
    """

    force: Annotated[Number, Field(gt=0.0)] = 60.0
    """Force at which links should break away, in N."""
    stiffness: Annotated[Number, Field(gt=0.0)] = 5000.0
    """Stiffness of a locked cable with its ends, in N/m."""
    mass: Annotated[Number, Field(gt=0.0)] = 5.0
    """Mass of the body, in kg."""

    def peak(self, speed: ArrayLike, stiffness_ratio: ArrayLike = 1.0) -> Floats:
        """Return the impact in N, for cables together ``stiffness_ratio`` times as stiff as one."""
        return np.asarray(speed, dtype=np.float64) * np.sqrt(
            self.stiffness * self.mass * np.asarray(stiffness_ratio)
        )

    def stiffness_ratio(self, speed: ArrayLike) -> Floats:
        """Return the largest stiffness of all locked cables, as a multiple of one cable's, at a speed in m/s.

        Below 1, above the speed ``force / sqrt(stiffness mass)`` of 0.38 m/s, no cable may be locked. The
        stiffness of a set is at most the largest eigenvalue of ``U_L U_L'``, for which `choose_locks` has a bound.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(self.force**2 / (np.square(speed) * self.stiffness * self.mass))


class BrakeWall(NamedTuple):
    """Wall: unit normal (d,) towards the free side, distance in m, below zero inside, and force to hold in N."""

    normal: ArrayLike
    distance: float
    force: float


@dataclass(frozen=True, eq=False)
class BrakeContact:
    """Brakes (m,) that hold a hand, and its deepest position (d,) in the wall, in m."""

    locked: Flags
    position: Floats


@dataclass(frozen=True, eq=False)
class Decision:
    """Brakes (m,) to lock in this cycle (others are released), the reason, and the contact for the next cycle.

    The motors' tensions (m,) in N are those of the chosen lock set inside the wall, and the lower limits before.
    """

    locked: Flags
    motors: Floats
    reason: Reason
    chosen: LockSet
    contact: BrakeContact | None


def decide(
    structure: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    wall: BrakeWall,
    limits: TensionLimits,
    strengths: ArrayLike,
    contact: BrakeContact | None = None,
    timing: Timing = TIMING,
    cap: ImpactCap | None = None,
) -> Decision:
    """Return the brakes to lock in this cycle, and why.

    The structure matrix (d, m), position and velocity (d,) in m and m/s are those of a point, relative to the
    user's body if anchors move with it. Limits are those of the motors, strengths as in `choose_locks`, the
    contact that of the previous decision. A cap, for the safety of a body, also limits the load of each brake.
    Raise `ShapeError` as `choose_locks` does.
    """
    n = require_finite("normal", wall.normal, 0)
    p, v = pose.points(position, n.size, "position"), pose.points(velocity, n.size, "velocity")
    hold = pose.points(strengths, limits.lower.size, "strengths")
    approach = -float(n @ v)
    if contact is not None and n @ (p - contact.position) > timing.release:
        contact = None
    near = bool(timing.near(wall.distance, approach))
    stiffness_ratio = None
    if cap is not None:
        hold = np.minimum(hold, cap.force)
        # A cable stops what moves along it, not along the normal.
        stiffness_ratio = cap.stiffness_ratio(np.linalg.norm(v))
    chosen = choose_locks(
        structure,
        n,
        wall.force,
        limits,
        hold,
        pushing=near and approach >= 0.0,
        held=None if contact is None else contact.locked,
        stiffness_ratio=stiffness_ratio,
    )
    reason: Reason
    if chosen.locked.any():
        reason = "locked"
        deepest = p if contact is None or n @ (p - contact.position) < 0.0 else contact.position
        contact = BrakeContact(chosen.locked, deepest)
    else:
        contact = None
        if not near:
            reason = "not near"
        elif approach < 0.0:
            reason = "leaving"
        elif chosen.unresisted <= TOLERANCE:
            reason = "motors"
        elif not chosen.available.any():
            reason = "no cable"
        elif stiffness_ratio is not None and stiffness_ratio < 1.0:
            reason = "too fast"
        else:
            reason = "motors"
    motors = chosen.motors if wall.distance <= 0.0 else limits.lower
    return Decision(chosen.locked, motors, reason, chosen, contact)
