"""Proof of the force that a layout renders everywhere in the box around its target."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np

from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace.certification.certify import certify
from tensionlab.workspace.layout.results import Layout

STEPS = 64  # number of finest cells along the longest edge
BISECTIONS = 8  # number of bisections of a force, which find it to less than half a percent
MAX_CANDIDATES = 5  # largest number of layouts that are proved; later ones are worse


def proved_force(rig: Rig, target: Floats, most: float) -> float:
    """Return the force in N, up to the most, that is proved of all positions in the box around a target (P, d).

    In every direction about what is required of the rig. NaN if not even that is proved, without a force.
    """
    region = np.stack([target.min(axis=0), target.max(axis=0)], axis=1)
    edge = float(np.ptp(region, axis=1).max())

    def proved(force: float) -> bool:
        required = replace(rig.required, ball=rig.required.ball + force)
        return certify(rig, region, required, edge / STEPS).proved

    if not most >= 0 or (edge and not proved(0.0)):
        return float("nan")
    if not edge or proved(most):  # a single position is what the search itself looks at
        return most
    low, high = 0.0, most
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if proved(middle) else (low, middle)
    return low


def most_proved(layouts: Iterable[Layout], target: Floats, force: float | None) -> Layout:
    """Return the layout of which the most is proved, up to a force, if one is given.

    Layouts come the best first. Those are left out that have no more, at the points of the target, than is proved
    of one before them.
    """
    found: list[Layout] = []
    for layout in islice(layouts, MAX_CANDIDATES):
        most = layout.worst if force is None else min(force, layout.worst)
        if all(most > _held(each) for each in found):
            found.append(replace(layout, proved=proved_force(layout.rig, target, most)))
    return max(found, key=_held)


def _held(layout: Layout) -> float:
    """Return the force that is proved of a layout, below any other if none is."""
    return -np.inf if layout.proved is None or np.isnan(layout.proved) else layout.proved
