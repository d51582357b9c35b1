"""Objective of a layout search, the capacity margins that it scores, and the results: `Layout`, `LayoutSearch`."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import InputError
from tensionlab.model import kinematics
from tensionlab.model.files import rig_to_toml
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_range, format_share
from tensionlab.support.table import Column, Table
from tensionlab.workspace.layout.space import Placement, Space
from tensionlab.workspace.poses import Grid, describe_step
from tensionlab.workspace.wrench_set import capacity_margin, margin_gradient

TIE_WEIGHT = 0.1  # of missing or spare force, relative to the share: enough to lead a search among equals
MAX_CHUNK_POINTS = 50_000  # points of layouts that are evaluated together; it bounds the memory


@dataclass(frozen=True)
class Objective:
    """Criterion by which layouts are compared: the share of the target with a force in N in every direction.

    Without a force, it is the maximum one that is feasible in every direction everywhere in the target. Directions
    are those from what the space requires, such as the weight of a tool.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.Objective(force=2.0)  # the share of the target with 2 N in every direction
    Objective(force=2.0)
    """

    force: float | None = None
    weights: Floats | None = field(default=None, repr=False, compare=False)  # of the points; None: equal ones
    step: str = field(default="", repr=False, compare=False)  # how far apart the points are, in words

    def __post_init__(self) -> None:
        if self.force is not None and not (np.isfinite(self.force) and self.force > 0):
            raise InputError(f"objective: force is {self.force}; give a force in N above zero, or None")

    def over(self, target: Grid) -> Objective:
        """Return the objective for the points of a grid, of which those in a face of the target count half."""
        weights = functools.reduce(np.multiply.outer, target.weights()).ravel()
        return replace(self, weights=weights, step=describe_step((target.x, target.y, target.z)))

    def score(self, margins: Floats) -> Floats:
        """Return the score (...) of layouts with these capacity margins (..., P), in N, over the target."""
        return np.asarray(margins.min(axis=-1)) if self.force is None else self._mean(margins >= self.force)

    def merit(self, margins: Floats) -> Floats:
        """Return the score (...), with a little to rank layouts of the same share, from margins (..., P), in N.

        More for the force to spare at the worst point or, where force is missing, less for the mean of that.
        """
        if self.force is None:
            return self.score(margins)
        spare = np.maximum(margins.min(axis=-1) / self.force - 1, 0.0)
        return self.score(margins) + TIE_WEIGHT * np.asarray(spare - self._mean(self.missing(margins)))

    def smooth(self, margins: Floats, sharpness: float) -> Floats:
        """Return a continuous approximation (...) of the merit for gradients, from margins (..., P), in N.

        The minimum margin, while no force is missing. Else minus the share that is lost, with ``log(1 + missing /
        sharpness)`` for each point: the smaller ``sharpness``, the less it matters how much is missing.

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
        where = "in every direction" + (f" about {rig.required.describe(rig)}" if rig.required else "")
        points = f" (points {self.step})" if self.step else ""
        if self.force is None:
            if score is None:
                return f"the maximum force in N {where}, everywhere in the target"
            return f"renders {max(score, 0.0):.4g} N {where} throughout the target"
        if score is None:
            return f"the share of the target{points} with {self.force:g} N {where}"
        return f"renders {self.force:g} N {where} in {format_share(score)} of the target{points}"


def target_margins(space: Space, anchors: Floats, limits: TensionLimits, target: Floats) -> Floats:
    """Return the capacity margins (..., P), in N, of layouts of anchors (..., m, d) at points (P, d), in m."""
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


@dataclass(frozen=True)
class Layout:
    """Rig with modules on the surfaces of a space, and its score.

    Attributes
    ----------
    rig : Rig
        The modules that were placed, in the order of their surfaces, and the fixed ones last.
    score : float
        Score by the objective: a share, or a margin in N.
    worst : float
        Force in N that is feasible in every direction everywhere in the target; below zero where none is.
    contributions : tuple of float
        For each module, the score lost when it is removed and the others stay: all of it, and never more, where
        they render no force at all. Below zero where they do better without it.
    proved : float or None
        Force in N that is proved feasible in every direction everywhere in the box around the target, up to that
        of the objective; NaN where none is, None where no proof was wanted.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.Layout(tl.load_rig("floor-3"), score=1.2, worst=1.2, contributions=(1.2, 0.9, 1.1))
    <Layout of floor-3: 3 modules, score 1.2, worst margin 1.2 N>
    """

    rig: Rig
    score: float
    worst: float
    contributions: tuple[float, ...]
    proved: float | None = None

    def __repr__(self) -> str:
        return f"<Layout of {self._title}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return the table of the modules, with the score that is lost without each."""
        rows = [
            [module.name, module.frame, module.anchor.round(4), lost]
            for module, lost in zip(self.rig.modules, self.contributions, strict=True)
        ]
        return Table(["module", "frame", Column("anchor", "m"), "score lost without it"], rows, self._title)

    @property
    def _title(self) -> str:
        return f"{self.rig.name}: {self.rig.m} modules, score {self.score:.4g}, worst margin {self.worst:.4g} N"

    def to_toml(self) -> str:
        """Return the rig file, with the score and the contributions as comments."""
        lines = [f"# Score {self.score:.6g}, worst margin {self.worst:.6g} N. Score lost without each module:"]
        if self.proved is not None:
            lines.insert(0, f"# Proved everywhere in the target: {self.proved:.6g} N in every direction.")
        for module, lost in zip(self.rig.modules, self.contributions, strict=True):
            lines.append(f"#   {module.name}: {lost:.6g}")
        return "\n".join([*lines, "", rig_to_toml(self.rig)])


@dataclass(frozen=True)
class LayoutSearch:
    """Layouts that a search found, one for each number of modules, the fewest first.

    Examples
    --------
    >>> import tensionlab as tl
    >>> found = [tl.workspace.Layout(tl.load_rig(name), 1.2, 1.2, ()) for name in ("floor-3", "cube-8")]
    >>> tl.workspace.LayoutSearch(tl.workspace.Objective(), tuple(found)).best.rig.name
    'floor-3'
    """

    objective: Objective
    layouts: tuple[Layout, ...]

    def __repr__(self) -> str:
        counts = format_range([layout.rig.m for layout in self.layouts])
        return f"<LayoutSearch for {counts} modules: the best has {self.best.rig.m}, score {self.best.score:.4g}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_() + self.best._repr_html_()

    def table(self) -> Table:
        """Return the table of the layouts, by their number of modules."""
        rows = [[each.rig.m, each.score, each.worst, each in self.front] for each in self.layouts]
        columns = ["modules", "score", Column("worst margin", "N"), "better than with fewer"]
        return Table(columns, rows, f"score: {self.describe()}")

    def describe(self) -> str:
        """Return the meaning of the score in words."""
        return self.objective.describe(self.best.rig)

    @property
    def front(self) -> tuple[Layout, ...]:
        """Layouts that no other beats with as many modules or fewer: what each further module buys."""
        best: list[Layout] = []
        for layout in self.layouts:
            if not best or layout.score > best[-1].score:
                best.append(layout)
        return tuple(best)

    @property
    def best(self) -> Layout:
        """The layout with the highest score; of equals, the one with the fewest modules."""
        return self.front[-1]
