"""The duels of search against builders, with small budgets."""

import numpy as np
import pytest

from tensionlab.experiments import room_layouts
from tensionlab.model.layouts import ring_plus_top
from tensionlab.workspace import Objective, Space, box, capacity_margin, room, search_layout

CUBE = box((-0.3, 0.3), (0.95, 1.55), (-0.3, 0.3), step=0.3).arrays()[0]


def test_the_triangle_is_the_published_one_and_fits_the_room():
    rig = room_layouts.best_triangle_and_top(CUBE, Objective(), seed=0)
    assert (np.abs(rig.anchors[:, ::2]) <= 2 + 1e-6).all()
    np.testing.assert_allclose(rig.anchors[:, 1], [0, 0, 0, 2.5], atol=1e-12)
    sides = np.linalg.norm(rig.anchors[:3] - np.roll(rig.anchors[:3], 1, axis=0), axis=1)
    np.testing.assert_allclose(sides, sides[0], rtol=1e-12)
    np.testing.assert_allclose(rig.anchors[3, ::2], rig.anchors[:3, ::2].mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("objective", [Objective(), Objective(force=1.0)])
def test_no_scale_of_the_triangle_alone_is_better_than_the_best_one(objective):
    """Searched over scale, turn and shift, it is no worse than over a grid of scales."""
    low = box((-0.3, 0.3), (0.3, 0.9), (-0.3, 0.3), step=0.3).arrays()[0]
    best = room_layouts.best_triangle_and_top(low, objective, seed=0)
    reached = objective.score(capacity_margin(best.structure_matrix(low), best.limits))
    for side in np.linspace(0.5, 3.4, 30):
        rig = ring_plus_top(side, height=0.5, top=2.0)
        assert objective.score(capacity_margin(rig.structure_matrix(low), rig.limits)) <= reached + 1e-9


@pytest.mark.parametrize("count", [4, 8])
def test_a_short_search_beats_what_people_build(count):
    space = Space(room(room_layouts.SIZE), (count,))
    found = search_layout(space, CUBE, Objective(), seed=1, generations=10, starts=6).best
    if count == 4:
        rival = room_layouts.best_triangle_and_top(CUBE, Objective(), seed=1)
    else:
        rival = room_layouts.room_corners()
    built = capacity_margin(rival.structure_matrix(CUBE), rival.limits).min()
    assert found.score > built + 0.5
