"""Motion cone and reaction cone of a point: what locked one-way brakes allow, and what they hold.

u are the unit vectors from the point to the anchors, the columns of the structure matrix. A locked one-way brake
lets its cable reel in but not pay out, so with the cables L locked

- the point can move with the velocities of the motion cone, ``{v: u_i·v >= 0 for i in L}``;
- the brakes can exert the forces of the reaction cone, ``{U_L l, l >= 0}``, which is the dual of the other;
- a brake reacts only where its cable is taut: ``0 <= l`` and ``U_L' v >= 0``, one of each pair zero.

A brake never acts: its reaction is there only while something pulls against it, and does no work. All functions
are for points, whose wrench is a force, and broadcast over leading axes. Velocities are those of the point as
seen from the anchors; where anchors move, ``u_i·(v - v_anchor,i)`` takes the place of ``u_i·v``.

The choice of brakes is tested against them.

Source: Farkas, "Theorie der einfachen Ungleichungen", 1902; Moreau, "Décomposition orthogonale d'un espace
hilbertien selon deux cônes mutuellement polaires", 1962.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import ShapeError
from tensionlab.haptics.brakes.choice import Flags
from tensionlab.model import pose
from tensionlab.support.arrays import Floats, common_axes, require_finite

TOLERANCE = 1e-9  # what counts as zero of a unit vector
MIN_INDEPENDENT = 1e-12  # a cable whose part across the others is below this is a combination of them


class Reaction(NamedTuple):
    """Reaction of brakes, and what is left of the load.

    Attributes
    ----------
    tensions : (..., m) array
        What each brake adds to its cable, in N: 0 or more, and 0 where it is not locked.
    net : (..., d) array
        The load and the reactions together, in N: what still moves the point. It lies in the motion cone, at
        right angles to the reactions.
    """

    tensions: Floats
    net: Floats


def brake_reaction(structure: ArrayLike, locked: ArrayLike, load: ArrayLike) -> Reaction:
    """Return how hard locked brakes hold against a load on a point at rest.

    The reaction is the projection of ``-load`` onto the reaction cone, a non-negative least squares. Its answer
    lies within one of the cones of at most d independent cables, so all of those are tried (each an orthogonal
    projection) and the nearest with no negative tension is taken. Brakes break at no load here.

    Source: Lawson and Hanson, "Solving Least Squares Problems", 1974, chapter 23; Carathéodory's theorem.

    Parameters
    ----------
    structure : (..., d, m) array
        Structure matrices of a point: unit vectors towards the anchors.
    locked : (..., m) array of bool
        Which brakes are locked. The work grows with the third power of how many.
    load : (..., d) array
        What pulls on the point besides these brakes, in N: the user, the motors, weight.

    Raises
    ------
    ShapeError
        If the shapes do not fit, or an entry is NaN or infinite.
    """
    U, sets = _sets(structure, locked)
    d, m = U.shape[-2:]
    push = pose.points(load, d, "load")
    shape = common_axes({"structure": U.shape[:-2], "load": push.shape[:-1]})
    U, sets = np.broadcast_to(U, (*shape, d, m)), np.broadcast_to(sets, (*shape, m))
    push = np.broadcast_to(push, (*shape, d))
    # The locked cables first, and no more columns than the largest set has.
    order = np.argsort(~sets, axis=-1, kind="stable")[..., : int(sets.sum(axis=-1).max(initial=0))]
    columns = np.take_along_axis(np.where(sets[..., None, :], U, 0.0), order[..., None, :], axis=-1)
    found = np.zeros(order.shape)
    least = np.einsum("...i,...i->...", push, push)
    for count in range(1, min(d, order.shape[-1]) + 1):
        for chosen in combinations(range(order.shape[-1]), count):
            tensions, left, valid = _projection(columns[..., chosen], push)
            better = valid & (left < least)
            least = np.where(better, left, least)
            row = np.zeros_like(found)
            row[..., chosen] = tensions
            found = np.where(better[..., None], row, found)
    tensions = np.zeros((*shape, m))
    np.put_along_axis(tensions, order, found, axis=-1)
    return Reaction(tensions, push + _times(U, tensions))


def _projection(columns: Floats, load: Floats) -> tuple[Floats, Floats, Flags]:
    """Return the tensions of k cables that cancel a load as far as they can.

    Also the square of what is left, and where that is an answer: the cables are independent, and none pushes.
    """
    Q, R = np.linalg.qr(columns)
    along = np.einsum("...ik,...i->...k", Q, load)
    left = load - np.einsum("...ik,...k->...i", Q, along)
    independent = (np.abs(np.einsum("...kk->...k", R)) > MIN_INDEPENDENT).all(axis=-1)
    R = np.where(independent[..., None, None], R, np.eye(R.shape[-1]))
    tensions = np.linalg.solve(R, -along[..., None])[..., 0]
    return tensions, np.einsum("...i,...i->...", left, left), independent & (tensions >= 0.0).all(axis=-1)


def holds(structure: ArrayLike, locked: ArrayLike, direction: ArrayLike) -> Flags:
    """Return whether the locked brakes hold a push against this direction, however hard.

    A wall with normal n holds if and only if n lies in the reaction cone (Farkas): then no motion that the
    brakes allow goes into the wall.

    Parameters
    ----------
    structure, locked
        As in `brake_reaction`.
    direction : (..., d) array
        Of any length but zero.

    Returns
    -------
    (...) array of bool

    Raises
    ------
    ShapeError
        As `brake_reaction`.
    """
    n = _unit(direction, np.asarray(structure))
    return np.asarray(np.linalg.norm(brake_reaction(structure, locked, -n).net, axis=-1) <= TOLERANCE)


def allows(structure: ArrayLike, locked: ArrayLike, velocity: ArrayLike) -> Flags:
    """Return whether the point can move this way with these brakes locked: whether it lies in the motion cone.

    Parameters, returns and errors as in `holds`.
    """
    U, sets = _sets(structure, locked)
    v = _unit(velocity, U)
    rates = np.einsum("...im,...i->...m", U, v)
    return np.asarray(~(sets & (rates < -TOLERANCE)).any(axis=-1))


def blocks_withdrawal(structure: ArrayLike, locked: ArrayLike, normal: ArrayLike) -> Flags:
    """Return whether the hand is kept from leaving a wall straight along its normal.

    Parameters, returns and errors as in `holds`.
    """
    return np.asarray(~allows(structure, locked, normal))


def traps(structure: ArrayLike, locked: ArrayLike, normal: ArrayLike) -> Flags:
    """Return whether there is no way at all to leave a wall, not even aslant.

    By Farkas there is none if and only if ``-normal`` lies in the reaction cone: the brakes hold a pull away
    from the wall.

    Parameters, returns and errors as in `holds`.
    """
    return holds(structure, locked, -np.asarray(normal, dtype=np.float64))


def blocks_free_motion(structure: ArrayLike, locked: ArrayLike, normal: ArrayLike) -> Flags:
    """Return whether any motion is blocked that a wall with this normal leaves free: along it, or away from it.

    None is if and only if the reaction cone is no more than the ray of the normal (Farkas), so every locked
    cable must point along it.

    Parameters, returns and errors as in `holds`.
    """
    U, sets = _sets(structure, locked)
    n = _unit(normal, U)
    aside = np.linalg.norm(U / np.linalg.norm(U, axis=-2, keepdims=True) - n[..., None], axis=-2)
    return np.asarray((sets & (aside > TOLERANCE)).any(axis=-1))


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return np.asarray(np.einsum("...im,...m->...i", matrices, vectors))


def _unit(direction: ArrayLike, structure: Floats) -> Floats:
    """Return vectors of length one that fit the structure matrices; raise `ShapeError` where there are none."""
    if structure.ndim < 2:
        raise ShapeError(f"structure has shape {structure.shape}; give that of a point, (2, m) or (3, m)")
    vectors = pose.points(direction, structure.shape[-2], "direction")
    common_axes({"structure": structure.shape[:-2], "direction": vectors.shape[:-1]})
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not lengths.all():
        raise ShapeError("direction has a vector of length zero; give vectors with a direction")
    return np.asarray(vectors / lengths)


def _sets(structure: ArrayLike, locked: ArrayLike) -> tuple[Floats, Flags]:
    """Return structure matrices and sets of cables with the same leading axes."""
    U = require_finite("structure", structure, 0)
    sets = np.asarray(locked)
    if U.ndim < 2 or U.shape[-2] not in (2, 3):
        raise ShapeError(f"structure has shape {U.shape}; give that of a point, (2, m) or (3, m)")
    if sets.dtype != np.bool_ or sets.shape[-1:] != U.shape[-1:]:
        raise ShapeError(
            f"locked has shape {sets.shape} and entries of type {sets.dtype}; give one bool for each of "
            f"{U.shape[-1]} cables"
        )
    shape = common_axes({"structure": U.shape[:-2], "locked": sets.shape[:-1]})
    return np.broadcast_to(U, (*shape, *U.shape[-2:])), np.broadcast_to(sets, (*shape, *sets.shape[-1:]))
