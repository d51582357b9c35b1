import numpy as np
import pytest

from tensionlab.workspace.layout.objective import Objective, target_margins
from tensionlab.workspace.layout.polish import polish
from tensionlab.workspace.layout.space import Places, Space, Surface, room

WALLS = tuple(
    Surface(name, corner, [edge])
    for name, corner, edge in (
        ("south", [-1, -1], [2, 0]),
        ("east", [1, -1], [0, 2]),
        ("north", [-1, 1], [2, 0]),
        ("west", [-1, -1], [0, 2]),
    )
)
"""The walls of a flat room of 2 x 2 m around the origin."""


def test_three_modules_around_a_point_end_up_120_degrees_apart():
    """Three tensions from 1 N to 5 N span a hexagon with six sides of 4 N: none holds a larger disc than a regular
    one, of 4 N tan(60 degrees) / 2."""
    space = Space(WALLS, (3,), limits=(1.0, 5.0))
    limits = space.tension_limits(3)
    start = Places(np.array([0, 2, 3]), np.array([[0.9, 0], [0.8, 0], [0.3, 0]]))
    found, margins = polish(space, np.zeros((1, 2)), Objective(), start, limits)
    np.testing.assert_allclose(margins, 2 * np.sqrt(3), rtol=1e-4)
    x, y = space.anchors(found).T
    angles = np.sort(np.degrees(np.arctan2(y, x)))
    np.testing.assert_allclose(np.diff(angles), 120, atol=0.1)
    assert found.surfaces.tolist() == [0, 2, 3]


def test_a_share_is_polished_until_the_force_is_there_everywhere():
    space = Space(WALLS, (3,), limits=(1.0, 5.0))
    limits = space.tension_limits(3)
    x = np.linspace(-0.1, 0.1, 3)
    target = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    start = Places(np.array([0, 2, 3]), np.array([[0.9, 0], [0.3, 0], [0.9, 0]]))
    before = target_margins(space.anchors(start), limits, target)
    _, margins = polish(space, target, Objective(2.5), start, limits)
    assert (before >= 2.5).mean() < 0.1
    assert margins.min() > 2.5
    _, largest = polish(space, target, Objective(), start, limits)
    assert margins.min() == pytest.approx(largest.min(), rel=1e-3)  # with nothing missing, the worst is raised


def test_where_not_all_can_be_had_the_share_grows_all_the_same():
    space = Space(WALLS, (3,), limits=(1.0, 5.0))
    limits = space.tension_limits(3)
    x = np.linspace(-0.8, 0.8, 9)
    target = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    start = Places(np.array([0, 2, 3]), np.array([[0.9, 0], [0.3, 0], [0.9, 0]]))
    objective = Objective(2.0)
    before = objective.score(target_margins(space.anchors(start), limits, target))
    _, margins = polish(space, target, objective, start, limits)
    assert objective.score(margins) > before + 0.1


@pytest.mark.parametrize("force", [None, 0.5, 2.0, 9.0])
@pytest.mark.parametrize("seed", range(3))
def test_polishing_never_makes_it_worse_and_stays_on_the_surfaces(force, seed):
    space = Space(room([2, 2, 2], centre=[0, 0, 0]), (6,))
    rng = np.random.default_rng(seed)
    start = space.decode(rng.random((6, 4)))
    target = rng.uniform(-0.5, 0.5, size=(20, 3))
    limits, objective = space.tension_limits(6), Objective(force)
    before = target_margins(space.anchors(start), limits, target)
    found, margins = polish(space, target, objective, start, limits)
    np.testing.assert_allclose(margins, target_margins(space.anchors(found), limits, target), atol=1e-12)
    assert objective.smooth(margins, 0.01) >= objective.smooth(before, 0.01) - 1e-9
    assert ((found.along >= 0) & (found.along <= 1)).all()
    np.testing.assert_array_equal(found.surfaces, start.surfaces)
    if force is None:
        assert margins.min() > before.min() + 0.1


def test_no_layout_nearby_is_better_than_the_polished_one():
    space = Space(room([2, 2, 2], centre=[0, 0, 0]), (5,))
    rng = np.random.default_rng(4)
    target = rng.uniform(-0.3, 0.3, size=(8, 3))
    limits = space.tension_limits(5)
    start = Places(np.array([0, 1, 2, 3, 4]), rng.random((5, 3)))
    found, margins = polish(space, target, Objective(), start, limits)
    near = np.clip(found.along + rng.normal(scale=0.01, size=(4000, 5, 3)), 0, 1)
    others = space.anchors(Places(np.broadcast_to(found.surfaces, (4000, 5)), near))
    assert target_margins(others, limits, target).min(axis=-1).max() <= margins.min() + 1e-4
