"""Polishing of a layout: the best places near given ones, by a sequence of linear programs."""

from __future__ import annotations

import numpy as np

from tensionlab.support.arrays import Floats, Integers
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.problem import LayoutProblem, Linear
from tensionlab.workspace.layout.space import Placement

INITIAL_STEP, MIN_STEP, MAX_STEP = 0.1, 1e-4, 0.3  # trust region: how far modules move, as a share of an edge
MAX_STEPS = 80  # in a trust region; 30 are usual
MIN_GAIN = 1e-9  # of the objective, for a step to be kept
CLOUD_POINTS = 100  # points that surround a small target
CLOUD_RADIUS_M = 1e-3  # distance of the cloud from the target
SHARPNESS = (1.0, 0.1, 0.01)  # how closely shares are followed: blunt ones lead further, sharp ones count right
COST_PER_METRE = 1e6  # of a margin that is not kept: any gain is worth less


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
    copies = CLOUD_POINTS // own
    cloud = problem.poses.surround(copies, CLOUD_RADIUS_M, problem.space.length)
    groups = np.zeros(own, np.int64)
    if objective.target_weights is not None and objective.shares is not None:
        groups = (objective.shares > 0).argmax(axis=0)
    here = problem.linear(places, cloud)
    groups = np.tile(groups, (1 + copies) * len(here.values))
    for sharpness in SHARPNESS if objective.level is not None else SHARPNESS[:1]:
        radius = INITIAL_STEP
        for _ in range(MAX_STEPS):
            bounds = np.maximum(-radius, -places.along), np.minimum(radius, 1.0 - places.along)
            step = _best_step(objective, here, groups, bounds, sharpness)
            ahead = Placement(places.surfaces, np.clip(places.along + step, 0.0, 1.0))
            there = problem.linear(ahead, cloud)
            merits = [objective.smooth(each.values[:, :own].min(axis=0), sharpness) for each in (there, here)]
            closer = there.spare.min(initial=0.0) - here.spare.min(initial=0.0)
            if closer > MIN_GAIN or (closer >= 0.0 and merits[0] - merits[1] > MIN_GAIN):
                places, here, radius = ahead, there, min(2 * radius, MAX_STEP)
            else:
                radius /= 4
                if radius < MIN_STEP:
                    break
    return places, here.values[:, :own]


def _best_step(
    objective: Objective, here: Linear, groups: Integers, bounds: tuple[Floats, Floats], sharpness: float
) -> Floats:
    """Return the best step between two bounds, (k, e, d), if all were linear: values + slopes . step.

    It minimises the missing total, while something is missing anywhere; else it maximises the worst value, of each
    target if they have weights. Cables stay clear of bodies, or come as close to that as they can.
    """
    from scipy.optimize import linprog

    values, slope, away, (low, high) = here.values.ravel(), here.slopes, here.spare_slopes, bounds
    lowest = values + _least(slope, low, high)
    if objective.level is not None and (values < objective.level).any():
        rows = lowest < objective.level  # the others have enough after any step
        # unknown: step, missing >= 0; values + slope step + missing >= level
        further, bound = -np.eye(int(rows.sum())), values[rows] - objective.level
        cost, least = 1 / (sharpness + objective.missing(values[rows])), 0.0
        if objective.target_weights is not None:
            cost *= np.array(objective.target_weights)[groups[rows]]
    else:
        highest, weights = values - _least(-slope, low, high), objective.target_weights or (1.0,)
        worst = np.array([highest[groups == group].min() for group in range(len(weights))])
        rows = lowest <= worst[groups]  # the others are the worst after no step
        # unknown: step, worst of each group; values + slope step >= worst
        further, bound = np.eye(len(weights))[groups[rows]], values[rows]
        cost, least = -np.array(weights), None
    matrix = np.hstack([-slope[rows], further])
    limits: list[tuple[float | None, float | None]] = [*zip(low.ravel(), high.ravel(), strict=True)]
    limits += [(least, None)] * further.shape[1]
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
    found = linprog(cost, A_ub=matrix, b_ub=bound, bounds=limits, method="highs", options={"presolve": False})
    step: Floats = np.zeros_like(low) if found.x is None else found.x[: low.size].reshape(low.shape)
    return step


def _least(slopes: Floats, low: Floats, high: Floats) -> Floats:
    """Return the least change (R,) that a step between two bounds makes, by slopes (R, v)."""
    return np.asarray(np.minimum(slopes * low.ravel(), slopes * high.ravel()).sum(axis=1))
