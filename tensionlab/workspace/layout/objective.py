"""Objective of a layout search: what is desired of layouts, and how much of it they have in targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import InputError, ShapeError
from tensionlab.model import pose
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.model.stiffness import MIN_COSINE, MODULE_STIFFNESS, host_stiffness, module_stiffness
from tensionlab.support.arrays import Floats, Integers, require_finite
from tensionlab.support.formatting import format_share, format_vector
from tensionlab.workspace.poses import Grid, PoseList, describe_step
from tensionlab.workspace.wrench_set import capacity_margin, facet_distance, half_spaces

TIE_WEIGHT = 0.1  # of missing or spare force, relative to the share: enough to lead a search among equals
LEAST_MODULE_STIFFNESS = MODULE_STIFFNESS * MIN_COSINE**2  # of a cable that may render a wall at all, in N/m

Target = Grid | PoseList
Targets = Target | ArrayLike | Sequence[Target]


def as_targets(target: Targets, dimension: int) -> tuple[Target, ...]:
    """Return targets as a tuple; ShapeError if one does not suit the dimension, is turned, or has no points."""
    if isinstance(target, Grid | PoseList):
        target = (target,)
    if not (isinstance(target, list | tuple) and target and isinstance(target[0], Grid | PoseList)):
        points = pose.points(cast(ArrayLike, target), dimension, "target").reshape(-1, dimension)
        if not len(points):
            raise ShapeError("target has no points; give at least one position of the hand")
        return (PoseList(points),)
    for each in target:
        positions, rotations = each.arrays()
        pose.points(positions, dimension, "target")
        if rotations is not None:
            raise ShapeError("target has orientations, but the hand is a point here; leave them out")
    return tuple(target)


@dataclass(frozen=True)
class Objective:
    """Criterion by which layouts are compared.

    With a desired force or stiffness, it is the share of the target that has all that is desired. Without, it is
    the largest force, or the largest stiffness if walls are given, that is there everywhere in the target. Forces
    are in addition to what the space requires, such as the weight of a tool, which must be feasible too.

    The stiffness of a wall is what the module whose cable lies best along it renders by its own impedance, or the
    host, if no cable lies within 45 degrees: see `tensionlab.model.stiffness`.

    Attributes
    ----------
    force : float or None
        Desired force, in N.
    directions : (k, d) array or None
        Directions of the force; None for every direction.
    stiffness : float or None
        Desired stiffness of walls, in N/m.
    walls : (k, d) array or None
        Directions in which walls push the hand.
    host : float
        Stiffness of walls that the host renders, in N/m.
    target_weights : tuple of float or None
        Weight of each target in the score; None: the worst target counts.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.Objective(force=2.0)  # the share of the target with 2 N in every direction
    Objective(force=2.0)
    >>> up = tl.workspace.Objective(directions=[[0, 1, 0]])  # the largest force upwards
    >>> stiff = tl.workspace.Objective(force=1.0, stiffness=300.0, walls=[[0, 1, 0], [0, 0, 1]])
    """

    force: float | None = None
    directions: ArrayLike | None = None
    stiffness: float | None = None
    walls: ArrayLike | None = None
    host: float = host_stiffness()
    target_weights: tuple[float, ...] | None = None
    points: PointWeights | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        for key, unit in (("force", "N"), ("stiffness", "N/m")):
            if (value := getattr(self, key)) is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"objective: {key} is {value}; give a {key} in {unit} above zero, or None")
        for key in ("directions", "walls"):
            if (value := getattr(self, key)) is not None:
                object.__setattr__(self, key, _unit_vectors(key, value))
        if self.stiffness is not None and self.walls is None:
            raise InputError(
                "objective: a stiffness is given without walls; give the directions they push the hand"
            )
        if self.walls is not None and self.stiffness is None and (self.force is not None or self.directions):
            raise InputError("objective: walls and a force are both given; give the desired force and stiffness")
        if weights := self.target_weights:
            if not (np.isfinite(weights).all() and min(weights) > 0):
                raise InputError(f"objective: target weights are {weights}; give numbers above zero")
            object.__setattr__(self, "target_weights", tuple(weight / sum(weights) for weight in weights))

    def __repr__(self) -> str:
        given = [(each.name, getattr(self, each.name), each.default) for each in fields(self) if each.repr]
        return f"Objective({', '.join(f'{name}={value!r}' for name, value, left in given if value != left)})"

    @property
    def level(self) -> float | None:
        """Value from which a point has all that is desired; None if the least value is maximised."""
        return self.stiffness if self.force is None else self.force

    def over(self, targets: Sequence[Target]) -> Objective:
        """Return the objective for the points of targets, those in a face of a grid counting half."""
        if self.target_weights and len(self.target_weights) != len(targets):
            raise InputError(
                f"objective: {len(self.target_weights)} weights for {len(targets)} targets; give one for each"
            )
        return replace(self, points=PointWeights.of(targets))

    def values(self, structure: Floats, limits: TensionLimits, required: Floats, ball: float) -> Floats:
        """Return what points with structure matrices (..., d, m) have of each thing desired, (C, ...).

        Capacity margins in N, forces along directions in N, or stiffnesses in N/m, these scaled so that the
        desired one is at `level`. Where what is required is infeasible it is the capacity margin, below zero.
        """
        margin = capacity_margin(structure, limits, required) - ball
        rows = [margin] if self.directions is None and (self.walls is None or self.force is not None) else []
        further: list[Floats] = []
        if self.directions is not None:
            normals, offsets = half_spaces(structure, limits)
            room = offsets - (normals @ required.T).max(axis=-1) - ball
            further += [*np.moveaxis(facet_distance(room, normals, np.array(self.directions)), -1, 0)]
        if self.walls is not None:
            stiffness = module_stiffness(structure.swapaxes(-1, -2), np.array(self.walls))
            if self.stiffness is not None and self.level is not None:
                by_host = self.stiffness <= self.host
                least = max(self.stiffness, LEAST_MODULE_STIFFNESS)
                stiffness = self.level * (np.ones_like(stiffness) if by_host else stiffness / least)
            further += [*np.moveaxis(stiffness, -1, 0)]
        return np.stack(rows + [np.where(margin < 0, margin, row) for row in further])

    def score(self, values: Floats) -> Floats:
        """Return the score (...) of layouts with least values (..., P) over the points: a share, N or N/m."""
        found = self._worst(values)
        if self.level is None and self.walls is not None:
            by_module = (found >= LEAST_MODULE_STIFFNESS) | (found < 0)
            return np.where(by_module, found, np.maximum(self.host, 0.0))
        return found

    def merit(self, values: Floats) -> Floats:
        """Return the score (...), with a little to rank layouts of the same share, from values (..., P).

        More for what the worst point has to spare or, where something is missing, less for the mean of that.
        """
        found = self._worst(values)
        if self.level is None:
            return found
        spare = np.maximum(values.min(axis=-1) / self.level - 1, 0.0)
        return found + TIE_WEIGHT * np.asarray(spare - self._mean(self.missing(values)))

    def smooth(self, values: Floats, sharpness: float) -> Floats:
        """Return a continuous approximation (...) of the merit for gradients, from values (..., P).

        The worst value, while nothing is missing. Else minus the share that is lost, with ``log(1 + missing /
        sharpness)`` for each point: the smaller ``sharpness``, the less it matters how much is missing.

        Source: Candes, Wakin and Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008.
        """
        if self.level is None:
            return self._worst(values)
        worst = values.min(axis=-1)
        lost = self._mean(np.log1p(self.missing(values) / sharpness))
        return np.asarray(np.where(worst < self.level, -lost, worst))

    def missing(self, values: Floats) -> Floats:
        """Return the share of what is desired that is missing at each point, (..., P), 0 or more."""
        return np.zeros_like(values) if self.level is None else np.maximum(1 - values / self.level, 0.0)

    def _worst(self, values: Floats) -> Floats:
        """Return the least value or, if something is desired, the share that has it, (...), over the targets."""
        points = self.points or PointWeights.equal(values.shape[-1])
        if self.level is None:
            each = np.minimum.reduceat(values, points.starts, axis=-1)
        else:
            each = points.mean(values >= self.level)
        return np.asarray(each.min(axis=-1) if self.target_weights is None else each @ self.target_weights)

    def _mean(self, values: Floats) -> Floats:
        """Return the mean (...) of values (..., P) over the targets."""
        each = (self.points or PointWeights.equal(values.shape[-1])).mean(values)
        return np.asarray(each.mean(axis=-1) if self.target_weights is None else each @ self.target_weights)

    def groups(self, count: int) -> Integers:
        """Return the number of the target of each of P points, or 0 where the worst of all targets counts."""
        found = np.zeros(count, np.int64)
        if self.points is not None and self.target_weights is not None:
            found[self.points.starts[1:]] = 1
        return found.cumsum()

    def where(self, rig: Rig) -> str:
        """Return in words along which directions forces count, and about which wrenches of a rig."""
        about = f" about {rig.required.describe(rig)}" if rig.required else ""
        return f"{_towards(self.directions)}{about}"

    def desired(self, rig: Rig) -> list[str]:
        """Return in words what is desired of a rig."""
        force = [] if self.force is None else [f"{self.force:g} N {self.where(rig)}"]
        return force + (
            [] if self.stiffness is None else [f"walls of {self.stiffness:g} N/m {_towards(self.walls)}"]
        )

    def describe(self, rig: Rig, score: float | None = None) -> str:
        """Return in words what the score of a rig is, or what a rig with a score renders, after its name."""
        where = self.where(rig)
        many = self.points is not None and len(self.points.starts) > 1
        target = "the target" if not many else "the targets" if self.target_weights else "each target"
        if self.level is None and self.walls is not None:
            if score is None:
                return f"the largest stiffness in N/m of walls {_towards(self.walls)}, everywhere in {target}"
            return f"renders walls of {max(score, 0.0):.4g} N/m {_towards(self.walls)} throughout {target}"
        if self.level is None:
            if score is None:
                return f"the maximum force in N {where}, everywhere in {target}"
            return f"renders {max(score, 0.0):.4g} N {where} throughout {target}"
        desired = " and ".join(self.desired(rig))
        points = f" (points {self.points.step})" if self.points and self.points.step else ""
        if score is None:
            return f"the share of {target}{points} with {desired}"
        return f"renders {desired} in {format_share(score)} of {target}{points}"


@dataclass(frozen=True, eq=False)
class PointWeights:
    """Share of its target that belongs to each point (P,), where each target starts, and the step in words."""

    weights: Floats
    starts: Integers
    step: str = ""

    @classmethod
    def of(cls, targets: Sequence[Target]) -> PointWeights:
        """Return the weights of the points of targets."""
        shares = [_shares(each) for each in targets]
        steps = {describe_step((each.x, each.y, each.z)) if isinstance(each, Grid) else "" for each in targets}
        starts = np.cumsum([0, *map(len, shares[:-1])])
        return cls(np.concatenate(shares), starts, steps.pop() if len(steps) == 1 else "")

    @classmethod
    def equal(cls, count: int) -> PointWeights:
        """Return equal weights of the points of one target."""
        return cls(np.full(count, 1.0 / count), np.zeros(1, np.int64))

    def mean(self, values: Floats | NDArray[np.bool_]) -> Floats:
        """Return the mean (..., T) of values (..., P) over each target."""
        return np.asarray(np.add.reduceat(values * self.weights, self.starts, axis=-1))


def _shares(target: Target) -> Floats:
    """Return the share of a target that belongs to each of its points, (P,)."""
    if isinstance(target, PoseList):
        return np.full(len(target.position), 1.0 / len(target.position))
    share = np.ones(())
    for along in target.weights():
        share = np.multiply.outer(share, along)
    return share.ravel()


def _unit_vectors(key: str, values: ArrayLike) -> tuple[tuple[float, ...], ...]:
    vectors = np.atleast_2d(require_finite(f"objective {key}", values, 1))
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if vectors.ndim != 2 or not vectors.size or not lengths.all():
        raise InputError(f"objective: {key} are {vectors.tolist()}; give one or more vectors that are not zero")
    return tuple(map(tuple, (vectors / lengths).tolist()))


def _towards(directions: ArrayLike | None) -> str:
    """Return directions in words: "in every direction", "towards +y and (0.6, 0.8, 0)"."""
    if directions is None:
        return "in every direction"
    words = []
    for vector in np.asarray(directions, float):
        axis = int(np.argmax(abs(vector)))
        along_axis = abs(vector[axis]) > 1 - 1e-9
        words.append(f"{'-' if vector[axis] < 0 else '+'}{'xyz'[axis]}" if along_axis else format_vector(vector))
    return f"towards {' and '.join(words)}"
