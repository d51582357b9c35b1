"""Problem of a layout search: how good and how clear of bodies layouts are, and the best ones near given ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count as count_from
from typing import NamedTuple

import numpy as np

from tensionlab.errors import InputError
from tensionlab.model import kinematics, pose
from tensionlab.model.module import Module, TensionLimits
from tensionlab.support.arrays import Floats
from tensionlab.workspace.layout.objective import Objective, Target
from tensionlab.workspace.layout.obstacles import GAP_M, Obstacles
from tensionlab.workspace.layout.results import Layout, Nearest
from tensionlab.workspace.layout.space import Placement, Space
from tensionlab.workspace.wrench_set import margin_gradient

MAX_CHUNK_POINTS = 50_000  # points of layouts that are evaluated together; it bounds the memory
SLOPE_STEP = 1e-6  # share of an edge by which cables are moved to find slopes
DECIMALS = 6  # coordinates are rounded to micrometres
AMPLE_M = 0.1  # distance beyond a margin that need not be known closely
SPARE_M = GAP_M + 2 * 10.0**-DECIMALS  # kept to a margin while searching: errors of a distance and of rounding
INITIAL_STEP, MIN_STEP, MAX_STEP = 0.1, 1e-4, 0.3  # trust region: how far modules move, as a share of an edge
MAX_STEPS = 80  # in a trust region; 30 are usual
MIN_GAIN = 1e-9  # of the objective, for a step to be kept
CLOUD_POINTS = 100  # points that surround a small target
CLOUD_RADIUS_M = 1e-3  # distance of the cloud from the target
SHARPNESS = (1.0, 0.1, 0.01)  # how closely shares are followed: blunt ones lead further, sharp ones count right
COST_PER_METRE = 1e6  # of a margin that is not kept: any gain is worth less


class TargetPoses(NamedTuple):
    """Poses of the hand, or of a platform, and what is required there."""

    points: Floats  # (P, d)
    turns: Floats | None  # matrices of a platform, (P, d, d)
    required: Floats  # wrenches (P, k, n) or (1, k, n), torques divided by the length of the space

    def surround(self, copies: int, radius_m: float, length: float) -> TargetPoses:
        """Return these poses and copies that are moved by a radius, and turned by up to that at a length."""
        random, (count, d) = np.random.default_rng(0), self.points.shape
        away = random.normal(size=(copies, count, d))
        away *= radius_m / np.linalg.norm(away, axis=-1, keepdims=True)
        points, turns = np.concatenate([self.points, (self.points + away).reshape(-1, d)]), self.turns
        copies += 1
        if turns is not None:
            angles = radius_m / length * random.uniform(-1.0, 1.0, size=(copies, count, 2 * d - 3))
            angles[0] = 0.0
            small = kinematics.planar_rotation(angles[..., 0]) if d == 2 else kinematics.exponential(angles)
            turns = (small @ turns).reshape(-1, d, d)
        required = self.required if len(self.required) == 1 else np.tile(self.required, (copies, 1, 1))
        return TargetPoses(points, turns, required)


class Linear(NamedTuple):
    """Values and spare distances of a layout, and their slopes by all v shares of edges."""

    values: Floats  # (C, P)
    slopes: Floats  # (C P, v)
    spare: Floats  # distances from bodies beyond the margins, (q,)
    spare_slopes: Floats  # (q, v)


class LayoutProblem(NamedTuple):
    """Where modules may stand, and what layouts are compared by."""

    space: Space
    targets: tuple[Target, ...]
    poses: TargetPoses
    objective: Objective
    obstacles: Obstacles | None

    @classmethod
    def of(cls, space: Space, targets: Sequence[Target], objective: Objective) -> LayoutProblem:
        """Return the problem; RigError if the hand or a fixed module is closer to a body than its margin."""
        if space.attachments and objective.walls is not None:
            raise InputError("objective: walls push a hand, which is a point; leave them out for a platform")
        obstacles = None
        if space.bodies:
            obstacles = Obstacles.of(space.bodies, targets, space.one_module.at_rest)
            obstacles.require_clear(space.placed.fixed[:, 0], [module.name for module in space.fixed])
        d, turns = space.dimension, None
        arrays = [target.arrays() for target in targets]
        points = np.concatenate([positions for positions, _ in arrays])
        if space.attachments:
            turns = np.concatenate([
                np.tile(np.eye(d), (len(positions), 1, 1)) if turn is None else pose.rotations(turn, d, "target")
                for positions, turn in arrays
            ])  # fmt: skip
        angles = np.arctan2(turns[:, 1, 0], turns[:, 0, 0]) if turns is not None and d == 2 else turns
        required = space.required.at(space.one_module, angles) / space.divisors
        return cls(
            space,
            tuple(targets),
            TargetPoses(points, turns, required.reshape(-1, *required.shape[-2:])),
            objective.over(targets),
            obstacles,
        )

    def values(
        self, cables: Floats, limits: TensionLimits | None = None, poses: TargetPoses | None = None
    ) -> Floats:
        """Return `Objective.values` (..., C, P) of layouts of cables (..., m, e, d), at all poses or others."""
        poses = self.poses if poses is None else poses
        limits = limits or self.space.tension_limits(cables.shape[-3] - len(self.space.fixed))
        flat, chunks = cables.reshape(-1, *cables.shape[-3:]), []
        rows = max(1, MAX_CHUNK_POINTS // len(poses.points))
        for start in range(0, len(flat), rows):
            _, directions, arms = _route(flat[start : start + rows, None], poses)
            structure = kinematics.structure_matrix(directions, arms) / self.space.divisors[:, None]
            chunks.append(self.objective.values(structure, limits, poses.required, self.space.required.ball))
        values = np.moveaxis(np.concatenate(chunks, axis=1), 0, 1)
        return values.reshape(*cables.shape[:-3], *values.shape[1:])

    def linear(self, places: Placement, poses: TargetPoses) -> Linear:
        """Return the values of a layout and its distances from bodies beyond the margins, and their slopes."""
        space, shape = self.space, places.along.shape
        (k, e, d), images = shape, space.images
        cables, edges = space.cables(places), space.placed.edges[places.surfaces]
        objective = self.objective
        if objective.directions is None and objective.walls is None and not objective.losses:
            vectors, directions, arms = _route(cables[None], poses)
            divisors = space.divisors[:, None]
            structure = kinematics.structure_matrix(directions, arms) / divisors
            gradient = margin_gradient(structure, space.tension_limits(k * len(images)), poses.required)
            by_structure = gradient.structure / divisors
            by_end = [kinematics.anchor_gradient(by_structure, vectors, arms)]
            if poses.turns is not None:
                by_arm = kinematics.attachment_gradient(by_structure, directions, by_end[0])
                by_end.append(by_arm @ poses.turns)
            values = (gradient.margin - space.required.ball)[None]
            own = np.stack(by_end, axis=-2)[:, : k * len(images)].reshape(-1, k, len(images), e, d)
            slopes = np.einsum("pkgei,gij,kexj->pkex", own, images, edges)
        else:
            steps = SLOPE_STEP * np.concatenate([np.zeros((1, k * e * d)), np.eye(k * e * d)]).reshape(-1, *shape)
            surfaces = np.broadcast_to(places.surfaces, (len(steps), k, e))
            moved = self.values(space.cables(Placement(surfaces, places.along + steps)), poses=poses)
            values, slopes = moved[0], np.moveaxis(moved[1:] - moved[0], 0, -1) / SLOPE_STEP
        spare, spare_slopes = np.zeros(0), np.zeros((0, k * d))
        if self.obstacles is not None:
            distance, push = self.obstacles.slopes(cables[: k * len(images), 0])
            spare = (distance - self.obstacles.margin - SPARE_M).ravel()
            push = push.reshape(k, len(images), -1, d)
            spare_slopes = np.einsum("kgbi,gij,kxj,kl->kgblx", push, images, edges[:, 0], np.eye(k))
        width = k * e * d
        return Linear(values, slopes.reshape(-1, width), spare, spare_slopes.reshape(len(spare), width))

    def spare(self, places: Placement) -> Floats:
        """Return the least distance (..., k) of each cable and its images from bodies beyond the margins, in m."""
        if self.obstacles is None:
            return np.zeros(places.surfaces.shape[:-1])
        *lead, k, _ = places.surfaces.shape
        anchors = self.space.cables(places)[..., : k * len(self.space.images), 0, :]
        distance = self.obstacles.slopes(anchors, AMPLE_M)[0] - self.obstacles.margin
        return np.asarray(distance.reshape(*lead, k, -1).min(axis=-1) - SPARE_M)

    def rank(self, places: Placement, values: Floats) -> tuple[float, float, float]:
        """Return the rank of a layout with values (C, P): its clearance of bodies, score and merit, in turn."""
        lowest = values.min(axis=-2)
        spare = float(self.spare(places).clip(max=0.0).sum())
        return spare, float(self.objective.score(lowest)), float(self.objective.merit(lowest))

    def evaluate(self, places: Placement, name: str) -> Layout:
        """Return the rig of a layout, its score, its clearance, and the contribution of each module."""
        space, objective = self.space, self.objective
        order = np.lexsort((*places.along[:, 0].T[::-1], places.surfaces[:, 0]))
        places = Placement(places.surfaces[order], places.along[order])
        cables = space.cables(places).round(DECIMALS) + 0.0
        modules = (*_modules(space, places, cables), *space.fixed)
        limits = space.tension_limits(len(modules) - len(space.fixed))
        score = float(objective.score(self.values(cables).min(axis=-2)))
        lost = []
        for index in range(len(modules)):
            others, without = np.arange(len(modules)) != index, 0.0
            if others.any():
                fewer = TensionLimits(limits.lower[others], limits.upper[others])
                without = float(objective.score(self.values(cables[others], fewer).min(axis=-2)))
            lost.append(max(score, 0.0) - max(without, 0.0))  # no force is less than none
        worst = self._replace(objective=Objective(losses=objective.losses)).values(cables).min()
        nearest = None
        if self.obstacles is not None:
            distance, margin = self.obstacles.slopes(cables[:, 0])[0], self.obstacles.margin
            at = np.unravel_index(np.argmin(distance - margin), distance.shape)
            names = modules[at[0]].name, self.obstacles.names[at[1]]
            nearest = Nearest(*names, float(distance[at]), float(margin[at[1]]))
        rig = space.rig(name, modules, self.poses.points.mean(axis=0).round(DECIMALS) + 0.0)
        rig = replace(rig, description=f"A layout found by search: it {objective.describe(rig, score)}.")
        return Layout(rig, score, float(worst), tuple(lost), nearest=nearest)


def _route(cables: Floats, poses: TargetPoses) -> tuple[Floats, Floats, Floats | None]:
    """Return vectors to the anchors, directions and arms (..., P, m, d) of cables (..., 1, m, e, d) at poses."""
    arms = None if poses.turns is None else kinematics.rotate(poses.turns, cables[..., 1, :])
    lengths, directions = kinematics.cables(cables[..., 0, :], poses.points, arms)
    return lengths[..., None] * directions, directions, arms


def _modules(space: Space, places: Placement, cables: Floats) -> list[Module]:
    """Return modules with names after their surfaces, in the axes of their own frames, each before its images."""
    modules: list[Module] = []
    taken = {module.name for module in space.fixed}
    for cable, (index, *_) in enumerate(places.surfaces):
        surface = space.surfaces[index]
        own = places.along[cable, 0, : len(surface.edges)] @ surface.edges
        anchor = (surface.corner + own).round(DECIMALS) + 0.0
        name = next(text for number in count_from(1) if (text := f"{surface.name} {number}") not in taken)
        taken.add(name)
        for image in range(len(space.images)):
            ends = cables[cable * len(space.images) + image]
            modules.append(
                Module(
                    f"{name} image {image}" if image else name,
                    ends[0] if image else anchor,
                    *space.limits,
                    attachment=ends[1] if space.attachments else None,
                    frame=surface.frame,
                    **space.hardware,
                )
            )
    return modules


def polish(problem: LayoutProblem, places: Placement) -> tuple[Placement, Floats]:
    """Return the best layout near a given one, with every module on its surface.

    The values are not smooth where two facets or two points of the target are equally bad, as in the best
    layouts. So each step takes all values as linear in the places, finds the best places within a trust region by
    a linear program, and keeps them if the objective rises and no cable comes too close to a body; if not, the
    region shrinks. Small targets are surrounded by a cloud of points, which show the slopes of all the nearest
    facets. Returned are the places and their values (C, P); their merit is never below that of the given places,
    unless those are too close to a body.

    Source: Conn, Gould and Toint, "Trust-region methods", 2000, chapter 11, for such sequences of linear programs;
    Burke, Lewis and Overton, "A robust gradient sampling algorithm for nonsmooth, nonconvex optimization", 2005,
    for the cloud.
    """
    objective, own = problem.objective, len(problem.poses.points)
    cloud = problem.poses.surround(CLOUD_POINTS // own, CLOUD_RADIUS_M, problem.space.length)
    here = problem.linear(places, cloud)
    for sharpness in SHARPNESS if objective.level is not None else SHARPNESS[:1]:
        radius = INITIAL_STEP
        for _ in range(MAX_STEPS):
            bounds = np.maximum(-radius, -places.along), np.minimum(radius, 1.0 - places.along)
            step = _best_step(objective, here, bounds, sharpness)
            ahead = Placement(places.surfaces, np.clip(places.along + step, 0.0, 1.0))
            there = problem.linear(ahead, cloud)
            merits = [objective.smooth(linear.values[:, :own].min(axis=0), sharpness) for linear in (there, here)]
            closer = there.spare.min(initial=0.0) - here.spare.min(initial=0.0)
            if closer > MIN_GAIN or (closer >= 0.0 and merits[0] - merits[1] > MIN_GAIN):
                places, here, radius = ahead, there, min(2 * radius, MAX_STEP)
            else:
                radius /= 4
                if radius < MIN_STEP:
                    break
    return places, here.values[:, :own]


def _best_step(objective: Objective, here: Linear, bounds: tuple[Floats, Floats], sharpness: float) -> Floats:
    """Return the step between two bounds, (k, e, d), that is best for ``values + slopes . step``.

    It minimises the missing total, while something is missing anywhere; else it maximises the worst value. Cables
    stay clear of bodies, or come as close to that as they can.
    """
    from scipy.optimize import linprog

    values, slope, away, (low, high) = here.values.ravel(), here.slopes, here.spare_slopes, bounds
    lowest = values + _least(slope, low, high)
    if objective.level is not None and (values < objective.level).any():
        rows = lowest < objective.level  # the others have enough after any step
        # unknown: step, missing >= 0; values + slope step + missing >= level
        further, bound = -np.eye(int(rows.sum())), values[rows] - objective.level
        cost, lowest_unknown = 1 / (sharpness + objective.missing(values[rows])), 0.0
    else:
        rows = lowest <= (values - _least(-slope, low, high)).min()  # the others are the worst after no step
        # unknown: step, worst; values + slope step >= worst
        further, bound = np.ones((int(rows.sum()), 1)), values[rows]
        cost, lowest_unknown = -np.ones(1), None
    matrix = np.hstack([-slope[rows], further])
    limits: list[tuple[float | None, float | None]] = [*zip(low.ravel(), high.ravel(), strict=True)]
    limits += [(lowest_unknown, None)] * further.shape[1]
    near = here.spare + _least(away, low, high) < 0
    if near.any():
        # one more unknown, the distance that is missing >= 0; spare + slope step + missing >= 0
        body_rows = np.hstack([-away[near], np.zeros((int(near.sum()), further.shape[1]))])
        matrix = np.pad(np.vstack([matrix, body_rows]), ((0, 0), (0, 1)))
        matrix[len(bound) :, -1] = -1.0
        bound, cost = np.append(bound, here.spare[near]), np.append(cost, COST_PER_METRE)
        limits.append((0.0, None))
    cost = np.concatenate([np.zeros(slope.shape[1]), cost])
    # Unscaled and small: presolving takes longer than solving.
    solution = linprog(cost, A_ub=matrix, b_ub=bound, bounds=limits, method="highs", options={"presolve": False})
    step: Floats = np.zeros_like(low) if solution.x is None else solution.x[: low.size].reshape(low.shape)
    return step


def _least(slopes: Floats, low: Floats, high: Floats) -> Floats:
    """Return the least change (R,) that a step between two bounds makes, by slopes (R, v)."""
    return np.asarray(np.minimum(slopes * low.ravel(), slopes * high.ravel()).sum(axis=1))
