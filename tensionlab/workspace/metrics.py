"""Metrics that a sweep evaluates at every pose: the table `METRICS`, and metrics of your own."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from tensionlab.allocation import RANK_TOLERANCE, Allocation, Allocator, Status
from tensionlab.errors import InputError, SweepError
from tensionlab.model.bodies import Body
from tensionlab.model.directions import circle, fibonacci
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.model.stiffness import displacement, natural_frequencies, stiffness_eigenvalues, stiffness_matrix
from tensionlab.support import registry
from tensionlab.support.arrays import Floats
from tensionlab.workspace import interference, structure_metrics
from tensionlab.workspace.wrench_set import loss_margins, required_margin, worst_loss


@dataclass(frozen=True, eq=False)
class Batch:
    """B poses of one rig, as in `Rig.structure_matrix`, at which no cable has length zero.

    With their structure matrices (B, n, m), and what the cables must exert. Functions of a `Metric` take it.
    """

    rig: Rig
    position: Floats
    rotation: Floats | None
    frames: Frames
    structure: Floats
    required: Requirement
    added: Floats | None = None  # wrench that is required at each pose in addition, (B, n)

    @cached_property
    def wrench(self) -> Floats:
        """Middle of the required wrenches, (n,), or (B, n) where it is not the same at all poses."""
        return self.required.middle(self.rig, self.rotation) + (0.0 if self.added is None else self.added)

    @cached_property
    def margin(self) -> Floats:
        """Capacity margin about all required wrenches, (B,), in N."""
        return required_margin(self.rig, self.structure, self.required, self.rotation, self.added)

    @cached_property
    def loss_margins(self) -> Floats:
        """Capacity margin about all required wrenches after the loss of each cable, (B, m), in N."""
        return required_margin(
            self.rig, self.structure, self.required, self.rotation, self.added, margin=loss_margins
        )

    @cached_property
    def allocation(self) -> Allocation:
        """Tensions of the solver ``newton`` for `wrench`."""
        return Allocator(self.rig.limits)(self.structure, self.wrench)

    @cached_property
    def stiffness(self) -> Floats:
        """Stiffness matrices (B, n, n) at the tensions of `allocation`."""
        rig = replace(self.rig, required=self.required)
        return stiffness_matrix(rig, self.allocation.tensions, self.position, self.rotation, self.frames)


@dataclass(frozen=True)
class Metric:
    """Number for each pose: a function, its unit, and which values are better.

    Attributes
    ----------
    function : callable
        Takes a `Batch` of B poses, and the parameters by keyword, and returns the values (B,). The first line of
        its docstring describes the metric.
    unit : str
        Unit of the values; "1" for none.
    direction : "higher", "lower" or "none"
        Which values are better; none where values are numbers of modules.
    title : str
        Label in figures; empty for the name.
    above_zero : str
        What holds where the value is above zero, if anything.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> def longest(batch):
    ...     return batch.rig.lengths(batch.position).max(axis=-1)
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> metric = tl.workspace.Metric("longest-cable", longest, unit="m", direction="lower")
    >>> tl.sweep(rig, [rig.home], metric)["longest-cable"].values.round(3)
    array([[2.]])
    """

    name: str
    function: Callable[..., Floats]
    unit: str = "1"
    direction: Literal["higher", "lower", "none"] = "higher"
    title: str = ""
    above_zero: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def evaluate(self, batch: Batch) -> Floats:
        """Return the value at every pose, (B,)."""
        return self.function(batch, **self.parameters)

    @property
    def description(self) -> str:
        """First line of the function's docstring."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]

    @property
    def identity(self) -> str:
        """Text that identifies the metric: its function and parameters."""
        given = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"{self.function.__module__}.{self.function.__qualname__}({given})"


def _capacity_margin(batch: Batch, radius: float = 0.0) -> Floats:
    """Force to spare in the worst direction before the rig can no longer render what is required."""
    return batch.margin - _radius(radius)


def _loss_margin(batch: Batch, radius: float = 0.0) -> Floats:
    """Capacity margin after the loss of any one cable, which then has tension zero: that of the worst."""
    return np.asarray(batch.loss_margins.min(axis=-1) - _radius(radius))


def _radius(radius: float) -> float:
    """Return the radius of a ball of required wrenches, in N; refuse one below zero."""
    if not (np.isfinite(radius) and radius >= 0):
        raise InputError(f"radius is {radius}; give a wrench in N, 0 or more")
    return radius


