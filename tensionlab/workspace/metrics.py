"""Metrics that a sweep evaluates at every pose, and the registry of their names.

A metric is a frozen dataclass of its hyper-parameters, all with defaults, and one method. The first line of its
docstring describes it on the command line and in datasets.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, Protocol, get_args

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.model.directions import circle, fibonacci
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support import registry
from tensionlab.support.arrays import Floats
from tensionlab.workspace import interference, margin, structure_metrics


@dataclass(frozen=True, eq=False)
class Batch:
    """B poses of one rig at which no cable has length zero, and their structure matrices (B, n, m).

    Position (B, d), in m, rotation and frames are as in `Rig.structure_matrix`; ``required`` is what the cables
    must exert at all of them.
    """

    rig: Rig
    position: Floats
    rotation: Floats | None
    frames: Frames
    structure: Floats
    required: Requirement

    @cached_property
    def wrench(self) -> Floats:
        """The middle of the required wrenches, (n,), or (B, n) where it turns with the platform."""
        return self.required.middle(self.rig, self.rotation)

    @cached_property
    def margin(self) -> Floats:
        """The capacity margin about all required wrenches, (B,), in N."""
        return margin.required_margin(self.rig, self.structure, self.required, self.rotation)


class Metric(Protocol):
    """Number for each pose of a batch; ``above_zero`` says what holds where it is above zero, if anything."""

    title: ClassVar[str]
    unit: ClassVar[str]
    above_zero: ClassVar[str]

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose, (B,)."""
        ...


@dataclass(frozen=True)
class CapacityMargin:
    """Force to spare in the worst direction before the rig can no longer render what is required.

    What is required is zero if nothing is said. Torques count as forces, divided by the characteristic length.
    Below zero is how much of it is infeasible.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.CapacityMargin(radius=1.0), progress=False)
    >>> swept["capacity-margin:1.0"].values.round(3)
    array([[2.681, 0.304]])
    """

    radius: float = 0.0

    title: ClassVar[str] = "capacity margin"
    unit: ClassVar[str] = "N"
    above_zero: ClassVar[str] = "all of it is feasible, and the radius in every direction beside"

    def __post_init__(self) -> None:
        _check(self, "radius", np.isfinite(self.radius) and self.radius >= 0, "a wrench in N, 0 or more")

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        return batch.margin - self.radius


@dataclass(frozen=True)
class WrenchFeasible:
    """Whether the cables exert every required wrench within their limits: 1 or 0.

    Zero is required if nothing is said. A wrench outside by no more than the tolerance of an exact allocation
    counts as feasible.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, "wrench-feasible", required=[0.0, 5.0, 0.0], progress=False)
    >>> swept["wrench-feasible"].values
    array([[1., 0.]])
    """

    title: ClassVar[str] = "wrench feasibility"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "it is feasible"

    def evaluate(self, batch: Batch) -> Floats:
        """Return 1 or 0 at every pose."""
        tolerance = structure_metrics.feasibility_tolerance(batch.required.at(batch.rig, batch.rotation))
        return (batch.margin >= -tolerance).astype(np.float64)


@dataclass(frozen=True)
class WrenchClosure:
    """Whether cables of unlimited strength render every wrench: 1 or 0.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.WrenchClosure(), progress=False)
    >>> swept["wrench-closure"].values.round(3)
    array([[1., 1.]])
    """

    title: ClassVar[str] = "wrench closure"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "they do"

    def evaluate(self, batch: Batch) -> Floats:
        """Return 1 or 0 at every pose."""
        return structure_metrics.wrench_closure(batch.structure).astype(np.float64)


@dataclass(frozen=True)
class TensionFactor:
    """Ratio of minimum to maximum tension while all cables are taut without a wrench.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.TensionFactor(), progress=False)
    >>> swept["tension-factor"].values.round(3)
    array([[0.723, 0.385]])
    """

    title: ClassVar[str] = "tension factor"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "all cables can be taut without a wrench"

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        return structure_metrics.tension_factor(batch.structure)


@dataclass(frozen=True)
class IsotropicForce:
    """Maximum force that is feasible in every direction, without torque.

    Beside the required wrench, or the middle of a set of them.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.IsotropicForce(), progress=False)
    >>> swept["isotropic-force"].values.round(3)
    array([[3.681, 1.304]])
    """

    title: ClassVar[str] = "isotropic force"
    unit: ClassVar[str] = "N"
    above_zero: ClassVar[str] = "some force is"

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        rig = batch.rig
        return structure_metrics.isotropic_force(batch.structure, rig.limits, rig.dimension, batch.wrench)


@dataclass(frozen=True)
class ReachableShare:
    """Feasible-direction fraction: share of directions in which a force (1 N if left out) is feasible.

    Without torque, in directions that cover the circle or sphere evenly, and beside the required wrench, or the
    middle of a set of them.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.ReachableShare(magnitude=4.0), progress=False)
    >>> swept["reachable-share:4.0"].values.round(3)
    array([[0.88 , 0.115]])
    """

    magnitude: float = 1.0
    count: int = 200

    title: ClassVar[str] = "feasible-direction fraction"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "it is in some direction"

    def __post_init__(self) -> None:
        _check_forces(self, self.magnitude, self.count)

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        directions = _even_directions(batch.rig, self.count)
        return structure_metrics.reachable_share(
            batch.structure, batch.rig.limits, directions, self.magnitude, batch.wrench
        )


