"""Objective of a layout search: capacity margins over the target, their slopes, and the score."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import InputError
from tensionlab.model import kinematics
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_share
from tensionlab.workspace.layout.space import Placement, Space
from tensionlab.workspace.poses import Grid, describe_step
from tensionlab.workspace.wrench_set import capacity_margin, margin_gradient

TIE_WEIGHT = 0.1  # of missing or spare force, relative to the share: enough to lead a search among equals
MAX_CHUNK_POINTS = 50_000  # points of layouts that are evaluated together; it bounds the memory


@dataclass(frozen=True)
class Objective:
    """Criterion by which layouts are compared.

    The share of the target in which every force of some size, above zero, in N, is feasible. Without a force, the
    maximum one that is feasible in every direction everywhere in the target. Directions are those from what the
    space requires, such as the weight of a tool.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.Objective(force=2.0)  # the share of the target with 2 N in every direction
    Objective(force=2.0)
    """

    force: float | None = None
    weights: Floats | None = field(default=None, repr=False, compare=False)
    """Weight of each point of the target; None: equal ones."""
    step: str = field(default="", repr=False, compare=False)
    """How far apart the points are, in words."""

    def __post_init__(self) -> None:
        if self.force is not None and not (np.isfinite(self.force) and self.force > 0):
            raise InputError(f"objective: force is {self.force}; give a force in N above zero, or None")

    def over(self, target: Grid) -> Objective:
        """Return the objective for the points of a grid, of which those in a face of the target count half."""
        weights = functools.reduce(np.multiply.outer, target.weights()).ravel()
        return replace(self, weights=weights, step=describe_step((target.x, target.y, target.z)))

    def score(self, margins: Floats) -> Floats:
        """Return the score (...) of layouts with these capacity margins (..., P), in N, over the target.

        The minimum margin in N, or the share of the target where it is at least the force.
        """
        if self.force is None:
            return np.asarray(margins.min(axis=-1))
        return self._mean(margins >= self.force)

    def merit(self, margins: Floats) -> Floats:
        """Return the rank (...) of layouts with these margins (..., P), in N: the higher the better.

        The minimum margin; or the share, plus a little to rank layouts of the same share: for the force to spare
        at the worst point or, where force is missing, less for the mean of what is missing.
        """
        if self.force is None:
            return self.score(margins)
        spare = np.maximum(margins.min(axis=-1) / self.force - 1, 0.0)
        return self.score(margins) + TIE_WEIGHT * np.asarray(spare - self._mean(self.missing(margins)))

    def smooth(self, margins: Floats, sharpness: float) -> Floats:
        """Return a continuous approximation (...) of the merit for gradients, from margins (..., P), in N.

        The minimum margin, while no force is missing anywhere. Else the share that is lost, but for a sign, with
        ``log(1 + missing / sharpness)`` at each point in place of a count of the points: the smaller
        ``sharpness``, a share of the force, the less it matters how much is missing.

        Source: Candes, Wakin and Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008.
        """
        worst = margins.min(axis=-1)
        if self.force is None:
            return np.asarray(worst)
        lost = self._mean(np.log1p(self.missing(margins) / sharpness))
        return np.asarray(np.where(worst < self.force, -lost, worst))

    def missing(self, margins: Floats) -> Floats:
        """Return the share of the force that is missing at each point, (..., P), 0 or more."""
        return np.zeros_like(margins) if self.force is None else np.maximum(1 - margins / self.force, 0.0)

    def _mean(self, values: Floats | NDArray[np.bool_]) -> Floats:
        """Return the mean (...) of values (..., P) over the target."""
        return np.asarray(values.mean(axis=-1) if self.weights is None else values @ self.weights)

    def describe(self, rig: Rig, score: float | None = None) -> str:
        """Return in words what the score of a rig is, or what a rig with a score renders, after its name."""
        about = f" about {rig.required.describe(rig)}" if rig.required else ""
        points = f" (points {self.step})" if self.step else ""
        if score is None and self.force is None:
            return f"the maximum force in N in every direction{about}, everywhere in the target"
        if score is None:
            return f"the share of the target{points} with {self.force:g} N in every direction{about}"
        if self.force is None:
            return f"renders {max(score, 0.0):.4g} N in every direction{about} throughout the target"
        return f"renders {self.force:g} N in every direction{about} in {format_share(score)} of the target{points}"


def target_margins(space: Space, anchors: Floats, limits: TensionLimits, target: Floats) -> Floats:
    """Return the capacity margins of layouts about the required wrenches, (..., P), in N, at points of the target.

    ``anchors`` are (..., m, d) in the world, ``target`` is (P, d), both in m.
    """
    flat = anchors.reshape(-1, *anchors.shape[-2:])
    found = np.empty((len(flat), len(target)))
    required = space.required_forces
    rows = max(1, MAX_CHUNK_POINTS // len(target))
    for start in range(0, len(flat), rows):
        _, directions = kinematics.cables(flat[start : start + rows, None], target, None)
        structure = kinematics.structure_matrix(directions, None)
        found[start : start + rows] = capacity_margin(structure, limits, required)
    return found.reshape(*anchors.shape[:-2], len(target)) - space.required.ball


def target_slopes(space: Space, places: Placement, limits: TensionLimits, target: Floats) -> tuple[Floats, Floats]:
    """Return the margins (P,) of one layout, in N, and their slopes (P, k, d), in N per length of an edge."""
    lengths, directions = kinematics.cables(space.anchors(places), target, None)
    found = margin_gradient(kinematics.structure_matrix(directions, None), limits, space.required_forces)
    by_anchor = kinematics.anchor_gradient(found.structure, lengths[..., None] * directions, None)
    edges = space.placed.edges[places.surfaces]
    put = by_anchor[:, : len(places.surfaces)]
    return found.margin - space.required.ball, np.einsum("pkd,ked->pke", put, edges)
