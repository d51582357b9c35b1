"""Proof of the force that a layout renders between the positions of its targets, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace.certification import certify
from tensionlab.workspace.interference import with_bodies
from tensionlab.workspace.layout.objective import Objective, Target
from tensionlab.workspace.poses import Grid

PROOF_CELLS = 64  # number of finest cells of a proof along the longest edge of a target
BISECTIONS = 8  # of a proved force, down to half a percent


def proved_force(rig: Rig, targets: tuple[Target, ...], objective: Objective, most: float) -> float:
    """Return the force in N, up to ``most``, that is proved in the objective's directions throughout targets.

    Of a grid it is proved in its box, of a path along the straight lines between its positions. It is counted from
    the required wrenches of the rig; NaN if not even those are proved.
    """
    rig = with_bodies(rig, ())  # the search has proved the clearance
    corners = rig.required.at(rig)

    def proved(force: float) -> bool:
        if objective.directions is None:
            required = replace(rig.required, ball=rig.required.ball + force)
        else:
            pushed = corners + force * np.array(objective.directions)[:, None]
            wrenches = np.concatenate([corners, pushed.reshape(-1, rig.n)])
            required = Requirement(wrenches=wrenches, ball=rig.required.ball)
        return all(_holds(rig, each, required) for each in targets)

    if not most >= 0 or not proved(0.0):
        return float("nan")
    if proved(most):
        return most
    low, high = 0.0, most
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if proved(middle) else (low, middle)
    return low


def _holds(rig: Rig, target: Target, required: Requirement) -> bool:
    """Whether it is proved that all that is required is feasible throughout a target."""
    points = target.arrays()[0]
    finest = float(np.ptp(points, axis=0).max()) / PROOF_CELLS
    if not finest:  # the search itself evaluates a single position
        return True
    if isinstance(target, Grid):
        region = np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
        return certify(rig, region, required, finest).proved
    return _holds_along(rig, points, required, finest)


def _holds_along(rig: Rig, path: Floats, required: Requirement, finest: float) -> bool:
    """Whether it is proved for the box around a path or, down to the finest, those around its halves."""
    region = np.stack([path.min(axis=0), path.max(axis=0)], axis=1)
    longest = float(np.ptp(path, axis=0).max())
    if not longest or certify(rig, region, required, 2 * longest).proved:
        return True
    if len(path) == 2:
        if longest <= finest:
            return False
        path = np.stack([path[0], path.mean(axis=0), path[1]])
    middle = len(path) // 2
    return all(_holds_along(rig, part, required, finest) for part in (path[: middle + 1], path[middle:]))
