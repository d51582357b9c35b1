"""Which brakes to lock, so that a wall holds against more than the motors can, and lets the hand go?

The user pushes with F newtons against the normal n of a wall. Motors pull with at most some newtons each; a locked
one-way brake holds its cable against up to its own strength. `choose_locks` tries every small set L of cables
that may be locked and prices it: the force that stays unresisted, plus a share of F for each lock.

- A cable is locked only if it pulls the hand out of the wall, ``u_i·n > margin``. Then every locked cable reels
  in when the hand withdraws along n, so no set can keep it. A non-negative least squares alone does not see to it.
- For each L, the tensions nearest to the wanted force are a bounded least squares, with the brakes' strength as
  upper limit in L: the exact solver's, of `tensionlab.solvers`. The motors pull with as much of it as they can.
- What a brake holds is there only while the user pushes. It is reported apart from what the motors pull.

Where the motors alone render the force, nothing is locked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import ShapeError
from tensionlab.haptics.brake_cones import Flags
from tensionlab.model import pose
from tensionlab.model.kinematics import Floats
from tensionlab.model.limits import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.solvers.contract import TOLERANCE, Problem
from tensionlab.solvers.newton import Newton

AT_ONCE = 1 << 11
"""Walls in one go: a few hundred thousand sets of tensions."""


@dataclass(frozen=True)
class LockRule:
    """How are sets of brakes compared? Defaults are this project's, not published.

    Attributes
    ----------
    margin : float
        Least ``u·n`` of a cable that may be locked: 0.02 is 1.1 degrees before it would keep the hand, or 2 cm of
        error in the hand's position at 1 m from the anchor. A locked one stays until it is 0.
    most : int
        Largest number of locked cables. Three independent ones hold any force of their cone.
    price : float
        Of each lock, as a share of the wanted force.
    hysteresis : float
        By which share of the wanted force another set must be better than the one that is locked.
    """

    margin: float = 0.02
    most: int = 3
    price: float = 0.02
    hysteresis: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 < self.margin < 1.0:
            raise ValueError(
                f"LockRule(margin={self.margin}): must be above 0 and below 1; at 0 a brake could trap"
            )
        if self.most < 0:
            raise ValueError(f"LockRule(most={self.most}): must be 0 or more")
        for name in ("price", "hysteresis"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"LockRule({name}={getattr(self, name)}): must be 0 or more")


DEFAULT = LockRule()


class LockSet(NamedTuple):
    """Which brakes to lock, how hard to pull, and what comes of it?

    Attributes
    ----------
    locked : (..., m) array of bool
    motors : (..., m) array
        Tensions to ask of the motors, inside their limits, in N.
    brakes : (..., m) array
        What each brake adds while the user pushes with the wanted force, in N; 0 where it is not locked.
    unresisted : (...) array
        Norm of what is missing to the wanted force while the user pushes with it, in N.
    able : (..., m) array of bool
        Which brakes may be locked for this wall. Where none is, the motors are all there is.
    """

    locked: Flags
    motors: Floats
    brakes: Floats
    unresisted: Floats
    able: Flags


def brake_strengths(rig: Rig) -> Floats:
    """How hard does the brake of each module hold, in N? (m,) array, 0 for a module without one."""
    return np.array([module.brake or 0.0 for module in rig.modules])


def choose_locks(
    structure: ArrayLike,
    normal: ArrayLike,
    force: ArrayLike,
    limits: TensionLimits,
    strengths: ArrayLike,
    pushing: ArrayLike = True,
    held: ArrayLike | None = None,
    crowding: ArrayLike | None = None,
    rule: LockRule = DEFAULT,
) -> LockSet:
    """Which brakes should be locked to hold a push against a wall, and how hard should the motors pull?

    Leading axes of all arrays broadcast: one hand at one wall, or ten thousand.

    Parameters
    ----------
    structure : (..., d, m) array
        Structure matrices of a point: unit vectors towards the anchors.
    normal : (..., d) array
        Unit normal of the wall, towards the free side.
    force : (...) array
        What the wall should hold, in N, 0 or more.
    limits : TensionLimits
        Of the motors.
    strengths : (m,) array
        What each brake may be loaded with, in N: its own strength or a lower cap for safety; 0 for none.
    pushing : (...) array of bool
        Whether the contact takes energy from the user: the hand moves into the wall or is held by it. Where it
        does not, nothing new is locked.
    held : (..., m) array of bool, optional
        Which brakes are locked now. Leave it out where there are none.
    crowding : (...) array, optional
        Largest stiffness of a locked set, as a multiple of that of one cable; less than 1 refuses all. See
        `tensionlab.haptics.brake_contact.ImpactCap`.
    rule : LockRule

    Returns
    -------
    LockSet

    Raises
    ------
    ShapeError
        Naming the array, if shapes do not fit, a number is not finite, a normal is not of unit length, or a force
        or strength is negative.
    """
    U, n = np.ascontiguousarray(pose.numbers(structure, "structure")), pose.numbers(normal, "normal")
    m = limits.lower.size
    if U.ndim < 2 or U.shape[-1] != m or n.shape[-1:] != U.shape[-2:-1]:
        raise ShapeError(
            f"structure {U.shape}, normal {n.shape} and limits of {m} cables do not fit; give (..., d, m), "
            "(..., d) and m"
        )
    F, held_by = pose.numbers(force, "force"), pose.points(strengths, m, "strengths")
    if F.min(initial=0.0) < 0.0 or held_by.min(initial=0.0) < 0.0:
        raise ShapeError(
            "force and strengths must be 0 N or more; turn the normal round for a force the other way"
        )
    if np.abs(np.einsum("...i,...i->...", n, n) - 1.0).max(initial=0.0) > 2e-6:
        raise ShapeError("normal is not a unit vector; divide it by its length")
    given = {"structure": (U, 2), "normal": (n, 1), "force": (F, 0), "pushing": (np.asarray(pushing, np.bool_), 0)}
    if held is not None:
        given["held"] = (np.asarray(held, np.bool_), 1)
        if given["held"][0].shape[-1:] != (m,):
            raise ShapeError(f"held has shape {given['held'][0].shape}; give one bool for each of {m} cables")
    if crowding is not None:
        given["crowding"] = (np.asarray(crowding, np.float64), 0)
    shape = pose.common_shape({name: array.shape[: array.ndim - inner] for name, (array, inner) in given.items()})
    count = math.prod(shape)
    walls = {name: _rows(array, shape, inner, count) for name, (array, inner) in given.items()}
    if count <= AT_ONCE:
        chosen = _choose(walls, limits, held_by, rule)
    else:
        starts = range(0, count, AT_ONCE)
        parts = [
            _choose({name: array[i : i + AT_ONCE] for name, array in walls.items()}, limits, held_by, rule)
            for i in starts
        ]
        chosen = LockSet(*map(np.concatenate, zip(*parts, strict=True)))
    return LockSet(*(array.reshape((*shape, *array.shape[1:])) for array in chosen))


def _choose(walls: dict[str, NDArray[Any]], limits: TensionLimits, strengths: Floats, rule: LockRule) -> LockSet:
    """As `choose_locks`, with its arrays by name and one leading axis."""
    U, n, F, pushing = (walls[name] for name in ("structure", "normal", "force", "pushing"))
    held, crowding = walls.get("held"), walls.get("crowding")
    sets, sizes = _sets(limits.lower.size, rule.most)
    outward = np.einsum("bim,bi->bm", U, n)
    least = rule.margin if held is None else np.where(held, 0.0, rule.margin)
    able = (outward > least) & (strengths > 0.0)
    new = able & (pushing & (F > 0.0))[:, None]
    may = new if held is None else new | (able & held & (F > 0.0)[:, None])
    # A set that has a cable which may not be locked is not tried; the first set, of none, always is.
    tried = ~may @ sets.T == 0.0
    if crowding is not None:
        tried &= _stiffest(U, sets) <= crowding[:, None]
    wall, which = tried.nonzero()

    columns, wanted = U[wall], (F[:, None] * n)[wall]
    low = limits.lower[None].repeat(len(wall), axis=0)
    upper = np.where(sets[which] > 0.0, np.maximum(limits.upper, strengths), limits.upper)
    problem = Problem(columns, wanted, low, upper, low, np.ones(n.shape[1]), "force")
    tensions = Newton().solve(problem).tensions
    missing = np.einsum("bim,bm->bi", columns, tensions) - wanted
    left = np.sqrt(np.einsum("bi,bi->b", missing, missing))

    cost = np.full(tried.shape, math.inf)
    cost[tried] = left + rule.price * F[wall] * sizes[which]
    if held is not None:
        same = (sets == held[:, None]).all(axis=2) & (sizes > 0.0)
        cost -= rule.hysteresis * F[:, None] * same
    motors_do = cost[:, 0] <= TOLERANCE * np.maximum(1.0, F)
    best = np.where(motors_do, 0, cost.argmin(axis=1))
    row = np.searchsorted(wall * len(sets) + which, np.arange(len(U)) * len(sets) + best)
    motors = np.minimum(tensions[row], limits.upper)
    return LockSet(sets[best] > 0.0, motors, tensions[row] - motors, left[row], able)


@lru_cache(maxsize=32)
def _sets(m: int, most: int) -> tuple[Floats, Floats]:
    """All sets of at most so many of m cables, (S, m) of 0 and 1, and their sizes; the empty one first."""
    chosen = [each for size in range(min(most, m) + 1) for each in combinations(range(m), size)]
    sets = np.zeros((len(chosen), m))
    for row, each in zip(sets, chosen, strict=True):
        row[list(each)] = 1.0
    return sets, sets.sum(axis=1)


def _stiffest(U: Floats, sets: Floats) -> Floats:
    """What is the stiffness of each set along its stiffest direction, in that of one cable? (B, S) array.

    An upper bound of the largest eigenvalue of ``U_L U_L'``, which is that of the matrix of cosines ``U_L' U_L``:
    its largest sum of absolute values along a row (Gershgorin). Exact for one cable and for two.
    """
    cosines = np.abs(np.einsum("bik,bim->bkm", U, U))
    return np.asarray((sets * (sets @ cosines)).max(axis=2))


def _rows(array: NDArray[Any], shape: tuple[int, ...], inner: int, count: int) -> NDArray[Any]:
    """An array with one leading axis, one row a wall."""
    own = array.shape[array.ndim - inner :]
    if array.shape != shape + own:
        array = np.broadcast_to(array, shape + own)
    return array.reshape((count, *own))
