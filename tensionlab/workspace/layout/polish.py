"""From a good layout to the best one near it: `polish`."""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.module import TensionLimits
from tensionlab.workspace.layout import place
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.place import Places
from tensionlab.workspace.layout.space import Space

FIRST_STEP = 0.1
LARGEST_STEP = 0.3
SMALLEST_STEP = 1e-4
"""How far a module may move in one step, as a share of an edge."""
STEPS = 80
"""At most; 30 are usual."""
LEAST_GAIN = 1e-9
CLOUD = 100
"""Points to surround small targets with."""
JITTER = 1e-3
"""How far from the target, in m."""
SHARP = (1.0, 0.1, 0.01)
"""From blunt to sharp: how closely shares are followed. Blunt ones lead further, sharp ones count right."""


def polish(
    space: Space, target: Floats, objective: Objective, places: Places, limits: TensionLimits
) -> tuple[Places, Floats]:
    """Which layout is the best near a given one, with every module on its surface?

    The margins are not smooth where two facets or two points of the target are equally bad, which is where the
    best layouts are. So each step takes all margins as linear in the places, finds the best places within a trust
    region by a linear program, and keeps them if the objective rises; if not, the region shrinks. A margin has a
    slope for each of its nearest facets, so small targets are surrounded by a cloud of points that show them.

    Source: Conn, Gould and Toint, "Trust-region methods", 2000, chapter 11, for such sequences of linear programs;
    Burke, Lewis and Overton, "A robust gradient sampling algorithm for nonsmooth, nonconvex optimization", 2005,
    for the cloud.

    Parameters
    ----------
    space : Space
    target : (P, d) array
        In m.
    objective : Objective
    places : Places
        Of one layout.
    limits : TensionLimits
        Of all modules, the fixed ones last.

    Returns
    -------
    places : Places
    margins : (P,) array
        In N; their merit is never below that of the given places.
    """
    cloud, own = _cloud(target), len(target)
    margins, slopes = place.slopes(space, places, limits, cloud)
    for sharp in SHARP if objective.force is not None else SHARP[:1]:
        radius = FIRST_STEP
        for _ in range(STEPS):
            low = np.maximum(-radius, -places.along)
            high = np.minimum(radius, 1.0 - places.along)
            step = _best_step(objective, margins, slopes, low, high, sharp)
            ahead = Places(places.surfaces, np.clip(places.along + step, 0.0, 1.0))
            new_margins, new_slopes = place.slopes(space, ahead, limits, cloud)
            gain = objective.smooth(new_margins[:own], sharp) - objective.smooth(margins[:own], sharp)
            if gain > LEAST_GAIN:
                places, margins, slopes = ahead, new_margins, new_slopes
                radius = min(2 * radius, LARGEST_STEP)
            else:
                radius /= 4
                if radius < SMALLEST_STEP:
                    break
    return places, margins[:own]


def _cloud(target: Floats) -> Floats:
    """The target, and if it has few points more of them in random directions from each."""
    copies = CLOUD // len(target)
    away = np.random.default_rng(0).normal(size=(copies, *target.shape))
    away *= JITTER / np.linalg.norm(away, axis=-1, keepdims=True)
    return np.concatenate([target, (target + away).reshape(-1, target.shape[1])])


def _best_step(
    objective: Objective, margins: Floats, slopes: Floats, low: Floats, high: Floats, sharp: float
) -> Floats:
    """The best step between two bounds, (k, d), if margins were linear: margins + slopes . step.

    While force is missing somewhere in the target, the step that leaves the least missing in total; else the step
    to the largest worst margin.
    """
    from scipy.optimize import linprog

    slope = slopes.reshape(len(margins), -1)
    lowest = margins + np.minimum(slope * low.ravel(), slope * high.ravel()).sum(axis=1)
    bounds: list[tuple[float | None, float | None]] = [*zip(low.ravel(), high.ravel(), strict=True)]
    if objective.force is not None and (margins < objective.force).any():
        rows = lowest < objective.force  # the others have enough after any step
        count = int(rows.sum())
        # unknown: step, missing >= 0; margins + slope step + missing >= force
        matrix = np.hstack([-slope[rows], -np.eye(count)])
        bound = margins[rows] - objective.force
        cost = np.concatenate([np.zeros(slope.shape[1]), 1 / (sharp + objective.missing(margins[rows]))])
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
