"""Stick figure of a person, for pictures of scenarios: where the joints are, as far as parts are known."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from tensionlab.support.arrays import Floats

# Heights of the joints of a standing person, unless they are known to be elsewhere.
JOINT_HEIGHTS_M = {"hip": 0.92, "shoulder": 1.42, "head": 1.66}
LIMB_M = 0.30  # length of an upper arm, and of a forearm with half a hand
# From the middle to a shoulder, from the middle to a foot, and of the head's radius.
SHOULDER_M, STANCE_M, HEAD_M = 0.18, 0.12, 0.10


class StickFigure(NamedTuple):
    """Limbs and trunk as lines (k, 3) through joints, and the middle of the head (3,), in m."""

    lines: list[Floats]
    head: Floats


def stick_figure(feet: Floats, up: Floats, places: Sequence[tuple[str, Floats]]) -> StickFigure:
    """Return a person who stands at a place between its feet, with its known parts where they are.

    Parameters
    ----------
    feet : (3,) array
        In m.
    up : (3,) array
        Unit vector.
    places : sequence of names and places (3,)
        "hand", "head", "torso" (between the shoulders), "shoulder", "hip" or "foot" in a name tells the part.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.scenarios.stick_figure import stick_figure
    >>> stick_figure(np.zeros(3), np.array([0.0, 0.0, 1.0]), []).head
    array([0.  , 0.  , 1.66])
    """
    parts = (*JOINT_HEIGHTS_M, "torso", "hand", "foot")
    known = {part: [place for name, place in places if part in name] for part in parts}

    def mean_of(part: str, otherwise: Floats) -> Floats:
        return np.mean(known[part], axis=0) if known[part] else otherwise

    hips, shoulders, head = (mean_of(part, feet + height * up) for part, height in JOINT_HEIGHTS_M.items())
    towards = mean_of("hand", shoulders) - feet
    ahead = towards - (towards @ up) * up  # along the floor
    length = np.linalg.norm(ahead)
    ahead = ahead / length if length > 1e-6 else np.roll(np.abs(up), 1)
    left = np.cross(up, ahead)
    if len(known["shoulder"]) == 1:  # the right one or the left one
        shoulders = shoulders - np.sign(left @ (known["shoulder"][0] - feet)) * SHOULDER_M * left
    shoulders = mean_of("torso", shoulders)
    neck = (JOINT_HEIGHTS_M["head"] - JOINT_HEIGHTS_M["shoulder"]) * up
    if known["head"] and not (known["shoulder"] or known["torso"]):
        shoulders = head - neck
    if not known["head"]:
        head = shoulders + neck
    soles = known["foot"] or [feet + side * STANCE_M * (left + ahead) for side in (1.0, -1.0)]
    ends = [shoulders + side * SHOULDER_M * left for side in (-1.0, 1.0)]
    hands = known["hand"] + [end - 2 * LIMB_M * up for end in ends][len(known["hand"]) :]
    pairs = [list(pair) for pair in permutations(hands[:2])]
    hands = min(pairs, key=lambda pair: float(np.linalg.norm(np.array(ends) - np.array(pair), axis=1).sum()))
    lines = [*([hips, foot] for foot in soles), [hips, shoulders, head], ends]
    lines += [[end, _elbow(end, hand, -up), hand] for end, hand in zip(ends, hands, strict=True)]
    return StickFigure([np.array(line) for line in lines], head)


def _elbow(shoulder: Floats, hand: Floats, down: Floats) -> Floats:
    """Return where the elbow hangs."""
    arm = hand - shoulder
    size, middle = float(np.linalg.norm(arm)), shoulder + arm / 2
    if size >= 2 * LIMB_M or size == 0.0:
        return middle
    hanging = down - (down @ arm) / size**2 * arm
    if (length := float(np.linalg.norm(hanging))) > 1e-6:
        middle = middle + hanging / length * np.sqrt(LIMB_M**2 - size**2 / 4)
    return middle
