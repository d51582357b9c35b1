"""Objective of a layout search: what is desired of layouts, and how much of it they have in targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, ShapeError
from tensionlab.model import pose
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.model.wall_stiffness import LEAST_MODULE_STIFFNESS, host_stiffness, module_stiffness
from tensionlab.support.arrays import Floats, pad_last_axis, require_finite
from tensionlab.support.formatting import format_share, format_vector
from tensionlab.workspace.poses import Grid, PoseList
from tensionlab.workspace.shares import describe_step
from tensionlab.workspace.wrench_set import capacity_margin, facet_distance, half_spaces

TIE_WEIGHT = 0.1  # of missing or spare force, relative to the share: enough to lead a search among equals

Target = Grid | PoseList
Targets = Target | ArrayLike | Sequence[Target]


def as_targets(target: Targets, dimension: int, *, turns: bool = False) -> tuple[Target, ...]:
    """Return targets as a tuple; ShapeError if one does not suit the dimension, is turned, or has no points."""
    given = (target,) if isinstance(target, Grid | PoseList) else target
    if not (isinstance(given, list | tuple) and given and isinstance(given[0], Grid | PoseList)):
        points = pose.points(cast(ArrayLike, given), dimension, "target").reshape(-1, dimension)
        if not len(points):
            raise ShapeError("target has no points; give at least one position of the hand")
        given = (PoseList(points),)
    for poses in given:
        positions, rotations = poses.arrays()
        pose.points(positions, dimension, "target")
        if rotations is not None and not turns:
            raise ShapeError("target has orientations, but the hand is a point here; leave them out")
        if isinstance(poses, PoseList) and poses.wrench is not None:
            raise ShapeError("target has wrenches; leave them out, and say what is required of the whole target")
    return tuple(given)


@dataclass(frozen=True)
class Objective:
    """Criterion by which layouts are compared.

    The score is the share of the target that has the desired force and stiffness, of several targets the smallest.
    Without these, it is the largest force that is feasible everywhere in the targets or, if there are walls, their
    largest stiffness. Forces are in
    addition to what the space requires, such as a weight. Walls are as stiff as one module renders them, or the
    host: see `tensionlab.model.wall_stiffness`.

    Attributes
    ----------
    force, stiffness : float or None
        Desired force in N, and stiffness of walls in N/m.
    directions : (k, d) array or None
        Directions of the force; None for every direction.
    walls : (k, d) array or None
        Directions in which walls push the hand.
    losses : 0 or 1
        1: all this is desired after the loss of any one cable as well, which then has tension zero.

    Examples
    --------
    >>> import tensionlab as tl
    >>> strong = tl.workspace.Objective(force=2.0)  # the share of the target with 2 N in every direction
    >>> up = tl.workspace.Objective(directions=[[0, 1, 0]])  # the largest force upwards
    >>> stiff = tl.workspace.Objective(force=1.0, stiffness=300.0, walls=[[0, 1, 0], [0, 0, 1]])
    """

    force: float | None = None
    directions: ArrayLike | None = None
    stiffness: float | None = None
    walls: ArrayLike | None = None
    losses: int = 0
    shares: Floats | None = field(default=None, repr=False, compare=False)  # (T, P) of each target in its points
    step: str = field(default="", repr=False, compare=False)  # how far apart the points are, in words

    def __post_init__(self) -> None:
        for key, unit in (("force", "N"), ("stiffness", "N/m")):
            if (value := getattr(self, key)) is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"objective: {key} is {value}; give a {key} in {unit} above zero, or None")
        for key in ("directions", "walls"):
            if (value := getattr(self, key)) is not None:
                vectors = np.atleast_2d(require_finite(f"objective {key}", value, 1))
                lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
                if not vectors.size or not lengths.all():
                    raise InputError(f"objective: {key} are {value}; give vectors that are not zero")
                object.__setattr__(self, key, tuple(map(tuple, (vectors / lengths).tolist())))
        if self.losses not in (0, 1):
            raise InputError(f"objective: losses is {self.losses}; give 0, or 1 for the loss of any one cable")
        forces = self.force is not None or self.directions is not None
        if (self.walls is None and self.stiffness) or (self.walls is not None and forces and not self.stiffness):
            raise InputError("objective: give walls their stiffness, and a stiffness the walls that push the hand")

    @property
    def level(self) -> float | None:
        """Value from which a point has all that is desired; None if the least value is maximised."""
        return self.stiffness if self.force is None else self.force

    def over(self, targets: Sequence[Target]) -> Objective:
        """Return the objective for the points of targets, those in a face of a grid counting half."""
        from scipy.linalg import block_diag

        shares = [
            reduce(np.multiply.outer, target.weights()).ravel()
            if isinstance(target, Grid)
            else np.full(len(target.position), 1.0 / len(target.position))
            for target in targets
        ]
        grid = targets[0] if len(targets) == 1 and isinstance(targets[0], Grid) else None
        step = "" if grid is None else describe_step((grid.x, grid.y, grid.z))
        return replace(self, shares=block_diag(*shares), step=step)

    def values(self, structure: Floats, limits: TensionLimits, required: Floats, ball: float) -> Floats:
        """Return what points with structure matrices (..., n, m) have of each thing desired, (C, ...).

        Capacity margins in N, forces along directions in N, or stiffnesses in N/m, these scaled so that the
        desired one is at `level`; about the corners ``required`` (..., k, n) of what is required and a ball.
        Torques are divided by a length. Where what is required is infeasible it is the margin, below zero.
        """
        if self.losses:
            intact, cables = replace(self, losses=0), np.arange(structure.shape[-1])
            cases = [limits, *(limits.only(cables != lost) for lost in cables)]
            return np.asarray(np.min([intact.values(structure, case, required, ball) for case in cases], axis=0))
        margin = capacity_margin(structure, limits, required) - ball
        further: list[Floats] = []
        if self.directions is not None:
            normals, offsets = half_spaces(structure, limits)
            distances = offsets - (normals @ required.swapaxes(-1, -2)).max(axis=-1) - ball
            directions = pad_last_axis(np.array(self.directions), structure.shape[-2])
            further += [*np.moveaxis(facet_distance(distances, normals, directions), -1, 0)]
        if self.walls is not None:
            stiffness = module_stiffness(structure.swapaxes(-1, -2), np.array(self.walls))
            if self.stiffness is not None and self.level is not None:
                by_host = self.stiffness <= host_stiffness()
                share = stiffness / max(self.stiffness, LEAST_MODULE_STIFFNESS)
                stiffness = self.level * (np.ones_like(share) if by_host else share)
            further += [*np.moveaxis(stiffness, -1, 0)]
        every = self.directions is None and (self.walls is None or self.force is not None)
        return np.stack([margin] * every + [np.where(margin < 0, margin, row) for row in further])

    def score(self, values: Floats) -> Floats:
        """Return the score (...) of layouts with least values (..., P) over the points: a share, N or N/m."""
        worst = self._worst(values)
        if self.level is None and self.walls is not None:
            return np.where((worst >= LEAST_MODULE_STIFFNESS) | (worst < 0), worst, host_stiffness())
        return worst

    def merit(self, values: Floats) -> Floats:
        """Return the score (...), with a little to rank layouts of the same share, from values (..., P).

        More for what the worst point has to spare or, where something is missing, less for the mean of that.
        """
        worst = self._worst(values)
        if self.level is None:
            return worst
        spare = np.maximum(values.min(axis=-1) / self.level - 1, 0.0)
        return worst + TIE_WEIGHT * np.asarray(spare - self._means(self.missing(values)).mean(axis=-1))

    def smooth(self, values: Floats, sharpness: float) -> Floats:
        """Return a continuous approximation (...) of the merit for gradients, from values (..., P).

        The worst value, while nothing is missing. Else minus the share that is lost, with ``log(1 + missing /
        sharpness)`` for each point: the smaller ``sharpness``, the less it matters how much is missing.

        Source: Candes, Wakin and Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008.
        """
        if self.level is None:
            return self._worst(values)
        worst = values.min(axis=-1)
        lost = self._means(np.log1p(self.missing(values) / sharpness)).mean(axis=-1)
        return np.asarray(np.where(worst < self.level, -lost, worst))

    def missing(self, values: Floats) -> Floats:
        """Return the share of what is desired that is missing at each point, (..., P), 0 or more."""
        return np.zeros_like(values) if self.level is None else np.maximum(1 - values / self.level, 0.0)

    def _worst(self, values: Floats) -> Floats:
        """Return the least value (...) or, if a force or stiffness is desired, the smallest share of a target."""
        if self.level is None:
            return np.asarray(values.min(axis=-1))
        return np.asarray(self._means((values >= self.level).astype(float)).min(axis=-1))

    def _means(self, values: Floats) -> Floats:
        """Return the means (..., T) of values (..., P) over each target."""
        return values.mean(axis=-1, keepdims=True) if self.shares is None else values @ self.shares.T

    def where(self, rig: Rig) -> str:
        """Return in words along which directions forces count, and about which wrenches of a rig."""
        about = f" about {rig.required.describe(rig)}" if rig.required else ""
        torques = f" (torques at {rig.characteristic_length:.3g} m)" if rig.n > rig.dimension else ""
        return _towards(self.directions, self.losses) + about + torques

    def desired(self, rig: Rig) -> str:
        """Return in words what is desired of a rig."""
        force = f"{self.force:g} N {self.where(rig)}" if self.force else ""
        walls = f"walls of {self.stiffness:g} N/m {_towards(self.walls, self.losses)}" if self.stiffness else ""
        return " and ".join(filter(None, (force, walls)))

    def describe(self, rig: Rig, score: float | None = None) -> str:
        """Return in words what the score of a rig is, or what a rig with a score renders, after its name."""
        target = "the target" if self.shares is None or len(self.shares) == 1 else "the targets"
        if self.level is not None:
            target += f" (points {self.step})" if self.step else ""
            if score is None:
                return f"the share of {target} with {self.desired(rig)}"
            return f"renders {self.desired(rig)} in {format_share(score)} of {target}"
        what, unit, where = "force", "N", self.where(rig)
        if self.walls is not None:
            what, unit, where = "stiffness of walls", "N/m", _towards(self.walls, self.losses)
        if score is None:
            return f"the maximum {what} in {unit} {where}, everywhere in {target}"
        walls = "walls of " if self.walls is not None else ""
        return f"renders {walls}{max(score, 0.0):.4g} {unit} {where} throughout {target}"


def _towards(directions: ArrayLike | None, losses: int) -> str:
    """Return directions, as "in every direction" or "towards (0, 1, 0) and (1, 0, 0)", and after what loss."""
    after = " after the loss of any one cable" * losses
    if directions is None:
        return f"in every direction{after}"
    return f"towards {' and '.join(map(format_vector, np.asarray(directions, float)))}{after}"
