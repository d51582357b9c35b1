"""Contact of a hand or a head with a wall over time: when to lock and when to release brakes.

A brake takes time to lock and its teeth leave slack, so it is locked before the wall is reached; the faster the
approach, the earlier. A fast body is not stopped at all: the force on it would be too large. Brakes stay locked
until the hand has withdrawn by some millimetres, so that a hand at rest does not make them chatter.

All numbers are this project's defaults, not published ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from tensionlab.allocation import TOLERANCE
from tensionlab.errors import InputError
from tensionlab.haptics.brakes.choice import Flags, LockSet, choose_locks
from tensionlab.haptics.effects.parameters import Number, checked_dataclass
from tensionlab.model import pose
from tensionlab.model.module import TensionLimits
from tensionlab.support.arrays import Floats, require_finite

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