@dataclass(frozen=True)
class LeastSingularValue:
    """Minimum singular value of the structure matrix: wrench in the weakest direction for a unit of tension.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.LeastSingularValue(), progress=False)
    >>> swept["least-singular-value"].values.round(3)
    array([[1.087, 0.612]])
    """

    title: ClassVar[str] = "minimum singular value of the structure matrix"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = "no direction is lost"

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        return structure_metrics.least_singular_value(batch.structure)


@dataclass(frozen=True)
class ConditionNumber:
    """Ratio of the strongest to the weakest direction: 1 is even, infinite lost.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.ConditionNumber(), progress=False)
    >>> swept["condition-number"].values.round(3)
    array([[1.178, 2.944]])
    """

    title: ClassVar[str] = "condition number of the structure matrix"
    unit: ClassVar[str] = "1"
    above_zero: ClassVar[str] = ""

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        return structure_metrics.condition_number(batch.structure)


@dataclass(frozen=True)
class SquaredTension:
    """Sum of squared tensions for a force (1 N), its mean over directions, or its maximum (worst).

    Without torque, in directions that cover the circle or sphere evenly, and beside the required wrench, or the
    middle of a set of them. NaN where some are infeasible.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> poses = [[0.0, 0.3, 0.0], [0.0, 1.0, 0.0]]
    >>> swept = tl.sweep(rig, poses, tl.workspace.SquaredTension("worst"), progress=False)
    >>> swept["effort:worst"].values.round(1)  # N²
    array([[ 9.1, 36.2]])
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
        """Return the value at every pose."""
        directions = _even_directions(batch.rig, self.count)
        limits = batch.rig.limits
        found = structure_metrics.effort(batch.structure, limits, directions, self.magnitude, batch.wrench)
        return found.mean if self.over == "mean" else found.worst


@dataclass(frozen=True)
class CableDistance:
    """Minimum distance between two cables; infinite where no two could meet.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("ipanema-1")
    >>> swept = tl.sweep(rig, [rig.home], "cable-distance", progress=False)
    >>> swept["cable-distance"].values.round(3)  # m
    array([[0.12]])
    """

    title: ClassVar[str] = "distance between cables"
    unit: ClassVar[str] = "m"
    above_zero: ClassVar[str] = "none touch"

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        return interference.cable_distance(batch.rig, batch.position, batch.rotation, batch.frames).distance


@dataclass(frozen=True)
class BodyDistance:
    """Minimum distance between a cable and a body; below zero where a cable enters one.

    Bodies are `tensionlab.workspace.Capsule`, so this one is given as an instance, not by its name.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> head = tl.workspace.Capsule([0.0, 1.2, -0.3], radius=0.12)
    >>> metric = tl.workspace.BodyDistance((head,))
    >>> swept = tl.sweep(rig, [rig.home], metric, progress=False)
    >>> list(swept.data_vars)
    ['body-distance']
    """

    bodies: tuple[interference.Capsule, ...] = ()

    title: ClassVar[str] = "distance between cables and bodies"
    unit: ClassVar[str] = "m"
    above_zero: ClassVar[str] = "no cable touches a body"

    def __post_init__(self) -> None:
        if not self.bodies:
            raise SweepError(
                "body-distance: no bodies are given, which the command line cannot do; in Python sweep "
                "tensionlab.workspace.BodyDistance((body, ...)), each body a Capsule"
            )

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose."""
        rig, bodies = batch.rig, self.bodies
        return interference.body_distance(rig, bodies, batch.position, batch.rotation, batch.frames).distance


METRICS: dict[str, type[Any]] = {
    "capacity-margin": CapacityMargin,
    "wrench-feasible": WrenchFeasible,
    "wrench-closure": WrenchClosure,
    "tension-factor": TensionFactor,
    "isotropic-force": IsotropicForce,
    "reachable-share": ReachableShare,
    "least-singular-value": LeastSingularValue,
    "condition-number": ConditionNumber,
    "effort": SquaredTension,
    "cable-distance": CableDistance,
    "body-distance": BodyDistance,
}
"""Metrics by name. A new one is a class above and a line here."""


def make(name: str) -> Metric:
    """Return the metric of a name in `METRICS`; SweepError if there is none.

    What follows a colon sets the first hyper-parameter: ``"reachable-share:2.0"`` is
    ``ReachableShare(magnitude=2.0)``.
    """
    found = METRICS.get(name.partition(":")[0])
    metric: Metric = registry.create_by_name(name, found, METRICS, "metric", SweepError)
    return metric


def name_of(metric: Metric) -> str:
    """Return the name of which `make` makes this metric; only the first hyper-parameter is in it.

    A metric from elsewhere is called like its class.
    """
    family = next((name for name, kind in METRICS.items() if type(metric) is kind), None)
    if family is None:
        return type(metric).__name__
    first = registry.variant_field(type(metric))
    value = first and getattr(metric, first.name)
    return family if first is None or value == first.default else f"{family}:{value}"


def description(metric: Metric) -> str:
    """Return what a metric is: the first line of its docstring."""
    return (type(metric).__doc__ or "").partition("\n")[0]


def _check(metric: Any, name: str, sound: bool, expected: str) -> None:
    if not sound:
        raise SweepError(f"{type(metric).__name__}({name}={getattr(metric, name)!r}): give {expected}")


def _check_forces(metric: Any, magnitude: float, count: int) -> None:
    _check(metric, "magnitude", np.isfinite(magnitude) and magnitude > 0, "a force in N, above zero")
    _check(metric, "count", count >= 1, "a number of directions, 1 or more")


def _even_directions(rig: Rig, count: int) -> Floats:
    """Return unit vectors that cover the circle or sphere evenly."""
    return circle(count) if rig.dimension == 2 else fibonacci(count)