def _worst_loss(batch: Batch) -> Floats:
    """Cable whose loss leaves the smallest capacity margin: the number of its module, from 0."""
    return worst_loss(batch.loss_margins).astype(np.float64)


def _wrench_feasible(batch: Batch) -> Floats:
    """Whether the cables exert every required wrench within their limits: 1 or 0."""
    added = 0.0 if batch.added is None else batch.added[:, None]
    tolerance = structure_metrics.feasibility_tolerance(batch.required.at(batch.rig, batch.rotation) + added)
    return (batch.margin >= -tolerance).astype(np.float64)


def _wrench_closure(batch: Batch) -> Floats:
    """Whether cables of unlimited strength render every wrench: 1 or 0."""
    return structure_metrics.wrench_closure(batch.structure).astype(np.float64)


def _tension_factor(batch: Batch) -> Floats:
    """Ratio of minimum to maximum tension while all cables are taut without a wrench."""
    return structure_metrics.tension_factor(batch.structure)


def _isotropic_force(batch: Batch) -> Floats:
    """Maximum force that is feasible in every direction, without torque.

    On top of the required wrench, or the middle of a set of them.
    """
    rig = batch.rig
    return structure_metrics.isotropic_force(batch.structure, rig.limits, rig.dimension, batch.wrench)


def _feasible_direction_fraction(batch: Batch, magnitude: float = 1.0, count: int = 200) -> Floats:
    """Share of directions in which a force (1 N if left out) is feasible.

    Without torque, in directions that cover the circle or sphere evenly, on top of the required wrench.
    """
    return structure_metrics.feasible_direction_fraction(*_forces(batch, magnitude, count))


def _squared_tension(batch: Batch, over: str = "mean", magnitude: float = 1.0, count: int = 200) -> Floats:
    """Sum of squared tensions for a force (1 N), its mean over directions, or its maximum (worst)."""
    if over not in ("mean", "worst"):
        raise InputError(f"squared-tension: over is {over!r}; give mean or worst")
    squares = structure_metrics.squared_tension(*_forces(batch, magnitude, count))
    return squares.mean if over == "mean" else squares.worst


def _forces(batch: Batch, magnitude: float, count: int) -> tuple[Any, ...]:
    """Return the arguments of `feasible_direction_fraction`, for a number of directions."""
    directions = circle(count) if batch.rig.dimension == 2 else fibonacci(count)
    return batch.structure, batch.rig.limits, directions, magnitude, batch.wrench


def _least_singular_value(batch: Batch) -> Floats:
    """Wrench in the weakest direction for a unit of tension: the structure matrix's minimum singular value."""
    _, n, m = batch.structure.shape
    return np.asarray(np.linalg.svd(batch.structure, compute_uv=False)[:, -1] * (m >= n))


def _condition_number(batch: Batch) -> Floats:
    """Ratio of the strongest to the weakest direction: 1 is even, infinite means a direction is lost."""
    _, n, m = batch.structure.shape
    sigma = np.linalg.svd(batch.structure, compute_uv=False)
    regular = (sigma[:, -1] > RANK_TOLERANCE * sigma[:, 0]) & (m >= n)
    return np.asarray(np.divide(sigma[:, 0], sigma[:, -1], out=np.full(len(sigma), np.inf), where=regular))


def _cable_distance(batch: Batch) -> Floats:
    """Minimum distance between two cables; infinite where no two could meet."""
    return interference.cable_distance(batch.rig, batch.position, batch.rotation, batch.frames).distance


def _body_distance(batch: Batch, *, bodies: tuple[Body, ...] | None = None) -> Floats:
    """Minimum distance between a cable and a body, however it sways; below zero where a cable may enter one."""
    if not (batch.rig.bodies if bodies is None else bodies):
        raise InputError(f'body-distance: rig "{batch.rig.name}" has no bodies; list them as [[bodies]]')
    return interference.body_distance(batch.rig, batch.position, batch.rotation, batch.frames, bodies).distance


def _least_stiffness(batch: Batch) -> Floats:
    """Stiffness in the weakest direction, with the tensions of ``newton`` for what is required.

    Rotations count with the characteristic length. NaN where what is required is infeasible.
    """
    return _where_exact(batch, stiffness_eigenvalues(batch.rig, batch.stiffness)[:, 0])


def _stiffness_along(batch: Batch, direction: str | tuple[float, ...] = "up") -> Floats:
    """Stiffness against a displacement up, along x, y, z or a vector; tensions as of least-stiffness.

    The force along the direction per displacement along it, where nothing else moves.
    """
    along = displacement(batch.rig, direction)
    return _where_exact(batch, np.einsum("i,bij,j->b", along, batch.stiffness, along))


