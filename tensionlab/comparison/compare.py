"""Which solver to trust on a rig: what each renders of a set of forces, how far off it is, what it costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.allocation import Allocation, Allocator
from tensionlab.arrays import Floats
from tensionlab.comparison.scores import Score, finite, score
from tensionlab.errors import ShapeError
from tensionlab.model import directions as direction_sets
from tensionlab.model.rig import Rig
from tensionlab.solvers import make, select_solvers
from tensionlab.solvers.base import POLICIES, Nearest, Status

TIMED_CALLS = 200
"""At most so many vectors are timed one by one, evenly spread over the set."""

TURN = 10
"""Calls that one solver makes before the next one has its turn."""


@dataclass(frozen=True)
class Row(Score):
    """What one solver did with one policy, on so many vectors; NaN where nothing was measured.

    Attributes
    ----------
    gap_max : float
        Largest difference of a tension to the exact optimum of the same policy, in N. For a solver without a
        policy, over the vectors within reach only: out of reach it promises nothing to compare with.
    call_median_s, call_p99_s : float
        Time of one `Allocator` call for one vector, measuring and proving included: median, 99 % quantile.
    batch_s : float
        Time of one `Allocator` call for all vectors, divided by their number.
    """

    gap_max: float
    call_median_s: float
    call_p99_s: float
    batch_s: float


@dataclass(frozen=True)
class Comparison:
    """Every solver on one rig, at one position, with one set of wrenches.

    Attributes
    ----------
    rig : Rig
        The rig, with body frames at rest.
    position : (d,) array
        Where it was pulled, in m.
    structure : (n, m) array
        Structure matrix there.
    wrenches : (K, n) array
        Desired wrenches in N (and N·m).
    rows : tuple of Row
        One a solver and policy.
    allocations : tuple of Allocation
        The answers behind each row, for K wrenches.
    missing : dict of str to str
        Solvers left out, and why.
    """

    rig: Rig
    position: Floats
    structure: Floats
    wrenches: Floats
    rows: tuple[Row, ...]
    allocations: tuple[Allocation, ...]
    missing: dict[str, str]


def compare(
    rig: Rig,
    *,
    position: ArrayLike | None = None,
    directions: ArrayLike | None = None,
    magnitude: float = 1.5,
    solvers: Sequence[str] | None = None,
    nearest: Nearest | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Which solver to trust on this rig: all of them on the same forces, measured alike.

    Every row is the same `Allocator`, so the same measure and the same proof. The optimum that `gap_max`
    refers to is newton's answer for the same policy. The solvers are timed in turns of a few calls, so that a
    slow moment of the machine hits all of them.

    Parameters
    ----------
    rig : Rig
        The rig; body frames at rest.
    position : (d,) array, optional
        Where to pull, in m; None for the rig's home.
    directions : (K, d) array, optional
        Unit vectors; None for `grid18`, or `circle` for a planar rig.
    magnitude : float
        Size of each force in N. 1.5 N is the published validation's.
    solvers, nearest
        As in `select_solvers`.
    progress : callable, optional
        Told the share of the work that is done, from 0 to 1.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError, UnknownSolver, MissingDependency
        As `select_solvers`; ShapeError if position or directions do not fit the rig.
    """
    runs, missing = select_solvers(solvers, nearest, (rig.n, rig.m))
    place = rig.home if position is None else np.asarray(position, dtype=np.float64)
    structure = rig.structure_matrix(place, frames=rig.at_rest)
    if directions is None:
        directions = direction_sets.grid18() if rig.dimension == 3 else direction_sets.circle()
    if not (np.isfinite(magnitude) and magnitude > 0):
        raise ShapeError(f"magnitude {magnitude} is no size of a force; give newtons above 0")
    forces = magnitude * np.asarray(directions, dtype=np.float64)
    wrenches = direction_sets.forces(forces, rig.n, rig.dimension)
    allocators = [Allocator(rig.limits, make(name), nearest=policy) for name, policy in runs]

    def seconds(allocator: Allocator, wrench: Floats) -> float:
        start = time.perf_counter()
        allocator(structure, wrench)
        return time.perf_counter() - start

    chosen = np.unique(np.linspace(0, len(wrenches) - 1, min(len(wrenches), TIMED_CALLS)).astype(int))
    steps = len(runs) + len(chosen)
    allocations, batch = [], []
    for done, allocator in enumerate(allocators, start=1):
        # The answers themselves are the warm-up: what is timed is always a repeated call.
        allocations.append(allocator(structure, wrenches))
        batch.append(seconds(allocator, wrenches) / len(wrenches))
        if progress:
            progress(done / steps)
    calls = np.empty((len(chosen), len(runs)))
    for first in range(0, len(chosen), TURN):
        for column, allocator in enumerate(allocators):
            allocator(structure, wrenches[chosen[first]])  # what the others left in the caches is not its fault
            for call in range(first, min(first + TURN, len(chosen))):
                calls[call, column] = seconds(allocator, wrenches[chosen[call]])
        if progress:
            progress((len(runs) + min(first + TURN, len(chosen))) / steps)

    optima = {
        policy: Allocator(rig.limits, "newton", nearest=policy)(structure, wrenches)
        for policy in {policy or POLICIES[0] for _, policy in runs}
    }
    rows = []
    for column, (name, policy) in enumerate(runs):
        found = allocations[column]
        optimum = optima[policy or POLICIES[0]]
        comparable = optimum.status == Status.EXACT if policy is None else np.full(len(wrenches), True)
        row = Row(
            **vars(score(name, policy, wrenches, found, rig.dimension)),
            gap_max=finite(np.max, abs(found.tensions - optimum.tensions)[comparable]),
            call_median_s=float(np.median(calls[:, column])),
            call_p99_s=float(np.quantile(calls[:, column], 0.99)),
            batch_s=batch[column],
        )
        rows.append(row)
    return Comparison(rig, place, structure, wrenches, tuple(rows), tuple(allocations), missing)
