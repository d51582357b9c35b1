import numpy as np
import pytest

from tensionlab.workspace.certification.result import subdivide


@pytest.mark.parametrize("resolution", [0.3, 0.05, [0.1, 0.02, 0.3]])
def test_the_finest_cells_are_no_longer_than_the_resolution(resolution):
    cells = subdivide([(-1.0, 1.0), (0.0, 0.5), (2.0, 3.7)], resolution, 3)
    edges = cells.edges(cells.levels)
    assert (edges <= np.asarray(resolution) * (1 + 1e-9)).all()
    assert (edges > 0.6 * np.asarray(resolution)).all() or cells.levels == 0
    assert cells.volume == pytest.approx(2 * 0.5 * 1.7)


@pytest.mark.parametrize("scale", [1.0, 1e-5])
def test_cells_fill_the_region_and_children_their_parents(scale):
    cells = subdivide(scale * np.array([(-1.0, 1.0), (0.0, 0.5)]), 0.05 * scale, 2)
    assert cells.volume == pytest.approx(scale**2)
    places = cells.first()
    for level in range(3):
        assert len(places) * cells.cell_volume(level) == pytest.approx(cells.volume)
        assert len(np.unique(places, axis=0)) == len(places)
        np.testing.assert_array_equal(cells.place_of(level, cells.centres(level, places)), places)
        children = cells.children(places)
        np.testing.assert_array_equal(
            cells.place_of(level, cells.centres(level + 1, children)), np.repeat(places, 4, axis=0)
        )
        places = children


def test_an_axis_without_extent_is_not_cut():
    cells = subdivide([(-1.0, 1.0), (0.3, 0.3), (0.0, 1.0)], 0.1, 3)
    assert cells.roots[1] == 1
    assert cells.edges(cells.levels)[1] == 0.0
    assert (cells.centres(1, cells.children(cells.first()))[:, 1] == 0.3).all()
    assert cells.volume == 2.0
