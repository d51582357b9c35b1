"""What a sweep can ask of every pose: the measures, one class each; `catalogue` names them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import SweepError
from tensionlab.model.directions import circle, fibonacci
from tensionlab.model.rig import Rig
from tensionlab.workspace import directions, interference, margin
from tensionlab.workspace import structure_metrics as measures
from tensionlab.workspace.base import Batch


@dataclass(frozen=True)
class CapacityMargin:
    """How much can the cables render in their weakest direction, beyond the radius (0 if left out)?

    The required set is a ball about zero, of forces and torques as one (N and N·m) if the rig has torques. Below
    zero is how much of it is missing.
    """

    radius: float = 0.0

    title: ClassVar[str] = "capacity margin"
    unit: ClassVar[str] = "N"
    above_zero: ClassVar[str] = "the radius can be rendered in every direction"

    def __post_init__(self) -> None:
        _check(self, "radius", np.isfinite(self.radius) and self.radius >= 0, "a wrench in N, 0 or more")

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        ball = (np.zeros(batch.rig.n), self.radius)
        return margin.capacity_margin(batch.structure, batch.rig.limits, ball)


@dataclass(frozen=True)
class WrenchClosure:
    """Can the cables, if they were strong enough, pull in every direction?"""

    title: ClassVar[str] = "wrench closure"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "they can"

    def evaluate(self, batch: Batch) -> Floats:
        """Find 1 or 0 at every pose."""
        return measures.wrench_closure(batch.structure).astype(np.float64)


@dataclass(frozen=True)
class TensionFactor:
    """How evenly can the cables be tensioned against each other: the least tension as a share of the largest?"""

    title: ClassVar[str] = "tension factor"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "all cables can be taut without a force"

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        return measures.tension_factor(batch.structure)


@dataclass(frozen=True)
class IsotropicForce:
    """Which force can be rendered exactly in every direction?"""

    title: ClassVar[str] = "isotropic force"
    unit: ClassVar[str] = "N"
    above_zero: ClassVar[str] = "some force can"

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        return measures.isotropic_force(batch.structure, batch.rig.limits, batch.rig.dimension)


@dataclass(frozen=True)
class ReachableShare:
    """In which share of all directions can a force of this magnitude (1 N if left out) be rendered?

    Without torque, in directions that cover the circle or sphere evenly.
    """

    magnitude: float = 1.0
    count: int = 200

    title: ClassVar[str] = "share of directions within reach"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "some direction can"

    def __post_init__(self) -> None:
        _check_forces(self, self.magnitude, self.count)

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        around = _around(batch.rig, self.count)
        return directions.reachable_share(batch.structure, batch.rig.limits, around, self.magnitude)


@dataclass(frozen=True)
class LeastSingularValue:
    """How much wrench does the weakest direction get for a unit of tension?"""

    title: ClassVar[str] = "least singular value of the structure matrix"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "no direction is lost"

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        return measures.least_singular_value(batch.structure)


@dataclass(frozen=True)
class ConditionNumber:
    """How much stronger is the strongest direction than the weakest? 1 is even, infinite lost."""

    title: ClassVar[str] = "condition number of the structure matrix"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = ""

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        return measures.condition_number(batch.structure)


@dataclass(frozen=True)
class SquaredTension:
    """How much squared tension does a force (1 N) take, in the mean over directions, or in the worst?

    Without torque, in directions that cover the circle or sphere evenly. NaN where some are out of reach.
    """

    over: Literal["mean", "worst"] = "mean"
    magnitude: float = 1.0
    count: int = 200

    title: ClassVar[str] = "squared tension for a force"
    unit: ClassVar[str] = "N²"
    above_zero: ClassVar[str] = ""

    def __post_init__(self) -> None:
        _check(self, "over", self.over in get_args(Literal["mean", "worst"]), "mean or worst")
        _check_forces(self, self.magnitude, self.count)

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        around = _around(batch.rig, self.count)
        found = directions.effort(batch.structure, batch.rig.limits, around, self.magnitude)
        return found.mean if self.over == "mean" else found.worst


@dataclass(frozen=True)
class CableDistance:
    """How close do two cables come to each other? Infinite where no two could meet."""

    title: ClassVar[str] = "distance between cables"
    unit: ClassVar[str] = "m"
    above_zero: ClassVar[str] = "none touch"

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        return interference.cable_distance(batch.rig, batch.position, batch.rotation, batch.frames).distance


@dataclass(frozen=True)
class BodyDistance:
    """How close does a cable come to a body? Below zero where one enters it.

    Bodies are `tensionlab.workspace.Capsule`, so this one is asked for as an instance, not by a name.
    """

    bodies: tuple[interference.Capsule, ...] = ()

    title: ClassVar[str] = "distance between cables and bodies"
    unit: ClassVar[str] = "m"
    above_zero: ClassVar[str] = "no cable touches a body"

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose."""
        rig, bodies = batch.rig, self.bodies
        return interference.body_distance(rig, bodies, batch.position, batch.rotation, batch.frames).distance


def _check(measure: Any, name: str, sound: bool, wanted: str) -> None:
    if not sound:
        raise SweepError(f"{type(measure).__name__}({name}={getattr(measure, name)!r}): give {wanted}")


def _check_forces(measure: Any, magnitude: float, count: int) -> None:
    _check(measure, "magnitude", np.isfinite(magnitude) and magnitude > 0, "a force in N, above zero")
    _check(measure, "count", count >= 1, "a number of directions, 1 or more")


def _around(rig: Rig, count: int) -> Floats:
    """Directions of force all around."""
    return circle(count) if rig.dimension == 2 else fibonacci(count)
