"""Local optimization of a layout: `polish`."""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.module import TensionLimits
from tensionlab.workspace.layout.objective import Objective, target_slopes
from tensionlab.workspace.layout.space import Places, Space

INITIAL_STEP = 0.1
MAX_STEP = 0.3
MIN_STEP = 1e-4
"""How far a module may move in one step, as a share of an edge."""
MAX_STEPS = 80
"""30 are usual."""
MIN_GAIN = 1e-9
CLOUD_POINTS = 100
"""To surround small targets with."""
CLOUD_RADIUS_M = 1e-3
"""From the target."""
SHARPNESS = (1.0, 0.1, 0.01)
"""From blunt to sharp: how closely shares are followed. Blunt ones lead further, sharp ones count right."""


def polish(
    space: Space, target: Floats, objective: Objective, places: Places, limits: TensionLimits
) -> tuple[Places, Floats]:
    """Return the best layout near a given one, with every module on its surface.

    The margins are not smooth where two facets or two points of the target are equally bad, which is where the
    best layouts are. So each step takes all margins as linear in the places, finds the best places within a trust
    region by a linear program, and keeps them if the objective rises; if not, the region shrinks. A margin has a
    slope for each of its nearest facets, so small targets are surrounded by a cloud of points that show them.

    Source: Conn, Gould and Toint, "Trust-region methods", 2000, chapter 11, for such sequences of linear programs;
    Burke, Lewis and Overton, "A robust gradient sampling algorithm for nonsmooth, nonconvex optimization", 2005,
    for the cloud.

    ``target`` is (P, d), in m; ``limits`` are those of all modules, the fixed ones last. Returned are the places
    and their margins (P,), in N, whose merit is never below that of the given places.
    """
    cloud, own = _cloud(target), len(target)
    margins, gradient = target_slopes(space, places, limits, cloud)
    for sharpness in SHARPNESS if objective.force is not None else SHARPNESS[:1]:
        radius = INITIAL_STEP
        for _ in range(MAX_STEPS):
            low = np.maximum(-radius, -places.along)
            high = np.minimum(radius, 1.0 - places.along)
            step = _best_step(objective, margins, gradient, low, high, sharpness)
            ahead = Places(places.surfaces, np.clip(places.along + step, 0.0, 1.0))
            new_margins, new_gradient = target_slopes(space, ahead, limits, cloud)
            gain = objective.smooth(new_margins[:own], sharpness) - objective.smooth(margins[:own], sharpness)
            if gain > MIN_GAIN:
                places, margins, gradient = ahead, new_margins, new_gradient
                radius = min(2 * radius, MAX_STEP)
            else:
                radius /= 4
                if radius < MIN_STEP:
                    break
    return places, margins[:own]


def _cloud(target: Floats) -> Floats:
    """Return the target, and if it has few points more of them in random directions from each."""
    copies = CLOUD_POINTS // len(target)
    away = np.random.default_rng(0).normal(size=(copies, *target.shape))
    away *= CLOUD_RADIUS_M / np.linalg.norm(away, axis=-1, keepdims=True)
    return np.concatenate([target, (target + away).reshape(-1, target.shape[1])])


def _best_step(
    objective: Objective, margins: Floats, gradient: Floats, low: Floats, high: Floats, sharpness: float
) -> Floats:
    """Return the best step between two bounds, (k, d), if margins were linear: margins + gradient . step.

    While force is missing somewhere in the target, the step that minimises the missing total; else the step that
    maximises the worst margin.
    """
    from scipy.optimize import linprog

    slope = gradient.reshape(len(margins), -1)
    lowest = margins + np.minimum(slope * low.ravel(), slope * high.ravel()).sum(axis=1)
    bounds: list[tuple[float | None, float | None]] = [*zip(low.ravel(), high.ravel(), strict=True)]
    if objective.force is not None and (margins < objective.force).any():
        rows = lowest < objective.force  # the others have enough after any step
        count = int(rows.sum())
        # unknown: step, missing >= 0; margins + slope step + missing >= force
        matrix = np.hstack([-slope[rows], -np.eye(count)])
        bound = margins[rows] - objective.force
        cost = np.concatenate([np.zeros(slope.shape[1]), 1 / (sharpness + objective.missing(margins[rows]))])
        bounds += [(0.0, None)] * count
    else:
        highest = margins + np.maximum(slope * low.ravel(), slope * high.ravel()).sum(axis=1)
        rows = lowest <= highest.min()  # the others are the worst after no step
        # unknown: step, worst; margins + slope step >= worst
        matrix = np.hstack([-slope[rows], np.ones((int(rows.sum()), 1))])
        bound = margins[rows]
        cost = np.append(np.zeros(slope.shape[1]), -1.0)
        bounds.append((None, None))
    # Unscaled and small: presolving takes longer than solving.
    found = linprog(cost, A_ub=matrix, b_ub=bound, bounds=bounds, method="highs", options={"presolve": False})
    if found.x is None:
        return np.zeros_like(low)
    step: Floats = found.x[: low.size].reshape(low.shape)
    return step