def _first_natural_frequency(batch: Batch) -> Floats:
    """Lowest natural frequency of the platform on its cables, with the tensions of least-stiffness."""
    return _where_exact(batch, natural_frequencies(batch.rig, batch.stiffness, batch.rotation)[:, 0])


def _where_exact(batch: Batch, values: Floats) -> Floats:
    """Return values (B,), NaN where what is required is infeasible."""
    return np.where(batch.allocation.status == Status.EXACT, values, np.nan)


METRICS: dict[str, Metric] = {
    metric.name: metric
    for metric in (
        Metric("capacity-margin", _capacity_margin, "N", "higher", "capacity margin",
               "all that is required is feasible, and the radius in every direction as well"),
        Metric("loss-margin", _loss_margin, "N", "higher", "capacity margin after the worst loss",
               "all that is required is feasible without any one cable"),
        Metric("worst-loss", _worst_loss, "1", "none", "worst module to lose"),
        Metric("wrench-feasible", _wrench_feasible, "1", "higher", "wrench feasibility", "it is feasible"),
        Metric("wrench-closure", _wrench_closure, "1", "higher", "wrench closure", "they do"),
        Metric("tension-factor", _tension_factor, "1", "higher", "tension factor",
               "all cables can be taut without a wrench"),
        Metric("isotropic-force", _isotropic_force, "N", "higher", "isotropic force", "some force is"),
        Metric("feasible-direction-fraction", _feasible_direction_fraction, "1", "higher",
               "feasible-direction fraction", "it is in some direction"),
        Metric("least-singular-value", _least_singular_value, "1", "higher",
               "minimum singular value of the structure matrix", "no direction is lost"),
        Metric("condition-number", _condition_number, "1", "lower", "condition number of the structure matrix"),
        Metric("squared-tension", _squared_tension, "N²", "lower", "squared tension for a force"),
        Metric("least-stiffness", _least_stiffness, "N/m", "higher", "stiffness in the weakest direction",
               "the pose is stable"),
        Metric("stiffness-along", _stiffness_along, "N/m", "higher", "stiffness along a direction",
               "it returns the platform"),
        Metric("first-natural-frequency", _first_natural_frequency, "Hz", "higher", "first natural frequency",
               "the pose is stable"),
        Metric("cable-distance", _cable_distance, "m", "higher", "distance between cables", "none touch"),
        Metric("body-distance", _body_distance, "m", "higher", "distance between cables and bodies",
               "no cable touches a body"),
    )
}  # fmt: skip


def metric(name: str | Metric, **parameters: Any) -> Metric:
    """Return a metric of `METRICS`, by name, with some parameters of its function set; a `Metric` as it is.

    What follows a colon sets the first parameter: ``"feasible-direction-fraction:2.0"`` is
    ``metric("feasible-direction-fraction", magnitude=2.0)``. SweepError if there is no such metric or parameter.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> head = tl.Body("head", [0.0, 1.2, -0.3], radius=0.12)
    >>> metric = tl.workspace.metric("body-distance", bodies=(head,))
    >>> tl.sweep(rig, [rig.home], ["squared-tension:worst", metric])["squared-tension:worst"].values.round(1)
    array([[9.1]])
    """
    if isinstance(name, Metric):
        return name
    if not isinstance(name, str):
        raise SweepError(f"{name!r} is no metric; give a name in METRICS, or a Metric")
    family, colon, variant = name.partition(":")
    if family not in METRICS:
        raise SweepError(f"no metric is called {family!r}; {registry.suggest(family, METRICS)}")
    registered = METRICS[family]
    known = {
        parameter.name: parameter
        for parameter in list(inspect.signature(registered.function).parameters.values())[1:]
    }
    if unknown := [key for key in parameters if key not in known]:
        raise SweepError(f"{family!r} has no parameter {unknown[0]!r}; {registry.suggest(unknown[0], known)}")
    first = next((parameter for parameter in known.values() if parameter.kind is not parameter.KEYWORD_ONLY), None)
    if colon:
        if first is None:
            raise SweepError(f"{family!r} has no variants, so {name!r} means nothing; write {family!r}")
        try:
            parameters[first.name] = type(first.default)(variant)
        except ValueError:
            raise SweepError(f"in {name!r}, {variant!r} is no value for its {first.name}; give a number") from None
    elif first is not None and parameters.get(first.name, first.default) != first.default:
        name = f"{family}:{parameters[first.name]}"
    return replace(registered, name=name, parameters=parameters)
