"""Names beside points, placed so that they cover neither each other nor the points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.arrays import Floats

FONT_SIZE = 8.0
"""Of the letters, in points."""
DISTANCES = (7.0, 14.0, 24.0, 36.0, 50.0)
"""Distances of a name from its point that are tried, in points."""
POINT_RADIUS = 5.0
"""Half the size of a point, in points."""
DIRECTIONS = 16
"""Directions that are tried at each distance."""


def label_points(figure: Figure, axes: Axes, points: Mapping[str, Sequence[tuple[float, float]]]) -> None:
    """Write each name beside the first of its points, where least is in the way.

    Parameters
    ----------
    figure, axes
        Complete but for the names: where things are is known only then.
    points : mapping of str to sequence of (x, y)
        In data coordinates. No name covers any of them.
    """
    figure.draw_without_rendering()
    scale = 72.0 / figure.dpi
    frame = scale * axes.get_window_extent().get_points()

    def in_points(ends: Sequence[tuple[float, float]]) -> Floats:
        return np.asarray(scale * axes.transData.transform(np.array(ends)))

    places = {name: in_points(ends) for name, ends in points.items()}
    taken = [
        np.concatenate([place - POINT_RADIUS, place + POINT_RADIUS]) for ends in places.values() for place in ends
    ]
    # Those in a crowd first: they have the least choice.
    crowd = {
        name: -sum(np.hypot(*(box[:2] + POINT_RADIUS - ends[0])) < 40.0 for box in taken)
        for name, ends in places.items()
    }
    for name in sorted(points, key=lambda name: (crowd[name], name)):
        place = places[name][0]
        others = np.concatenate([np.zeros((0, 2)), *(ends for other, ends in places.items() if other != name)])
        width, height = 0.6 * FONT_SIZE * len(name), 1.2 * FONT_SIZE
        best = min(_places(place, width, height), key=lambda box: _cost(box, place, others, taken, frame))
        taken.append(best)
        middle = (best[:2] + best[2:]) / 2
        far = np.hypot(*(middle - place)) > max(width, height) / 2 + 12.0
        axes.annotate(
            name, points[name][0], xytext=middle - place, textcoords="offset points", ha="center", va="center",
            fontsize=FONT_SIZE, color="#222222", zorder=5,
            arrowprops={"arrowstyle": "-", "color": "#999999", "linewidth": 0.6, "shrinkB": 3} if far else None,
        )  # fmt: skip


def _places(place: Floats, width: float, height: float) -> list[Floats]:
    """Return boxes (left, bottom, right, top) around a point that a name could fill, in points."""
    boxes, half = [], np.array([width / 2, height / 2])
    for away in DISTANCES:
        for turn in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            toward = np.array([np.cos(turn), np.sin(turn)])
            middle = place + toward * (away + np.abs(toward) @ half)
            boxes.append(np.concatenate([middle - half, middle + half]))
    return boxes


def _cost(box: Floats, place: Floats, other_points: Floats, taken: list[Floats], frame: Floats) -> float:
    """Return the cost of a place: what it covers, what sticks out, its distance, how much nearer others are."""
    others = np.array(taken)
    overlap = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    covered = float(np.prod(np.maximum(overlap, 0.0), axis=1).sum())
    outside = float(np.maximum(frame[0] - box[:2], 0.0).sum() + np.maximum(box[2:] - frame[1], 0.0).sum())
    own = float(_distance(box, place[None])[0])
    closer = float(np.maximum(own + 6.0 - _distance(box, other_points), 0.0).sum())
    return 100.0 * (covered + outside) + 3.0 * closer + own


def _distance(box: Floats, places: Floats) -> Floats:
    """Return the distance of each place from the box."""
    return np.asarray(np.linalg.norm(np.maximum(np.maximum(box[:2] - places, places - box[2:]), 0.0), axis=1))
