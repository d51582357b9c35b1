import numpy as np
import pytest

from tensionlab.errors import InputError
from tensionlab.model.module import Module
from tensionlab.model.requirement import Requirement
from tensionlab.workspace.layout import problem
from tensionlab.workspace.layout.objective import Objective, as_targets
from tensionlab.workspace.layout.problem import LayoutProblem
from tensionlab.workspace.layout.space import Placement, Space, Surface, room

CUBE = Space(room([2, 2, 2], centre=[0, 0, 0]), (4,), limits=(1.0, 5.0))
NAMES = [surface.name for surface in CUBE.surfaces]


def corners(signs):
    """Modules in corners of the cube, each on the floor or the ceiling."""
    surfaces = np.array([NAMES.index("ceiling" if y > 0 else "floor") for _, y, _ in signs])
    along = np.array([[(x + 1) / 2, (z + 1) / 2, 0] for x, _, z in signs])
    return Placement(surfaces[:, None], along[:, None])


ALTERNATE = [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]

MARGINS = np.array([[3.0, 2.0, 1.0, -1.0], [2.0, 2.0, 2.0, 2.5], [0.0, 0.0, 5.0, 5.0]])


def test_the_score_is_the_worst_margin_or_a_share_of_the_points():
    np.testing.assert_array_equal(Objective().score(MARGINS), [-1, 2, 0])
    np.testing.assert_array_equal(Objective(2.0).score(MARGINS), [0.5, 1, 0.5])
    assert Objective(2.0).score(MARGINS[0]) == 0.5


@pytest.mark.parametrize("climb", [Objective(2.0).merit, lambda margins: Objective(2.0).smooth(margins, 0.004)])
def test_what_is_climbed_ranks_by_share_then_by_what_is_missing_then_by_what_is_spare(climb):
    better = [
        [0.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0, 0.0],
        [2.0, 1.9, 0.0, 0.0],
        [2.0, 2.0, 0.0, 0.0],
        [2.0, 2.0, 2.0, 1.9],
        [2.0, 2.0, 2.0, 2.0],
        [2.1, 2.1, 2.1, 2.1],
    ]
    assert (np.diff(climb(np.array(better))) > 0).all()


def test_spare_force_counts_only_where_none_is_missing():
    merit = Objective(2.0).merit(np.array([[-1.0, 1.0], [0.0, 0.0]]))
    assert merit[0] == pytest.approx(merit[1])


@pytest.mark.parametrize("force", [0.0, -1.0, np.nan, np.inf])
def test_a_force_that_is_none_is_refused(force):
    with pytest.raises(InputError, match="give a force in N above zero"):
        Objective(force)


def test_the_margin_of_alternate_corners_at_the_centre_is_known():
    found = CUBE.cables(corners(ALTERNATE))
    np.testing.assert_array_equal(np.abs(found), 1.0)
    margin = LayoutProblem.of(CUBE, as_targets([[0, 0, 0]], 3), Objective()).values(found)
    np.testing.assert_allclose(margin, 4 * np.sqrt(2 / 3), atol=1e-12)


def test_many_layouts_at_once_are_each_one_alone(monkeypatch):
    rng = np.random.default_rng(0)
    places = CUBE.decode(rng.random((7, 5, 1, 4)))
    target = rng.uniform(-0.5, 0.5, size=(11, 3))
    objective = Objective(2.0, stiffness=300.0, walls=np.eye(3))
    searched = LayoutProblem.of(CUBE, as_targets(target, 3), objective)
    together = searched.values(CUBE.cables(places))
    assert together.shape == (7, 4, 11)
    for index in range(7):
        alone = CUBE.cables(Placement(places.surfaces[index], places.along[index]))
        np.testing.assert_array_equal(together[index], searched.values(alone))
    monkeypatch.setattr(problem, "MAX_CHUNK_POINTS", 20)
    np.testing.assert_array_equal(together, searched.values(CUBE.cables(places)))


@pytest.mark.parametrize("required", [Requirement(), Requirement(wrench=[1, 4, 0], box=[2, 0, 1], ball=0.5)])
@pytest.mark.parametrize("desired", [{}, {"directions": np.eye(3)}, {"walls": [[0.0, 1.0, 0.0]]}])
@pytest.mark.parametrize("seed", range(3))
def test_slopes_are_finite_differences(seed, desired, required):
    rng = np.random.default_rng(seed)
    fixed = Module("door", [0.9, -1, 0.3], 0.5, 4)
    box = Surface("box", [0.5, -0.9, 0.5], [[0.3, 0.1, 0], [0, 0.2, 0], [0, 0.1, 0.3]])
    rail = Surface("rail", [-0.9, -0.9, -0.9], [[0.1, 0.8, 0]])
    space = Space((*CUBE.surfaces, box, rail), (7,), limits=(1, 5), fixed=(fixed,), required=required)
    places = Placement(np.array([0, 1, 2, 3, 4, 6, 7])[:, None], rng.uniform(0.1, 0.9, size=(7, 1, 3)))
    target = rng.uniform(-0.4, 0.4, size=(5, 3))
    searched = LayoutProblem.of(space, as_targets(target, 3), Objective(**desired))
    margins, slopes, *_ = searched.linear(places, searched.poses)
    slopes = slopes.reshape(*margins.shape, 7, 3)
    np.testing.assert_allclose(margins, searched.values(space.cables(places)), atol=1e-12)
    step = 1e-6
    for module in range(7):
        for edge in range(3):
            moved = []
            for sign in (1, -1):
                along = places.along.copy()
                along[module, 0, edge] += sign * step
                there = Placement(places.surfaces, along)
                moved.append(searched.values(space.cables(there)))
            tolerance = 1e-3 if desired else 1e-7  # one-sided differences
            expected = (moved[0] - moved[1]) / (2 * step)
            np.testing.assert_allclose(slopes[:, :, module, edge], expected, rtol=1e-4, atol=tolerance)
    assert not slopes[:, :, 6, 1:].any()  # a rail has one edge
