"""Continuity of a solver along a path: the height of its jumps, and its rate where it has none."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tensionlab.allocation import Allocation, Allocator
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.trajectory import turn_by, turns_between
from tensionlab.workspace.poses import PoseList

SEARCHED = 16  # steps that are halved, the largest
HALVINGS = 17  # to 1e-5 of a step: what changes faster is a jump to any motor
MIN_JUMP_N = 0.01

PathFunction = Callable[[Floats], tuple[Floats, Floats]]  # structure matrices and wrenches at path parameters (S,)


class Continuity(NamedTuple):
    """Largest jumps of a tension, 0 if there are none, and the largest change where there is none, in N."""

    jump: float  # of feasible wrenches
    beyond: float  # of all wrenches; NaN without a policy for infeasible ones
    step: float  # from one sample to the next, of feasible wrenches between which nothing jumps


def path_of(rig: Rig, position: Floats, rotation: Floats | None, wrench: Floats) -> PathFunction:
    """Return the path through poses and wrenches of K samples, (K, d) and (K, n), straight from each to the next.

    Its parameter is 0 at the first sample, K - 1 at the last. Between two orientations it turns about one axis.
    """
    turns = np.pad(turns_between(PoseList(position, rotation)), ((0, 1), (0, 0)))  # a single sample has none

    def at(parameter: Floats) -> tuple[Floats, Floats]:
        first = np.minimum(parameter.astype(int), max(len(position) - 2, 0))
        second = np.minimum(first + 1, len(position) - 1)
        share = (parameter - first)[:, None]

        def between(values: Floats) -> Floats:
            return np.asarray(values[first] + share * (values[second] - values[first]))

        turned = None if rotation is None else turn_by(rotation[first], share * turns[first])
        return rig.structure_matrix(between(position), turned, rig.at_rest), between(wrench)

    return at


def measure_continuity(allocator: Allocator, path: PathFunction, found: Allocation) -> Continuity:
    """Measure jumps and changes of a solver's tensions along a path, given those found at 0, 1 and so on."""
    jump, step = _largest(allocator, path, found, feasible=True)
    beyond = _largest(allocator, path, found, feasible=False)[0] if allocator.policy else np.nan
    return Continuity(jump, beyond, step)


def _largest(
    allocator: Allocator, path: PathFunction, found: Allocation, *, feasible: bool
) -> tuple[float, float]:
    """Return the largest jump, and the largest step without one, of exact answers or of all.

    The largest steps are halved again and again, always keeping the half in which the tensions change more: what
    vanishes was a fast change, what stays is a jump.
    """

    def tensions(found: Allocation) -> Floats:
        return np.where(found.exact[:, None], found.tensions, np.nan) if feasible else found.tensions

    grid = tensions(found)
    steps = abs(np.diff(grid, axis=0)).max(axis=1)
    known = np.flatnonzero(np.isfinite(steps))
    if not known.size:
        return 0.0, 0.0
    largest = known[np.argsort(-steps[known])[:SEARCHED]]
    low, high, start, end = largest.astype(float), largest + 1.0, grid[largest], grid[largest + 1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        between = tensions(allocator(*path(middle)))
        first_half = abs(between - start).max(axis=1) >= abs(end - between).max(axis=1)
        low, high = np.where(first_half, low, middle), np.where(first_half, middle, high)
        start, end = np.where(first_half[:, None], start, between), np.where(first_half[:, None], between, end)
    heights = abs(end - start).max(axis=1)
    jumps = heights > MIN_JUMP_N  # false where the path leaves what is feasible
    steps[largest[jumps]] = 0.0
    return float(heights[jumps].max(initial=0.0)), float(np.nanmax(steps))
