import numpy as np
import pytest

from tensionlab.model.module import Module
from tensionlab.workspace.layout import place
from tensionlab.workspace.layout.place import Places
from tensionlab.workspace.layout.space import Space, Surface, room

CUBE = Space(room([2, 2, 2], centre=[0, 0, 0]), (4,), limits=(1.0, 5.0))
NAMES = [surface.name for surface in CUBE.surfaces]


def corners(signs):
    """Modules in corners of the cube, each on the floor or the ceiling."""
    surfaces = np.array([NAMES.index("ceiling" if y > 0 else "floor") for _, y, _ in signs])
    along = np.array([[(x + 1) / 2, (z + 1) / 2, 0] for x, _, z in signs])
    return Places(surfaces, along)


ALTERNATE = [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]


def test_genes_pick_surfaces_evenly_and_reach_the_ends_of_edges():
    genes = np.zeros((6, 1, 4))
    genes[:, 0, 0] = (np.arange(6) + 0.5) / 6
    assert place.decode(CUBE, genes).surfaces[:, 0].tolist() == list(range(6))
    last = place.decode(CUBE, np.ones((1, 1, 4)))
    assert last.surfaces.item() == 5
    middle = place.decode(CUBE, np.full((1, 1, 4), 0.5))
    np.testing.assert_allclose(middle.along, 0.5)
    along = place.decode(CUBE, np.linspace(0, 1, 101)[:, None, None] * np.ones(4)).along[:, 0, 0]
    assert (along == 0).sum() > 5
    assert (along == 1).sum() > 5
    assert (np.diff(along) >= 0).all()


def test_anchors_lie_on_their_surfaces_with_the_fixed_ones_last():
    fixed = Module("door", [0.9, -1, 0.3], 0, 9)
    space = Space((Surface("rail", [0, 0, 0], [[0, 3, 0]]),), (2,), limits=(1, 5), fixed=(fixed,))
    found = place.anchors(space, Places(np.zeros(2, int), np.array([[0.5, 0.9, 0.9], [1, 0, 0]])))
    np.testing.assert_array_equal(found, [[0, 1.5, 0], [0, 3, 0], [0.9, -1, 0.3]])
    limits = place.limits(space, 2)
    assert limits.lower.tolist() == [1, 1, 0]
    assert limits.upper.tolist() == [5, 5, 9]


def test_the_margin_of_alternate_corners_at_the_centre_is_known():
    found = place.anchors(CUBE, corners(ALTERNATE))
    np.testing.assert_array_equal(np.abs(found), 1)
    margin = place.margins(found, place.limits(CUBE, 4), np.zeros((1, 3)))
    np.testing.assert_allclose(margin, 4 * np.sqrt(2 / 3), atol=1e-12)


def test_many_layouts_at_once_are_each_one_alone(monkeypatch):
    rng = np.random.default_rng(0)
    places = place.decode(CUBE, rng.random((7, 5, 4)))
    target = rng.uniform(-0.5, 0.5, size=(11, 3))
    limits = place.limits(CUBE, 5)
    together = place.margins(place.anchors(CUBE, places), limits, target)
    assert together.shape == (7, 11)
    for index in range(7):
        alone = place.anchors(CUBE, Places(places.surfaces[index], places.along[index]))
        np.testing.assert_array_equal(together[index], place.margins(alone, limits, target))
    monkeypatch.setattr(place, "CHUNK", 20)
    np.testing.assert_array_equal(together, place.margins(place.anchors(CUBE, places), limits, target))


@pytest.mark.parametrize("seed", range(3))
def test_slopes_are_finite_differences(seed):
    rng = np.random.default_rng(seed)
    fixed = Module("door", [0.9, -1, 0.3], 0.5, 4)
    box = Surface("box", [0.5, -0.9, 0.5], [[0.3, 0.1, 0], [0, 0.2, 0], [0, 0.1, 0.3]])
    rail = Surface("rail", [-0.9, -0.9, -0.9], [[0.1, 0.8, 0]])
    space = Space((*CUBE.surfaces, box, rail), (7,), limits=(1, 5), fixed=(fixed,))
    places = Places(np.array([0, 1, 2, 3, 4, 6, 7]), rng.uniform(0.1, 0.9, size=(7, 3)))
    limits = place.limits(space, 7)
    target = rng.uniform(-0.4, 0.4, size=(5, 3))
    margins, slopes = place.slopes(space, places, limits, target)
    np.testing.assert_allclose(margins, place.margins(place.anchors(space, places), limits, target), atol=1e-12)
    step = 1e-6
    for module in range(7):
        for edge in range(3):
            moved = []
            for sign in (1, -1):
                along = places.along.copy()
                along[module, edge] += sign * step
                there = Places(places.surfaces, along)
                moved.append(place.margins(place.anchors(space, there), limits, target))
            np.testing.assert_allclose(slopes[:, module, edge], (moved[0] - moved[1]) / (2 * step), atol=1e-7)
    assert not slopes[:, 6, 1:].any()  # a rail has one edge
