"""Structure matrices and wrenches of the problem sets: random rigs, and rigs of ``datasets/rigs``."""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

from tensionlab.errors import RigError
from tensionlab.model.module import GRAVITY_M_S2
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace import capacity_margin

ARM_M = 0.3  # standard deviation of the coordinates of a platform's attachments, in m
SCALING_ROUNDS = 6  # corrections of a nearly singular rig, after which its condition is right ..
CONDITION_ACCURACY = 1e-3  # ... to this share, or the rig is drawn again.
BOX_SHARE = 0.6  # robots are placed up to this share of the way to their most distant anchor, along each axis
TILT = np.radians(10.0)  # robots are turned by up to this angle
PUSH_SHARE = 0.05  # robots are pushed with up to this share of their largest tension
MARGIN_SHARE = 1e-4  # least capacity margin of a robot's wrenches, as a share of its largest tension
OVAL_WIDTH = 0.5  # width of the oval loop of a path, as a share of its length
SWING = np.radians(30.0)  # a turning force swings so far to either side
FEASIBLE_SHARE = (0.1, 0.9)  # smallest and largest share of the samples of a path that are feasible
MAX_DRAWS = 200  # largest number of draws of random poses or paths for a rig


def unit_vectors(rng: np.random.Generator, *shape: int) -> Floats:
    """Draw directions evenly spread over the sphere, components on the last axis."""
    vectors = rng.normal(size=shape)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def structures(rng: np.random.Generator, n: int, m: int, count: int) -> Floats:
    """Draw structure matrices (count, n, m) of random rigs: a point (n = 3) or a platform (n = 6) with m cables.

    Cable directions are spread evenly over the sphere, attachments of a platform normally about its centre.
    """
    directions = unit_vectors(rng, count, m, 3)
    return _columns(directions, None if n == 3 else rng.normal(scale=ARM_M, size=(count, m, 3)))


class Stream(NamedTuple):
    """Random generator of a group of rigs, wrench components and cables of each rig, and number of rigs."""

    rng: np.random.Generator
    n: int
    m: int
    size: int

    def log_uniform(self, ends: tuple[float, float]) -> Floats:
        """Draw numbers spread evenly over the orders of magnitude between two ends, (size,)."""
        return np.asarray(np.exp(self.rng.uniform(np.log(ends[0]), np.log(ends[1]), self.size)))


