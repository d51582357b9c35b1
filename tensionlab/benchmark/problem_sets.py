"""Problem sets of the benchmark: generated from seeds, each with a property that its construction guarantees.

The objective of all of them is the least ``|t|²`` of tensions t inside their limits that render the wrench,
``W t = w``. ``datasets/problems/README.md`` describes each set.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tensionlab.benchmark.rigs import Stream, border_path, near_singular, streams, structures, workspace_samples
from tensionlab.errors import InputError
from tensionlab.model.directions import forces, grid18
from tensionlab.model.files import load_rig
from tensionlab.solvers.base import Policy, Problem
from tensionlab.support.arrays import Floats, Integers
from tensionlab.workspace import half_spaces

LOWER, UPPER = 0.5, 6.0  # tension limits of a published module, in N
STRONG = (0.3, 20.0)  # tension limits of a stronger module, in N
MAGNITUDE_N = 1.5  # size of the forces of the published validation, in N
# How far wrenches are inside the edge of the available set, infeasible ones beyond it, and every tenth of those.
EDGE_SHARE, BEYOND_SHARE, FAR_SHARE = (1e-5, 1e-2), (1e-2, 1.0), (9.0, 99.0)
CONDITION = (1e2, 1e7)  # condition of the structure matrices of near-singular rigs
PATH_SAMPLES = (50, 1000)  # minimum and maximum number of samples of a path
PATHS = (
    ("bartels2026-validation", 0.3, MAGNITUDE_N, False),
    ("seven-modules", 0.3, MAGNITUDE_N, True),
    ("cube-8", 0.3, MAGNITUDE_N, True),
    ("ipanema-1", 1.0, 20.0, False),
)  # rig, speed in m/s, size of the force in N, and whether the force turns
Reachable = Literal["all", "none", "mixed"]  # which wrenches of a set are feasible


@dataclass(frozen=True)
class Group:
    """Problems of one shape."""

    label: str  # such as "m = 8" or "ipanema-1"
    structure: Floats  # (B, n, m)
    wrench: Floats  # (B, n), in N and N·m
    lower: Floats  # tension limits in N, (B, m) or (m,)
    upper: Floats
    # Of a track: the row of the problem just before, from whose answer a solver may start, (B,); -1 for none.
    previous: Integers | None = None

    def __repr__(self) -> str:
        return f"<Group {self.label}: structure matrices {self.structure.shape}>"


@dataclass(frozen=True)
class ProblemSet:
    """Problems that test one property, which is the title."""

    name: str
    title: str
    groups: tuple[Group, ...]
    reachable: Reachable

    def __repr__(self) -> str:
        return f"<ProblemSet {self.name}: {len(self)} problems in {len(self.groups)} groups, {self.title}>"

    def __len__(self) -> int:
        return sum(len(group.wrench) for group in self.groups)


Groups = Callable[[str, int, int], Iterable[Group]]  # makes the groups of a set from its name, a count and a seed


def problem_set(name: str, count: int, seed: int = 0) -> ProblemSet:
    """Return the problems of a set, by its name in `PROBLEM_SETS`; the same seed gives the same.

    There are about as many as the count, spread evenly over the groups, at least one in each. `published` always
    has 364, and `trajectory` at least 50 a group.
    """
    if name not in PROBLEM_SETS:
        raise InputError(f"no problem set is called {name!r}; choose one of {', '.join(PROBLEM_SETS)}")
    if count < 1 or seed < 0:
        raise InputError(f"problem set {name!r}: count {count} must be 1 or more, and seed {seed} 0 or more")
    reachable, groups, title = PROBLEM_SETS[name]
    return ProblemSet(name, title, tuple(groups(name, count, seed)), reachable)


def problem_of(group: Group, policy: Policy | None = None) -> Problem:
    """Return the problems of a group, with this policy: reference 0, no weights."""
    size, n, m = group.structure.shape
    lower, upper = (np.broadcast_to(limit, (size, m)) for limit in (group.lower, group.upper))
    return Problem(group.structure, group.wrench, lower, upper, np.zeros((size, m)), np.ones(n), policy)


def checksum(problems: ProblemSet) -> str:
    """Return a checksum of all problems, by which two benchmarks know that they measured the same."""
    digest = hashlib.blake2b(digest_size=16)
    for group in problems.groups:
        for array in problem_of(group).arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


# Groups of random rigs


def _rendered(
    stream: Stream, structure: Floats | None = None, limits: tuple[Floats, Floats] | None = None
) -> Group:
    """Return a group whose wrenches random tensions inside the limits render."""
    structure = structures(*stream) if structure is None else structure
    lower, upper = limits or (np.full(stream.m, LOWER), np.full(stream.m, UPPER))
    tensions = stream.rng.uniform(lower, upper, size=(stream.size, stream.m))
    wrench = (structure @ tensions[..., None])[..., 0]
    return Group(size_label(stream.n, stream.m), structure, wrench, lower, upper)


def _edge(stream: Stream) -> Group:
    group = _rendered(stream)
    # Never scaled back past the wrench that is known to be available.
    factor = np.maximum(1.0, largest_scale(group) * (1.0 - stream.log_uniform(EDGE_SHARE)))
    return replace(group, wrench=factor[:, None] * group.wrench)


def _unreachable(stream: Stream) -> Group:
    group = _rendered(stream)
    tenth = np.arange(stream.size) % 10 == 9
    far, beyond = stream.log_uniform(FAR_SHARE), stream.log_uniform(BEYOND_SHARE)
    factor = largest_scale(group) * (1.0 + np.where(tenth, far, beyond))
    return replace(group, wrench=factor[:, None] * group.wrench)


def _near_singular(stream: Stream) -> Group:
    return _rendered(stream, near_singular(stream.rng, stream.n, stream.m, stream.log_uniform(CONDITION)))


def _mixed_limits(stream: Stream) -> Group:
    strong = np.arange(stream.m) == stream.rng.integers(stream.m, size=(stream.size, 1))
    limits = np.where(strong, STRONG[0], LOWER), np.where(strong, STRONG[1], UPPER)
    return _rendered(stream, limits=limits)


def size_label(n: int, m: int) -> str:
    """Return the label of a group of n wrench components and m cables."""
    return f"m = {m}" if n == 3 else f"n = {n}, m = {m}"


def largest_scale(group: Group) -> Floats:
    """Return the largest factor (B,) by which each wrench can be scaled and still be feasible.

    From the available wrench sets; no solver is involved. The wrenches are feasible and none is zero, so it is at
    least 1 but for rounding; the structure matrices have rank n.
    """
    normals, offsets = half_spaces(group.structure, (group.lower, group.upper))
    along = (normals @ group.wrench[..., None])[..., 0]
    factors = np.divide(offsets, along, out=np.full(along.shape, np.inf), where=along > 0.0)
    return np.asarray(factors.min(axis=1))


def _random(make: Callable[[Stream], Group], *shapes: tuple[int, int]) -> Groups:
    """Return the groups of random rigs with these numbers of wrench components and cables."""
    return lambda name, count, seed: map(make, streams(name, list(shapes), count, seed))


# Groups of rigs of ``datasets/rigs``


def _published(name: str, count: int, seed: int) -> Iterator[Group]:
    """Yield 182 forces on both readings of the published rig; neither count nor seed changes them."""
    for label, robot in (("1.0", "bartels2026-validation"), ("0.3", "bartels2026-validation-0.3m")):
        rig = load_rig(robot)
        wrench = forces(MAGNITUDE_N * grid18(), rig.n, rig.dimension)
        structure = np.broadcast_to(rig.structure_matrix(rig.home), (len(wrench), rig.n, rig.m))
        yield Group(f"side {label} m", structure, wrench, rig.limits.lower, rig.limits.upper)


def _robots(name: str, count: int, seed: int) -> Iterator[Group]:
    rigs = [load_rig(robot) for robot in ("ipanema-1", "ipanema-2", "cogiro", "spidar-g6x4")]
    for rig, stream in zip(rigs, streams(name, [(rig.n, rig.m) for rig in rigs], count, seed), strict=True):
        structure, wrench = workspace_samples(stream.rng, rig, stream.size)
        yield Group(rig.name, structure, wrench, rig.limits.lower, rig.limits.upper)


def _trajectory(name: str, count: int, seed: int) -> Iterator[Group]:
    """Yield loops around points of the border, for the same rigs again until there are enough samples."""
    paths = PATHS * -(-count // (PATH_SAMPLES[1] * len(PATHS)))
    rigs = [load_rig(rig) for rig, *_ in paths]
    for number, stream in enumerate(streams(name, [(rig.n, rig.m) for rig in rigs], count, seed)):
        rig, (_, speed, size, turning) = rigs[number], paths[number]
        structure, wrench = border_path(stream.rng, rig, max(PATH_SAMPLES[0], stream.size), speed, size, turning)
        label = f"{rig.name}, {'turning' if turning else 'constant'} force, path {number + 1}"
        yield Group(label, structure, wrench, rig.limits.lower, rig.limits.upper)


PROBLEM_SETS: dict[str, tuple[Reachable, Groups, str]] = {
    "published": ("mixed", _published,
              "the published validation: 182 forces of 1.5 N on a rig that renders all and one that renders 153"),
    "point": ("all", _random(_rendered, *((3, m) for m in range(3, 13))),
              "random point rigs with 3 to 12 cables: the everyday problem"),
    "edge": ("all", _random(_edge, (3, 3), (3, 4), (3, 6), (3, 8), (3, 12), (6, 8)),
              "wrenches at most 1 % inside the edge of what is available: nearly every cable is at a limit"),
    "unreachable": ("none", _random(_unreachable, (3, 3), (3, 4), (3, 8), (3, 12), (6, 8)),
              "wrenches 1 % to 100 % beyond what is available, every tenth 10 to 100 times too large"),
    "near-singular": ("all", _random(_near_singular, (3, 3), (3, 4), (3, 8), (6, 8)),
              "cables nearly in a plane, platforms nearly a point: structure matrices of condition 1e2 to 1e7"),
    "robots": ("all", _robots,
              "6-component robots over their workspaces, holding their weight and pushing: N and N·m mixed"),
    "trajectory": ("mixed", _trajectory, "paths at 1 kHz that cross the border of the workspace"),
    "mixed-limits": ("all", _random(_mixed_limits, (3, 4), (3, 6), (3, 8), (6, 8)),
              "one module of 0.3 to 20 N among modules of 0.5 to 6 N: cables whose limits differ"),
}  # which wrenches are feasible, the groups, and the title of each set  # fmt: skip
