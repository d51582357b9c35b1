"""What rigs of `datasets/rigs` are asked for: poses over their workspaces, and paths that leave them."""

from __future__ import annotations

import numpy as np

from tensionlab import datasets
from tensionlab.arrays import Floats
from tensionlab.benchmark.random_rigs import unit
from tensionlab.errors import RigError
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.workspace import capacity_margin

GRAVITY = 9.81
"""m/s²."""

ROOM = 0.6
"""Robots are placed up to this share of the way from home to their furthest anchor, along each axis."""
TILT = np.radians(10.0)
"""Robots are turned by up to this angle."""
PUSH = 0.05
"""Robots are pushed with up to this share of their largest tension."""
INSIDE = 1e-4
"""Least clearance of a robot's wrenches, as a share of its largest tension."""

SIDEWAYS = 0.5
"""Width of the oval loop of a path, as a share of its length."""
SWING = np.radians(30.0)
"""A turning force swings so far to either side."""
SHARE = (0.1, 0.9)
"""At least this share of the samples of a path is within reach, and at most that."""
DRAWS = 200
"""So many times random poses or paths are drawn before a rig is given up."""


def find_rig(name: str) -> Rig:
    """Read a rig that comes with the package, by its name in `datasets/rigs`.

    Raises
    ------
    ShapeError, RigError
        If the data sets are not there, or the rig is not among them.
    """
    return load_rig(datasets.folder() / "rigs" / f"{name}.toml")


def asked(rig: Rig, force: Floats, rotation: Floats | None = None) -> Floats:
    """Which wrenches must the cables render to exert these forces and hold the weight?

    Parameters
    ----------
    rig : Rig
        In space. One whose platform has a mass must say which axis is up.
    force : (B, 3) array
        In N, exerted on the centre of mass, or on the reference point if that is not known.
    rotation : (B, 3, 3) array or None
        Platform to world; None is the identity.

    Returns
    -------
    (B, n) array
        In N (and N·m, about the reference point).
    """
    total: Floats = force if rig.platform is None else force + rig.platform.mass * GRAVITY * rig.upward
    if rig.n == 3:
        return total
    com = np.zeros(3) if rig.platform is None or rig.platform.com is None else np.asarray(rig.platform.com)
    return np.concatenate([total, np.cross(com if rotation is None else rotation @ com, total)], axis=1)


def over_workspace(rng: np.random.Generator, rig: Rig, count: int) -> tuple[Floats, Floats]:
    """Which wrenches, within reach, is a robot asked for at random poses?

    Positions are uniform in a box around home, the axis of the turn on the sphere, its angle up to `TILT`. The
    robot holds its weight, and pushes with a random force and a random torque: the force up to `PUSH` of its
    largest tension, the torque up to that on an arm as long as the attachments are away on average. Draws
    whose wrench is out of reach are drawn again.

    Parameters
    ----------
    rng : Generator
    rig : Rig
        Of kind platform, without body frames.
    count : int

    Returns
    -------
    structure : (count, n, m) array
    wrench : (count, n) array
        In N and N·m.

    Raises
    ------
    RigError
        If hardly any pose can hold its wrench.
    """
    half = ROOM * np.abs(rig.anchors - rig.home).max(axis=0)
    strongest = float(rig.limits.upper.max())
    arm = float(np.linalg.norm(rig.attachments, axis=1).mean())
    structures, wrenches, missing = [], [], count
    for _ in range(DRAWS):
        position = rig.home + rng.uniform(-half, half, size=(missing, 3))
        rotation = turns(unit(rng, missing, 3), rng.uniform(0.0, TILT, size=missing))
        push, twist = PUSH * strongest * rng.uniform(size=(2, missing, 1)) * unit(rng, 2, missing, 3)
        structure, wrench = rig.structure_matrix(position, rotation), asked(rig, push, rotation)
        wrench[:, 3:] += arm * twist
        kept = capacity_margin(structure, rig.limits, wrench[:, None]) > INSIDE * strongest
        structures.append(structure[kept])
        wrenches.append(wrench[kept])
        missing -= int(kept.sum())
        if not missing:
            return np.concatenate(structures), np.concatenate(wrenches)
    raise RigError(f'rig "{rig.name}": hardly any random pose can hold its wrench; {missing} of {count} not found')


def path(
    rng: np.random.Generator, rig: Rig, count: int, speed: float, size: float, turning: bool
) -> tuple[Floats, Floats, Floats]:
    """Which problems does a rig meet on one loop around a point of its workspace's border?

    Straight from home in a random direction there is a point where the wrench stops being available; the loop is
    an oval around that point, first through the inside, at one pose. One sample is one millisecond.

    Parameters
    ----------
    rng : Generator
    rig : Rig
        In space, without body frames.
    count : int
        Samples; the loop is closed by the next one.
    speed : float
        In m/s, on average; the length of the loop is that times its duration.
    size : float
        Of the force, in N; its direction is random. The weight, if there is one, is held as well.
    turning : bool
        Whether the force swings by `SWING` to either side on the way.

    Returns
    -------
    structure : (count, n, m) array
    wrench : (count, n) array
        In N (and N·m).
    length : (count,) array
        Of the way so far, in mm.

    Raises
    ------
    RigError
        If no loop is found that lies partly within reach.
    """
    angle = np.pi + 2.0 * np.pi * np.arange(count) / count
    oval = np.stack([np.cos(angle), SIDEWAYS * np.sin(angle)])
    perimeter = np.linalg.norm(np.diff(oval, append=oval[:, :1]), axis=0).sum()
    oval *= 1e-3 * count * speed / perimeter
    for _ in range(DRAWS):
        outward, axis, force = unit(rng, 3), unit(rng, 3), size * unit(rng, 3)
        border = _border(rig, outward, force)
        if border is None:
            continue
        across = np.cross(outward, axis)
        position = border + oval.T @ [outward, across / np.linalg.norm(across)]
        swing = SWING * np.sin(angle) if turning else np.zeros(count)
        structure = rig.structure_matrix(position)
        wrench = asked(rig, turns(np.broadcast_to(axis, (count, 3)), swing) @ force)
        within = np.mean(capacity_margin(structure, rig.limits, wrench[:, None]) > 0.0)
        if SHARE[0] <= within <= SHARE[1]:
            steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
            return structure, wrench, 1e3 * np.append(0.0, np.cumsum(steps))
    raise RigError(f'rig "{rig.name}": none of {DRAWS} random loops crosses the border of the workspace')


def turns(axis: Floats, angle: Floats) -> Floats:
    """Which rotations turn about these unit axes (B, 3) by these angles (B,) in rad? By Rodrigues' formula."""
    cross = np.cross(axis[:, None], np.eye(3)).swapaxes(1, 2)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * cross @ cross)


def _border(rig: Rig, outward: Floats, force: Floats) -> Floats | None:
    """Where the force stops being available on the way outward from home; None if it does not do so."""
    inside, outside = 0.0, 2.0 * float(np.linalg.norm(rig.anchors - rig.home, axis=1).max())
    wrench = asked(rig, force[None])

    def available(distance: float) -> bool:
        structure = rig.structure_matrix((rig.home + distance * outward)[None])
        return bool(capacity_margin(structure, rig.limits, wrench[:, None])[0] > 0.0)

    if not available(inside) or available(outside):
        return None
    for _ in range(40):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if available(middle) else (inside, middle)
    return np.asarray(rig.home + inside * outward)
