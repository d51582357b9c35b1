"""Rigs by rule: rings with a module on top, and boxes. All are point rigs with the Y axis up."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import RigError
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, as_floats

LIMITS = (0.5, 6.0)  # tension limits of the published module, in N (Bartels et al. 2026).

UNITS = {"side": "m", "height": "m", "top": "m", "size": "m", "count": "1"}  # by parameter of the layouts


def ring_plus_top(
    side: float,
    count: int = 3,
    height: float = 0.3,
    top: float | None = 2.0,
    limits: tuple[float, float] = LIMITS,
) -> Rig:
    """Return a rig with modules at the corners of a regular polygon on the floor, and one above its centre.

    The floor is y = 0, its centre the origin, and the first corner lies on the X axis. The point is at home above
    the centre. Three corners and a top are the published validation rig (Bartels et al. 2026). RigError if the
    polygon has fewer than two corners, or the side is not a positive number.

    Parameters
    ----------
    side : float
        Distance between neighbouring corners, in m.
    count : int
        Number of corners, 2 or more.
    height : float
        Of the home position above the floor, in m.
    top : float or None
        Height of the top module above the home position, in m; None for a ring alone.
    limits : (lower, upper)
        Tension limits of every module, in N.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.ring_plus_top(side=1.0).anchors.round(3)
    array([[ 0.577,  0.   ,  0.   ],
           [-0.289,  0.   ,  0.5  ],
           [-0.289,  0.   , -0.5  ],
           [ 0.   ,  2.3  ,  0.   ]])
    """
    if count < 2:
        raise RigError(f"ring_plus_top: count is {count}; a ring has two corners or more")
    if not (np.isfinite(side) and side > 0):
        raise RigError(f"ring_plus_top: side is {side}; give a finite length in m, above zero")
    angles = 2 * np.pi * np.arange(count) / count
    ring = side / (2 * np.sin(np.pi / count)) * np.stack([np.cos(angles), 0 * angles, np.sin(angles)], axis=-1)
    places = {f"floor-{number}": corner for number, corner in enumerate(ring, start=1)}
    if top is not None:
        places["top"] = np.array([0.0, height + top, 0.0])
    return _rig(f"ring-{count}" if top is None else f"ring-{count}-plus-top", places, [0.0, height, 0.0], limits)


def box_corners(size: Sequence[float], limits: tuple[float, float] = LIMITS) -> Rig:
    """Return a rig with modules at all eight corners of a box, with edges ``size`` along X, Y and Z, in m.

    The box is centred on the origin, where the point is at home. Tension limits are in N. RigError if the size is
    not three positive numbers.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.box_corners([3.0, 2.4, 4.0], limits=(1.0, 20.0))
    >>> rig.m, rig.modules[0].name
    (8, 'x- y- z-')
    """
    return _rig("box-corners", _corners(size), [0.0, 0.0, 0.0], limits)


def alternate_corners(size: Sequence[float], limits: tuple[float, float] = LIMITS) -> Rig:
    """Return a rig with modules at every other corner of a box, as the first SPIDAR had.

    The four corners whose coordinates multiply to a positive number; no two share an edge. Four cables are
    the fewest that can pull a point in every direction (Ishii & Sato 1994, SPIDAR). ``size``, ``limits`` and
    errors as in `box_corners`.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.alternate_corners([2.0, 2.0, 2.0]).anchors
    array([[-1., -1.,  1.],
           [-1.,  1., -1.],
           [ 1., -1., -1.],
           [ 1.,  1.,  1.]])
    """
    places = {name: corner for name, corner in _corners(size).items() if np.prod(np.sign(corner)) > 0}
    return _rig("alternate-corners", places, [0.0, 0.0, 0.0], limits)


def _corners(size: Sequence[float]) -> dict[str, Floats]:
    """Return the corners of a box by the names of their signs, as in "x- y+ z+"."""
    edges = as_floats("box corners: size", size)
    if edges.shape != (3,) or not (np.isfinite(edges) & (edges > 0)).all():
        raise RigError(f"box corners: size is {size!r}; give three finite lengths in m, above zero")
    signs = product((-1, 1), repeat=3)
    return {
        " ".join(axis + ("+" if s > 0 else "-") for axis, s in zip("xyz", corner, strict=True)): edges / 2 * corner
        for corner in signs
    }


def _rig(name: str, places: dict[str, Floats], home: ArrayLike, limits: tuple[float, float]) -> Rig:
    lower, upper = limits
    modules = tuple(Module(key, anchor, lower, upper) for key, anchor in places.items())
    return Rig(name=name, kind="point", modules=modules, home=as_floats("home", home), up="y")
