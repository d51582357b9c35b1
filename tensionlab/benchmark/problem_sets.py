"""The problem sets of the benchmark: generated from seeds, each with a promise that its construction keeps.

The objective of all of them is the least ``|t|²`` of tensions t inside their limits that render the wrench,
``W t = w``. `datasets/problems/README.md` describes each set.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.benchmark.force_extent import furthest
from tensionlab.benchmark.random_rigs import Stream, near_singular, streams
from tensionlab.benchmark.real_rigs import find_rig, over_workspace, path
from tensionlab.errors import ShapeError
from tensionlab.model.directions import forces, grid18

LOWER, UPPER = 0.5, 6.0
"""Tension limits of a published module, in N."""
STRONG = (0.3, 20.0)
"""Tension limits of a stronger module, in N."""
MAGNITUDE = 1.5
"""Size of the forces of the published validation, in N."""
EDGE = (1e-5, 1e-2)
"""How far wrenches are inside the edge of what is available, as a share of the furthest in their direction."""
BEYOND = (1e-2, 1.0)
"""How far unreachable wrenches are beyond that edge ..."""
FAR = (9.0, 99.0)
"""... and every tenth of them."""
CONDITION = (1e2, 1e7)
"""Condition of the structure matrices of near-singular rigs."""
PATH = (50, 1000)
"""Least and largest number of samples of a path."""


@dataclass(frozen=True)
class Group:
    """Problems of one shape.

    Attributes
    ----------
    label : str
        Such as "m = 8" or "ipanema-1".
    structure : (B, n, m) array
    wrench : (B, n) array
        In N (and N·m).
    lower, upper : (B, m) or (m,) arrays
        Tension limits in N.
    path_mm : (B,) array or None
        Length of the way so far along a trajectory, in mm; consecutive rows are consecutive samples of 1 ms.
        None: the problems have no order.
    """

    label: str
    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    path_mm: Floats | None = None


@dataclass(frozen=True)
class ProblemSet:
    """Problems that test one thing.

    Attributes
    ----------
    name : str
    title : str
        What it is and what it tests, in one line.
    groups : tuple of Group
    reachable : {"all", "none", "mixed"}
        Which wrenches can be rendered, by construction.
    """

    name: str
    title: str
    groups: tuple[Group, ...]
    reachable: Literal["all", "none", "mixed"]


def problem_set(name: str, count: int, seed: int = 0) -> ProblemSet:
    """Which problems does a set hold?

    Parameters
    ----------
    name : str
        A name in `PROBLEM_SETS`.
    count : int
        About so many problems in all, spread evenly over the groups, at least one in each. `published` always
        has 364, and `trajectory` at least 50 a group.
    seed : int
        The same seed gives the same problems.

    Raises
    ------
    ShapeError
        If no set has that name, or count or seed is too small.
    """
    if name not in PROBLEM_SETS:
        raise ShapeError(f"no problem set is called {name!r}; choose one of {', '.join(PROBLEM_SETS)}")
    if count < 1 or seed < 0:
        raise ShapeError(f"problem set {name!r}: count {count} must be 1 or more, and seed {seed} 0 or more")
    return PROBLEM_SETS[name](count, seed)


def _published(count: int, seed: int) -> ProblemSet:
    """182 forces on both readings of the published rig; neither count nor seed changes them."""
    groups = []
    for label, name in (("side 1.0 m", "bartels2026-validation"), ("side 0.3 m", "bartels2026-validation-0.3m")):
        rig = find_rig(name)
        wrench = forces(MAGNITUDE * grid18(), rig.n, rig.dimension)
        structure = np.broadcast_to(rig.structure_matrix(rig.home), (len(wrench), rig.n, rig.m))
        groups.append(Group(label, structure, wrench, rig.limits.lower, rig.limits.upper))
    title = "the published validation: 182 forces of 1.5 N on a rig that renders all and on one that renders 153"
    return ProblemSet("published", title, tuple(groups), "mixed")


def _point(count: int, seed: int) -> ProblemSet:
    """Wrenches of random tensions."""
    drawn = streams("point", [(3, m) for m in range(3, 13)], count, seed)
    groups = tuple(_rendered(stream, stream.rigs()) for stream in drawn)
    return ProblemSet("point", "random point rigs with 3 to 12 cables: the everyday problem", groups, "all")


def _edge(count: int, seed: int) -> ProblemSet:
    """Scaled to just inside the furthest wrench in their direction."""
    groups = []
    for stream in streams("edge", [(3, 3), (3, 4), (3, 6), (3, 8), (3, 12), (6, 8)], count, seed):
        group = _rendered(stream, stream.rigs())
        most = furthest(group.structure, group.wrench, group.lower, group.upper)
        # Never scaled back past the wrench that is known to be available.
        factor = np.maximum(1.0, most * (1.0 - stream.between(EDGE)))
        groups.append(_scaled(group, factor))
    title = "wrenches at most 1 % inside the edge of what is available: nearly every cable is at a limit"
    return ProblemSet("edge", title, tuple(groups), "all")


def _unreachable(count: int, seed: int) -> ProblemSet:
    """Scaled to beyond the furthest wrench in their direction."""
    groups = []
    for stream in streams("unreachable", [(3, 3), (3, 4), (3, 8), (3, 12), (6, 8)], count, seed):
        group = _rendered(stream, stream.rigs())
        most = furthest(group.structure, group.wrench, group.lower, group.upper)
        tenth = np.arange(stream.size) % 10 == 9
        groups.append(_scaled(group, most * (1.0 + np.where(tenth, stream.between(FAR), stream.between(BEYOND)))))
    title = "wrenches 1 % to 100 % beyond what is available, every tenth 10 to 100 times too large"
    return ProblemSet("unreachable", title, tuple(groups), "none")


def _near_singular(count: int, seed: int) -> ProblemSet:
    """Wrenches of random tensions, on rigs of a given condition."""
    groups = []
    for stream in streams("near-singular", [(3, 3), (3, 4), (3, 8), (6, 8)], count, seed):
        structure = near_singular(stream.rng, stream.n, stream.m, stream.between(CONDITION))
        groups.append(_rendered(stream, structure))
    title = "cables nearly in a plane, platforms nearly a point: structure matrices of condition 1e2 to 1e7"
    return ProblemSet("near-singular", title, tuple(groups), "all")


def _robots(count: int, seed: int) -> ProblemSet:
    """Random poses of the robots in the folder of rigs."""
    groups = []
    rigs = [find_rig(name) for name in ("ipanema-1", "ipanema-2", "cogiro", "spidar-g6x4")]
    for rig, stream in zip(rigs, streams("robots", [(rig.n, rig.m) for rig in rigs], count, seed), strict=True):
        structure, wrench = over_workspace(stream.rng, rig, stream.size)
        groups.append(Group(rig.name, structure, wrench, rig.limits.lower, rig.limits.upper))
    title = "6-component robots over their workspaces, holding their weight and pushing: N and N·m mixed"
    return ProblemSet("robots", title, tuple(groups), "all")


def _trajectory(count: int, seed: int) -> ProblemSet:
    """Loops around points of the border: four rigs, then the same rigs again until there are enough samples."""
    kinds = (
        ("bartels2026-validation", 0.3, MAGNITUDE, False),
        ("seven-modules", 0.3, MAGNITUDE, True),
        ("cube-8", 0.3, MAGNITUDE, True),
        ("ipanema-1", 1.0, 20.0, False),
    )
    rounds = -(-count // (PATH[1] * len(kinds)))
    rigs = [find_rig(name) for name, *_ in kinds] * rounds
    groups = []
    for number, stream in enumerate(streams("trajectory", [(rig.n, rig.m) for rig in rigs], count, seed)):
        rig, (_, speed, size, turning) = rigs[number], kinds[number % len(kinds)]
        way = path(stream.rng, rig, max(PATH[0], stream.size), speed, size, turning)
        label = f"{rig.name}, {'turning' if turning else 'constant'} force, path {number + 1}"
        groups.append(Group(label, way[0], way[1], rig.limits.lower, rig.limits.upper, way[2]))
    title = "paths at 1 kHz that cross the border of the workspace: whether the tensions are continuous"
    return ProblemSet("trajectory", title, tuple(groups), "mixed")


def _mixed_limits(count: int, seed: int) -> ProblemSet:
    """Wrenches of random tensions, where one cable is stronger than the others."""
    groups = []
    for stream in streams("mixed-limits", [(3, 4), (3, 6), (3, 8), (6, 8)], count, seed):
        strong = np.arange(stream.m) == stream.rng.integers(stream.m, size=(stream.size, 1))
        limits = np.where(strong, STRONG[0], LOWER), np.where(strong, STRONG[1], UPPER)
        groups.append(_rendered(stream, stream.rigs(), limits))
    title = "one module of 0.3 to 20 N among modules of 0.5 to 6 N: cables whose limits differ"
    return ProblemSet("mixed-limits", title, tuple(groups), "all")


PROBLEM_SETS: dict[str, Callable[[int, int], ProblemSet]] = {
    "published": _published,
    "point": _point,
    "edge": _edge,
    "unreachable": _unreachable,
    "near-singular": _near_singular,
    "robots": _robots,
    "trajectory": _trajectory,
    "mixed-limits": _mixed_limits,
}
"""Generators by name: of a count and a seed."""


def _rendered(stream: Stream, structure: Floats, limits: tuple[Floats, Floats] | None = None) -> Group:
    """A group whose wrenches random tensions inside the limits render."""
    lower, upper = limits or (np.full(stream.m, LOWER), np.full(stream.m, UPPER))
    tensions = stream.rng.uniform(lower, upper, size=(stream.size, stream.m))
    wrench = (structure @ tensions[..., None])[..., 0]
    label = f"m = {stream.m}" if stream.n == 3 else f"n = {stream.n}, m = {stream.m}"
    return Group(label, structure, wrench, lower, upper)


def _scaled(group: Group, factor: Floats) -> Group:
    return Group(group.label, group.structure, factor[:, None] * group.wrench, group.lower, group.upper)
