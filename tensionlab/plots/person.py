"""A light sketch of a person: a stick figure that stands somewhere, with hands, head and more where they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SKIN = "#D3D3D3"
HEIGHTS = {"hip": 0.92, "shoulder": 1.42, "head": 1.66}
"""Of the joints of who stands upright, in m, unless they are known to be elsewhere."""
LIMB = 0.30
"""Of an upper arm, and of a forearm with half a hand, in m."""
BROAD, STANCE, HEAD = 0.18, 0.12, 0.10
"""From the middle to a shoulder, from the middle to a foot, and of the head's radius, in m."""


class Place(NamedTuple):
    """Where is what somebody calls so?

    "hand", "head", "torso" (between the shoulders), "shoulder", "hip" or "foot" in its name tell what it is.
    """

    name: str
    where: Floats


def draw_person(
    axes: Axes, view: Callable[[Floats], Floats], up: int, stands: Floats, places: Sequence[Place]
) -> None:
    """Draw somebody.

    Parameters
    ----------
    axes : Axes
    view : callable
        Where points (..., 3) are seen, (..., 2).
    up : int
        Which axis of the world is up.
    stands : (3,) array
        Between the feet.
    places : sequence of Place
        What is known.
    """
    from matplotlib.patches import Circle

    above = np.eye(3)[up]
    known = {
        part: [place.where for place in places if part in place.name]
        for part in (*HEIGHTS, "torso", "hand", "foot")
    }
    hips, shoulders, head = (_middle(known[part], stands + height * above) for part, height in HEIGHTS.items())
    ahead = _level(_middle(known["hand"], shoulders) - stands, up)
    left = np.cross(above, ahead)
    if len(known["shoulder"]) == 1:  # the right one or the left one
        side = np.sign(left @ (known["shoulder"][0] - stands))
        shoulders = shoulders - side * BROAD * left
    shoulders = _middle(known["torso"], shoulders)
    neck = (HEIGHTS["head"] - HEIGHTS["shoulder"]) * above
    if known["head"] and not (known["shoulder"] or known["torso"]):
        shoulders = head - neck
    if not known["head"]:
        head = shoulders + neck
    feet = known["foot"] or [stands + side * STANCE * (left + ahead) for side in (1.0, -1.0)]
    lines = [[hips, foot] for foot in feet] + [[hips, shoulders, head]]
    ends = [shoulders + side * BROAD * left for side in (-1.0, 1.0)]
    lines.append(ends)
    hands = known["hand"] + [end - 2 * LIMB * above for end in ends][len(known["hand"]) :]
    hands = list(min(permutations(hands[:2]), key=lambda pair: sum(map(_apart, ends, pair))))
    lines += [[end, _elbow(end, hand, -above), hand] for end, hand in zip(ends, hands, strict=True)]
    look: dict[str, Any] = {"color": SKIN, "linewidth": 7.0, "solid_capstyle": "round", "solid_joinstyle": "round"}
    for line in lines:
        axes.plot(*view(np.array(line)).T, **look, zorder=1)
    axes.add_patch(Circle(tuple(view(head)), HEAD, color=SKIN, linewidth=0.0, zorder=1))


def _middle(places: Sequence[Floats], otherwise: Floats) -> Floats:
    return np.mean(places, axis=0) if places else otherwise


def _apart(one: Floats, other: Floats) -> float:
    return float(np.linalg.norm(one - other))


def _level(arm: Floats, up: int) -> Floats:
    """Which way does it point, along the floor? Along x if it points nowhere."""
    flat = np.where(np.arange(3) == up, 0.0, arm)
    size = np.linalg.norm(flat)
    return np.asarray(flat / size if size > 1e-6 else np.eye(3)[0])


def _elbow(shoulder: Floats, hand: Floats, down: Floats) -> Floats:
    """Where is the elbow, if it hangs?"""
    arm = hand - shoulder
    size = float(np.linalg.norm(arm))
    middle = shoulder + arm / 2
    if size >= 2 * LIMB or size == 0.0:
        return middle
    hanging = down - (down @ arm) / size**2 * arm
    if (long := float(np.linalg.norm(hanging))) > 1e-6:
        middle = middle + hanging / long * np.sqrt(LIMB**2 - size**2 / 4)
    return middle
