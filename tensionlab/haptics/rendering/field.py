"""Allocation of a field: the impedances of modules that together are nearest to a desired stiffness and damping.

A module renders a spring and a damper along its own cable, at its own rate. With the unit vectors u from the hand,
the cables together have the stiffness matrix ``sum k u u'`` and the damping matrix ``sum d u u'``: a wall needs no
cable along its normal. `allocate_field` finds the best k and d, and tensions for them; `predict` says what a hand
will feel of a stiffness matrix along one axis, with the host's corrections, which come late.

That a module can hold an impedance by itself, and the host moves it along a surface, are the local models of
Adachi, Kumano and Ogino 1995, "Intermediate representation for stiff virtual objects", and Mark, Randolph, Finch,
Van Verth and Taylor 1996, "Adding force feedback to graphics systems". The programme is this project's own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tensionlab import _native
from tensionlab.model.wall_stiffness import HAND_DAMPING, MARGIN, MIN_HAND_MASS_KG
from tensionlab.support.arrays import Floats

# Weight of an error where the effect leaves the hand free, such as along a wall: the host corrects part of it.
FREE_WEIGHT = 0.5
TIE_BREAK = 1e-6  # weight of the squared impedances and tensions, as shares of the largest limits
MAX_GAP = 1e-5  # largest `optimality_gap` of an answer that counts as proved: 0.3 % of the largest stiffness


class CableRanges(NamedTuple):
    """Ranges of each cable, (m,) arrays.

    Tensions in N are at the present pose. Over the reach of a host's cycle the cable reels in by ``fall`` and pays
    out by ``rise``, in m, and its spring may not leave the limits there. A limit of stiffness (N/m) or damping (N
    s/m) that is 0 leaves a cable out.
    """

    lower: Floats
    upper: Floats
    stiffness: Floats
    damping: Floats
    fall: Floats
    rise: Floats


@dataclass(frozen=True, eq=False)
class ImpedanceField:
    """Impedances of all cables around one pose.

    Attributes
    ----------
    tensions, stiffness, damping : (m,) arrays
        Of the cables at this pose, in N, N/m and N s/m.
    force : (d,) array
        Force of the tensions in N: the desired one, or the nearest feasible one.
    multipliers : (d,) array
        Lagrange multipliers of that force, which certify the optimum together with the rest.
    gap : float
        Bound of `optimality_gap` on the distance to the optimum; above ``MAX_GAP`` the answer is not proved, and
        infinite where none was found, without stiffness.
    """

    tensions: Floats
    stiffness: Floats
    damping: Floats
    force: Floats
    multipliers: Floats
    gap: float


def allocate_field(
    structure: Floats, force: Floats, stiffness: Floats, damping: Floats, ranges: CableRanges
) -> ImpedanceField:
    """Return the impedances nearest to a desired stiffness and damping among those whose tensions give a force.

    It minimises ``|S (U diag(k) U' - K) S|²`` in the Frobenius norm, with U the structure matrix, subject to
    ``U t = f``, ``0 <= k <= limit`` and ``lower + fall k <= t <= upper - rise k``. ``S = (I + K/|K|)/2``
    halves the weight of directions that K leaves free. Among equals the smallest k and t count (`TIE_BREAK`).
    For the damping, the same without tensions. The method is a dual active-set (Goldfarb and Idnani 1983, "A
    numerically stable dual method for solving strictly convex quadratic programs").

    Parameters
    ----------
    structure : (d, m) array
        Structure matrix of a point: unit vectors towards the anchors.
    force : (d,) array
        Desired force in N. If no tensions give it, the nearest feasible one is used.
    stiffness, damping : (d, d) arrays
        Desired matrices, symmetric and without negative eigenvalues, in N/m and N s/m.
    ranges : CableRanges
        What each cable may do.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> from tensionlab.haptics.rendering.field import CableRanges, allocate_field
    >>> rig = tl.load_rig("cube-8")
    >>> U, normal, none = rig.structure_matrix(rig.home), np.array([0.0, 0.0, 1.0]), np.zeros(8)
    >>> out = normal @ U > 0.0  # cables that pull out of a wall
    >>> ranges = CableRanges(rig.limits.lower, rig.limits.upper, 500.0 * out, 10.0 * out, none, none)
    >>> wall = allocate_field(U, np.zeros(3), 200.0 * np.outer(normal, normal), np.zeros((3, 3)), ranges)
    >>> wall.stiffness.round()
    array([  0., 133.,   0., 133.,   0., 133.,   0., 133.])
    """
    return ImpedanceField(*_native.allocate_field(_problem(structure, force, stiffness, damping, ranges)))


def optimality_gap(
    structure: Floats,
    force: Floats,
    stiffness: Floats,
    damping: Floats,
    ranges: CableRanges,
    field: ImpedanceField,
) -> float:
    """Return a bound on how far a field is from the optimum of `allocate_field`, infinite outside the ranges.

    It holds for any field: the objective is convex, so its gradient bounds it from below, and the least of that
    bound over each cable's ranges is at a corner of them; the multipliers price the force. Arguments as those of
    `allocate_field`, with a feasible force. Unit: of the objective, as shares of the largest limits.
    """
    problem = _problem(structure, force, stiffness, damping, ranges)
    return _native.field_gap(problem, field.stiffness, field.damping, field.tensions, field.multipliers)


def _problem(
    structure: Floats, force: Floats, stiffness: Floats, damping: Floats, ranges: CableRanges
) -> tuple[Floats, Floats, Floats, Floats, float, float]:
    return (
        np.ascontiguousarray(structure),
        force,
        np.array([stiffness, damping]),
        np.array(ranges),
        FREE_WEIGHT,
        TIE_BREAK,
    )


class Prediction(NamedTuple):
    """What a hand feels, in N/m, as it goes against an axis.

    ``along`` the axis, ``added`` of it by the host; ``across``, where the host takes back a ``share``; ``error``,
    what is missing along and what remains across, as a share of the desired stiffness.
    """

    along: float
    across: float
    added: float
    share: float
    error: float


def predict(matrix: Floats, axis: Floats, stiffness: float, host_stiffness: float = math.inf) -> Prediction:
    """Return what a hand feels of the modules' stiffness matrix, with a stiffness desired along an axis.

    The host moves the rest lengths along a surface, and takes back force across, tau late. To a slow hand the
    springs A (along), c (coupling) and M (across) look like one along the axis and a damping matrix ``tau s [[0,
    c'], [c, M]]``, if the share s is taken back; what the host adds along, h, like ``-tau h``. With the hand's own
    b it is passive if ``(H - h)(H + s M) >= s² |c|²``, where ``H = b/tau`` is the host's own bound, and M is along
    c. So the host takes back what is passive, and then adds what is missing along the axis. For one cable at the
    angle a, ``s = H (1 + sqrt(1 + 4/tan² a))/2K``. This project's own.
    """
    return Prediction(*_native.predict_stiffness(matrix, axis, stiffness, host_stiffness))


def stable_share(matrix: Floats, axis: Floats, host_stiffness: float) -> float:
    """Return the share of a stiffness matrix that is stable across an axis, where the rest lengths are late.

    A spring M whose rest length follows the hand tau late is one of ``M (1 - cos(w tau))`` with a damper
    ``M sin(w tau)/w``, which drives the hand above half a cycle of tau. The lightest hand m stays below if
    ``2 M <= m (pi/tau)²``. ``host_stiffness`` determines tau.
    """
    late = MARGIN * HAND_DAMPING / host_stiffness
    return _native.stable_share(matrix, axis, MIN_HAND_MASS_KG, late)
