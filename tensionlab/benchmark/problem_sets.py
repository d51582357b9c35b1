"""Problem sets of the benchmark: generated from seeds, each with a property that its construction guarantees.

The objective of all of them is the least ``|t|²`` of tensions t inside their limits that render the wrench,
``W t = w``. ``datasets/problems/README.md`` describes each set.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tensionlab.benchmark.rigs import Stream, border_path, near_singular, streams, workspace_samples
from tensionlab.errors import InputError
from tensionlab.model.directions import forces, grid18
from tensionlab.model.files import load_rig
from tensionlab.solvers.base import Policy, Problem
from tensionlab.support.arrays import Floats
from tensionlab.workspace import half_spaces

LOWER, UPPER = 0.5, 6.0  # tension limits of a published module, in N
STRONG = (0.3, 20.0)  # tension limits of a stronger module, in N
MAGNITUDE_N = 1.5  # size of the forces of the published validation, in N
# Distance of wrenches inside the edge of the available set, as a share of the largest in their direction.
EDGE_SHARE = (1e-5, 1e-2)
BEYOND_SHARE = (1e-2, 1.0)  # how far infeasible wrenches are beyond that edge ..
FAR_SHARE = (9.0, 99.0)  # ... and every tenth of them.
CONDITION = (1e2, 1e7)  # condition of the structure matrices of near-singular rigs
PATH_SAMPLES = (50, 1000)  # minimum and maximum number of samples of a path


@dataclass(frozen=True)
class Group:
    """Problems of one shape: structure (B, n, m), wrench (B, n) and tension limits, (B, m) or (m,), in N and N·m.

    The label is such as "m = 8" or "ipanema-1". Along a trajectory, whose rows are samples of 1 ms, ``path_mm``
    (B,) is the length of the path so far; it is None where the problems have no order.
    """

    label: str
    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    path_mm: Floats | None = None

    def __repr__(self) -> str:
        return f"<Group {self.label}: structure matrices {self.structure.shape}>"


@dataclass(frozen=True)
class ProblemSet:
    """Problems that test one property, which the title tells; ``reachable``: which wrenches can be rendered."""

    name: str
    title: str
    groups: tuple[Group, ...]
    reachable: Literal["all", "none", "mixed"]

    def __repr__(self) -> str:
        count = sum(len(group.wrench) for group in self.groups)
        return f"<ProblemSet {self.name}: {count} problems in {len(self.groups)} groups, {self.title}>"


def problem_set(name: str, count: int, seed: int = 0) -> ProblemSet:
    """Return the problems of a set, by its name in `PROBLEM_SETS`; the same seed gives the same.

    There are about as many as the count, spread evenly over the groups, at least one in each. `published` always
    has 364, and `trajectory` at least 50 a group.
    """
    if name not in PROBLEM_SETS:
        raise InputError(f"no problem set is called {name!r}; choose one of {', '.join(PROBLEM_SETS)}")
    if count < 1 or seed < 0:
        raise InputError(f"problem set {name!r}: count {count} must be 1 or more, and seed {seed} 0 or more")
    return PROBLEM_SETS[name](count, seed)


def problem_of(group: Group, policy: Policy | None = None) -> Problem:
    """Return the problems of a group, with this policy: reference 0, no weights."""
    size, n, m = group.structure.shape
    return Problem(
        structure=group.structure,
        wrench=group.wrench,
        lower=np.broadcast_to(group.lower, (size, m)),
        upper=np.broadcast_to(group.upper, (size, m)),
        reference=np.zeros((size, m)),
        weights=np.ones(n),
        policy=policy,
    )


def checksum(problems: ProblemSet) -> str:
    """Return a checksum of all problems, by which two benchmarks know that they measured the same."""
    digest = hashlib.blake2b(digest_size=16)
    for group in problems.groups:
        for array in problem_of(group).arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _published(count: int, seed: int) -> ProblemSet:
    """Return 182 forces on both readings of the published rig; neither count nor seed changes them."""
    groups = []
    for label, name in (("side 1.0 m", "bartels2026-validation"), ("side 0.3 m", "bartels2026-validation-0.3m")):
        rig = load_rig(name)
        wrench = forces(MAGNITUDE_N * grid18(), rig.n, rig.dimension)
        structure = np.broadcast_to(rig.structure_matrix(rig.home), (len(wrench), rig.n, rig.m))
        groups.append(Group(label, structure, wrench, rig.limits.lower, rig.limits.upper))
    title = "the published validation: 182 forces of 1.5 N on a rig that renders all and on one that renders 153"
    return ProblemSet("published", title, tuple(groups), "mixed")


def _point(count: int, seed: int) -> ProblemSet:
    drawn = streams("point", [(3, m) for m in range(3, 13)], count, seed)
    groups = tuple(_rendered(stream, stream.rigs()) for stream in drawn)
    return ProblemSet("point", "random point rigs with 3 to 12 cables: the everyday problem", groups, "all")


def _edge(count: int, seed: int) -> ProblemSet:
    """Return wrenches scaled to just inside the largest feasible one in their direction."""
    groups = []
    for stream in streams("edge", [(3, 3), (3, 4), (3, 6), (3, 8), (3, 12), (6, 8)], count, seed):
        group = _rendered(stream, stream.rigs())
        most = largest_scale(group.structure, group.wrench, group.lower, group.upper)
        # Never scaled back past the wrench that is known to be available.
        factor = np.maximum(1.0, most * (1.0 - stream.log_uniform(EDGE_SHARE)))
        groups.append(_scaled(group, factor))
    title = "wrenches at most 1 % inside the edge of what is available: nearly every cable is at a limit"
    return ProblemSet("edge", title, tuple(groups), "all")


def _unreachable(count: int, seed: int) -> ProblemSet:
    """Return wrenches scaled to beyond the largest feasible one in their direction."""
    groups = []
    for stream in streams("unreachable", [(3, 3), (3, 4), (3, 8), (3, 12), (6, 8)], count, seed):
        group = _rendered(stream, stream.rigs())
        most = largest_scale(group.structure, group.wrench, group.lower, group.upper)
        tenth = np.arange(stream.size) % 10 == 9
        far, beyond = stream.log_uniform(FAR_SHARE), stream.log_uniform(BEYOND_SHARE)
        groups.append(_scaled(group, most * (1.0 + np.where(tenth, far, beyond))))
    title = "wrenches 1 % to 100 % beyond what is available, every tenth 10 to 100 times too large"
    return ProblemSet("unreachable", title, tuple(groups), "none")


def _near_singular(count: int, seed: int) -> ProblemSet:
    groups = []
    for stream in streams("near-singular", [(3, 3), (3, 4), (3, 8), (6, 8)], count, seed):
        structure = near_singular(stream.rng, stream.n, stream.m, stream.log_uniform(CONDITION))
        groups.append(_rendered(stream, structure))
    title = "cables nearly in a plane, platforms nearly a point: structure matrices of condition 1e2 to 1e7"
    return ProblemSet("near-singular", title, tuple(groups), "all")


def _robots(count: int, seed: int) -> ProblemSet:
    groups = []
    rigs = [load_rig(name) for name in ("ipanema-1", "ipanema-2", "cogiro", "spidar-g6x4")]
    for rig, stream in zip(rigs, streams("robots", [(rig.n, rig.m) for rig in rigs], count, seed), strict=True):
        structure, wrench = workspace_samples(stream.rng, rig, stream.size)
        groups.append(Group(rig.name, structure, wrench, rig.limits.lower, rig.limits.upper))
    title = "6-component robots over their workspaces, holding their weight and pushing: N and N·m mixed"
    return ProblemSet("robots", title, tuple(groups), "all")


def _trajectory(count: int, seed: int) -> ProblemSet:
    """Return loops around points of the border: four rigs, the same rigs again until there are enough samples."""
    kinds = (
        ("bartels2026-validation", 0.3, MAGNITUDE_N, False),
        ("seven-modules", 0.3, MAGNITUDE_N, True),
        ("cube-8", 0.3, MAGNITUDE_N, True),
        ("ipanema-1", 1.0, 20.0, False),
    )
    rounds = -(-count // (PATH_SAMPLES[1] * len(kinds)))
    rigs = [load_rig(name) for name, *_ in kinds] * rounds
    groups = []
    for number, stream in enumerate(streams("trajectory", [(rig.n, rig.m) for rig in rigs], count, seed)):
        rig, (_, speed, size, turning) = rigs[number], kinds[number % len(kinds)]
        way = border_path(stream.rng, rig, max(PATH_SAMPLES[0], stream.size), speed, size, turning)
        label = f"{rig.name}, {'turning' if turning else 'constant'} force, path {number + 1}"
        groups.append(Group(label, way[0], way[1], rig.limits.lower, rig.limits.upper, way[2]))
    title = "paths at 1 kHz that cross the border of the workspace: whether the tensions are continuous"
    return ProblemSet("trajectory", title, tuple(groups), "mixed")


def _mixed_limits(count: int, seed: int) -> ProblemSet:
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
}  # generators by name: of a count and a seed


def _rendered(stream: Stream, structure: Floats, limits: tuple[Floats, Floats] | None = None) -> Group:
    """Return a group whose wrenches random tensions inside the limits render."""
    lower, upper = limits or (np.full(stream.m, LOWER), np.full(stream.m, UPPER))
    tensions = stream.rng.uniform(lower, upper, size=(stream.size, stream.m))
    wrench = (structure @ tensions[..., None])[..., 0]
    return Group(size_label(stream.n, stream.m), structure, wrench, lower, upper)


def size_label(n: int, m: int) -> str:
    """Return the label of a group of n wrench components and m cables."""
    return f"m = {m}" if n == 3 else f"n = {n}, m = {m}"


def _scaled(group: Group, factor: Floats) -> Group:
    return Group(group.label, group.structure, factor[:, None] * group.wrench, group.lower, group.upper)


def largest_scale(structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the largest factor (B,) by which each wrench can be scaled and still be feasible.

    From the available wrench sets; no solver is involved. The wrenches (B, n) are feasible and none is zero, so it
    is at least 1 but for rounding; the structure matrices (B, n, m) have rank n.
    """
    normals, offsets = half_spaces(structure, (lower, upper))
    along = (normals @ wrench[..., None])[..., 0]
    factors = np.divide(offsets, along, out=np.full(along.shape, np.inf), where=along > 0.0)
    return np.asarray(factors.min(axis=1))
