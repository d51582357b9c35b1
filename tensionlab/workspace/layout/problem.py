"""Problem of a layout search: how good and how clear of bodies layouts are, and the slopes of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tensionlab.model import kinematics
from tensionlab.model.module import Module, TensionLimits
from tensionlab.support.arrays import Floats
from tensionlab.workspace.layout.objective import Objective, Target
from tensionlab.workspace.layout.obstacles import GAP_M, Obstacles
from tensionlab.workspace.layout.results import Layout, Nearest
from tensionlab.workspace.layout.space import Placement, Space
from tensionlab.workspace.wrench_set import margin_gradient

MAX_CHUNK_POINTS = 50_000  # points of layouts that are evaluated together; it bounds the memory
SLOPE_STEP = 1e-6  # share of an edge by which modules are moved to find slopes
DECIMALS = 6  # coordinates are rounded to micrometres
AMPLE_M = 0.1  # distance beyond a margin that need not be known closely
SPARE_M = GAP_M + 2 * 10.0**-DECIMALS  # kept to a margin while searching: errors of a distance and of rounding


class Linear(NamedTuple):
    """Values (C, P) and spare distances (q,) from bodies, and their slopes (C P, k d) and (q, k d) per edge."""

    values: Floats
    slopes: Floats
    spare: Floats
    spare_slopes: Floats


class LayoutProblem(NamedTuple):
    """Space, targets and the positions (P, d) of the hand in these, objective, and bodies if there are any."""

    space: Space
    targets: tuple[Target, ...]
    points: Floats
    objective: Objective
    obstacles: Obstacles | None

    @classmethod
    def of(cls, space: Space, targets: Sequence[Target], objective: Objective) -> LayoutProblem:
        """Return the problem; RigError if the hand or a fixed module is closer to a body than its margin."""
        obstacles = None
        if space.bodies:
            obstacles = Obstacles.of(space.bodies, targets, space.one_module.at_rest)
            obstacles.require_clear(space.placed.fixed, [module.name for module in space.fixed])
        points = np.concatenate([each.arrays()[0] for each in targets])
        return cls(space, tuple(targets), points, objective.over(targets), obstacles)

    def values(self, anchors: Floats, limits: TensionLimits | None = None, points: Floats | None = None) -> Floats:
        """Return `Objective.values` (..., C, P) of layouts of anchors (..., m, d), at all points or others."""
        points = self.points if points is None else points
        limits = limits or self.space.tension_limits(anchors.shape[-2] - len(self.space.fixed))
        flat, required, found = anchors.reshape(-1, *anchors.shape[-2:]), self.space.required, []
        rows = max(1, MAX_CHUNK_POINTS // len(points))
        for start in range(0, len(flat), rows):
            _, directions = kinematics.cables(flat[start : start + rows, None], points, None)
            structure = kinematics.structure_matrix(directions, None)
            found.append(self.objective.values(structure, limits, self.space.required_forces, required.ball))
        values = np.moveaxis(np.concatenate(found, axis=1), 0, 1)
        return values.reshape(*anchors.shape[:-2], *values.shape[1:])

    def linear(self, places: Placement, points: Floats) -> Linear:
        """Return the values of a layout and its distances from bodies beyond the margins, and their slopes."""
        k, d = places.along.shape
        anchors, edges = self.space.anchors(places), self.space.placed.edges[places.surfaces]
        if self.objective.directions is None and self.objective.walls is None:
            lengths, directions = kinematics.cables(anchors, points, None)
            structure = kinematics.structure_matrix(directions, None)
            found = margin_gradient(structure, self.space.tension_limits(k), self.space.required_forces)
            by_anchor = kinematics.anchor_gradient(found.structure, lengths[..., None] * directions, None)
            values = (found.margin - self.space.required.ball)[None]
            slopes = np.einsum("pkd,ked->pke", by_anchor[:, :k], edges)
        else:
            steps = SLOPE_STEP * np.concatenate([np.zeros((1, k * d)), np.eye(k * d)]).reshape(-1, k, d)
            surfaces = np.broadcast_to(places.surfaces, (len(steps), k))
            moved = self.values(self.space.anchors(Placement(surfaces, places.along + steps)), points=points)
            values, slopes = moved[0], np.moveaxis(moved[1:] - moved[0], 0, -1) / SLOPE_STEP
        spare, push = np.zeros((0, d)), np.zeros((k, 0, d))
        if self.obstacles is not None:
            spare, push = self.obstacles.slopes(anchors[:k])
            spare = spare - self.obstacles.margin - SPARE_M
        own = np.einsum("kbd,ked,kj->kbje", push, edges, np.eye(k))
        return Linear(values, slopes.reshape(-1, k * d), spare.ravel(), own.reshape(-1, k * d))

    def spare(self, places: Placement) -> Floats:
        """Return the least distance (..., k) of each module's cables from bodies beyond the margins, in m."""
        if self.obstacles is None:
            return np.zeros(places.surfaces.shape)
        anchors = self.space.anchors(places)[..., : places.surfaces.shape[-1], :]
        distance = self.obstacles.slopes(anchors, AMPLE_M)[0]
        return np.asarray((distance - self.obstacles.margin).min(axis=-1) - SPARE_M)

    def rank(self, places: Placement, values: Floats) -> tuple[float, float, float]:
        """Return the rank of a layout with values (C, P): its clearance of bodies, score and merit, in turn."""
        least = values.min(axis=-2)
        spare = float(self.spare(places).clip(max=0.0).sum())
        return spare, float(self.objective.score(least)), float(self.objective.merit(least))

    def evaluate(self, places: Placement, name: str) -> Layout:
        """Return the rig of a layout, its score, its clearance, and the contribution of each module."""
        space, objective = self.space, self.objective
        order = np.lexsort((*places.along.T[::-1], places.surfaces))
        places = Placement(places.surfaces[order], places.along[order])
        modules = (*_modules(space, places), *space.fixed)
        limits = space.tension_limits(len(places.surfaces))
        anchors = space.anchors(places).round(DECIMALS)
        score = float(objective.score(self.values(anchors).min(axis=-2)))
        lost = []
        for index in range(len(modules)):
            others, without = np.arange(len(modules)) != index, 0.0
            if others.any():
                fewer = TensionLimits(limits.lower[others], limits.upper[others])
                without = float(objective.score(self.values(anchors[others], fewer).min(axis=-2)))
            lost.append(max(score, 0.0) - max(without, 0.0))  # no force is less than none
        worst = self._replace(objective=Objective()).values(anchors).min()
        rig = space.rig(name, modules, self.points.mean(axis=0).round(DECIMALS) + 0.0)
        rig = replace(rig, description=f"A layout found by search: it {objective.describe(rig, score)}.")
        return Layout(rig, score, float(worst), tuple(lost), nearest=self._nearest(anchors, modules))

    def _nearest(self, anchors: Floats, modules: Sequence[Module]) -> Nearest | None:
        """Return the module and the body that come closest, relative to its margin."""
        if self.obstacles is None:
            return None
        distance = self.obstacles.slopes(anchors)[0]
        module, body = divmod(int(np.argmin(distance - self.obstacles.margin)), distance.shape[1])
        margin = float(self.obstacles.margin[body])
        return Nearest(modules[module].name, self.obstacles.names[body], float(distance[module, body]), margin)


def _modules(space: Space, places: Placement) -> list[Module]:
    """Return modules with names after their surfaces, in the axes of their own frames."""
    modules: list[Module] = []
    taken = {module.name for module in space.fixed}
    for index, along in zip(places.surfaces, places.along, strict=True):
        surface = space.surfaces[index]
        number = 1
        while f"{surface.name} {number}" in taken:
            number += 1
        name = f"{surface.name} {number}"
        taken.add(name)
        anchor = (surface.corner + along[: len(surface.edges)] @ surface.edges).round(DECIMALS) + 0.0
        modules.append(Module(name, anchor, *space.limits, frame=surface.frame, **space.hardware))
    return modules