def streams(name: str, shapes: list[tuple[int, int]], count: int, seed: int) -> list[Stream]:
    """Return the random numbers of each group of a problem set, the count spread evenly, at least one rig each.

    Each group has its own generator, so that another count or shape in one does not change another.
    """
    sizes = [max(1, (count + i) // len(shapes)) for i in reversed(range(len(shapes)))]
    return [
        Stream(np.random.default_rng([zlib.crc32(name.encode()), seed, i]), n, m, size)
        for i, ((n, m), size) in enumerate(zip(shapes, sizes, strict=True))
    ]


def near_singular(rng: np.random.Generator, n: int, m: int, condition: Floats) -> Floats:
    """Draw structure matrices (B, n, m) of random rigs with given conditions (B,), each 100 or more.

    A point rig (n = 3) is nearly singular because its cables are nearly in the plane z = 0, a platform (n = 6)
    because it is small: the condition goes with one over that size.
    """
    matrices = np.empty((len(condition), n, m))
    remaining = np.arange(len(condition))
    while remaining.size:
        wanted = condition[remaining]
        directions = unit_vectors(rng, len(wanted), m, 3)
        arms = None if n == 3 else rng.normal(size=(len(wanted), m, 3))
        size = 1.0 / wanted
        for _ in range(SCALING_ROUNDS):
            if arms is None:
                flat = directions.copy()
                flat[..., 2] *= size[:, None]
                scaled = _columns(flat / np.linalg.norm(flat, axis=-1, keepdims=True), None)
            else:
                scaled = _columns(directions, size[:, None, None] * arms)
            size = np.minimum(1.0, size * np.linalg.cond(scaled) / wanted)
        matrices[remaining] = scaled
        # A draw that is singular for another reason as well may miss its condition.
        remaining = remaining[np.abs(np.linalg.cond(scaled) / wanted - 1.0) > CONDITION_ACCURACY]
    return matrices


def _columns(directions: Floats, arms: Floats | None) -> Floats:
    """Return structure matrices (B, n, m) of cables that pull at arms r in directions u, both (B, m, 3)."""
    columns = directions if arms is None else np.concatenate([directions, np.cross(arms, directions)], axis=-1)
    return np.ascontiguousarray(np.swapaxes(columns, 1, 2))


def desired_wrenches(rig: Rig, force: Floats, rotation: Floats | None = None) -> Floats:
    """Return the wrenches (B, n) of forces (B, 3), in N, on the centre of mass, the weight held as well."""
    total: Floats = force if rig.platform is None else force + rig.platform.mass * GRAVITY_M_S2 * rig.upward
    if rig.n == 3:
        return total
    com = np.zeros(3) if rig.platform is None or rig.platform.com is None else np.asarray(rig.platform.com)
    return np.concatenate([total, np.cross(com if rotation is None else rotation @ com, total)], axis=1)


def workspace_samples(rng: np.random.Generator, rig: Rig, count: int) -> tuple[Floats, Floats]:
    """Draw feasible wrenches at random poses of a robot: structure matrices (count, n, m), wrenches (count, n).

    Positions are uniform in a box around home, turns up to `TILT`. The robot holds its weight and pushes with a
    random force, up to `PUSH_SHARE` of its largest tension, and a torque of up to that times the mean distance of
    the attachments. The rig is of kind platform, without body frames.
    """
    half = BOX_SHARE * np.abs(rig.anchors - rig.home).max(axis=0)
    strongest = float(rig.limits.upper.max())
    arm = float(np.linalg.norm(rig.attachments, axis=1).mean())
    matrices, wrenches, missing = [], [], count
    for _ in range(MAX_DRAWS):
        position = rig.home + rng.uniform(-half, half, size=(missing, 3))
        rotation = rotations(unit_vectors(rng, missing, 3), rng.uniform(0.0, TILT, size=missing))
        push, twist = PUSH_SHARE * strongest * rng.uniform(size=(2, missing, 1)) * unit_vectors(rng, 2, missing, 3)
        structure, wrench = rig.structure_matrix(position, rotation), desired_wrenches(rig, push, rotation)
        wrench[:, 3:] += arm * twist
        kept = capacity_margin(structure, rig.limits, wrench[:, None]) > MARGIN_SHARE * strongest
        matrices.append(structure[kept])
        wrenches.append(wrench[kept])
        missing -= int(kept.sum())
        if not missing:
            return np.concatenate(matrices), np.concatenate(wrenches)
    raise RigError(f'rig "{rig.name}": hardly any random pose can hold its wrench; {missing} of {count} not found')


def border_path(
    rng: np.random.Generator, rig: Rig, count: int, speed: float, size: float, turning: bool
) -> tuple[Floats, Floats]:
    """Draw one loop around a point of the border of a rig's workspace: a structure matrix and a wrench per sample.

    Straight from home in a random direction there is a point where the wrench stops being feasible; the loop is
    an oval around that point, first through the inside, at one rotation. One sample is one millisecond, and the
    loop is as long as the mean speed, in m/s, makes it. A force of the given size, in N, has a random direction,
    from which it swings by `SWING` if it is turning; the weight is held as well. The rig is in space, without
    body frames.
    """
    angle = np.pi + 2.0 * np.pi * np.arange(count) / count
    oval = np.stack([np.cos(angle), OVAL_WIDTH * np.sin(angle)])
    perimeter = np.linalg.norm(np.diff(oval, append=oval[:, :1]), axis=0).sum()
    oval *= 1e-3 * count * speed / perimeter
    for _ in range(MAX_DRAWS):
        outward, axis, force = unit_vectors(rng, 3), unit_vectors(rng, 3), size * unit_vectors(rng, 3)
        border = _border(rig, outward, force)
        if border is None:
            continue
        across = np.cross(outward, axis)
        position = border + oval.T @ [outward, across / np.linalg.norm(across)]
        swing = SWING * np.sin(angle) if turning else np.zeros(count)
        structure = rig.structure_matrix(position)
        wrench = desired_wrenches(rig, rotations(np.broadcast_to(axis, (count, 3)), swing) @ force)
        feasible = np.mean(capacity_margin(structure, rig.limits, wrench[:, None]) > 0.0)
        if FEASIBLE_SHARE[0] <= feasible <= FEASIBLE_SHARE[1]:
            return structure, wrench
    raise RigError(f'rig "{rig.name}": none of {MAX_DRAWS} random loops crosses the border of the workspace')


def rotations(axis: Floats, angle: Floats) -> Floats:
    """Return rotations (B, 3, 3) about unit axes (B, 3) by angles (B,) in rad, by Rodrigues' formula."""
    cross = np.cross(axis[:, None], np.eye(3)).swapaxes(1, 2)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * cross @ cross)


def _border(rig: Rig, outward: Floats, force: Floats) -> Floats | None:
    """Return where the force stops being feasible on the way outward from home, or None."""
    inside, outside = 0.0, 2.0 * float(np.linalg.norm(rig.anchors - rig.home, axis=1).max())
    wrench = desired_wrenches(rig, force[None])

    def feasible(distance: float) -> bool:
        structure = rig.structure_matrix((rig.home + distance * outward)[None])
        return bool(capacity_margin(structure, rig.limits, wrench[:, None])[0] > 0.0)

    if not feasible(inside) or feasible(outside):
        return None
    for _ in range(40):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if feasible(middle) else (inside, middle)
    return np.asarray(rig.home + inside * outward)
