import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import ShapeError
from tensionlab.workspace.certified import Bounds, subdivide

REGION = [(-0.9, 0.9), (-0.8, 0.8)]


@pytest.fixture(scope="module")
def proved():
    return tl.workspace.certify(tl.load_rig("kntu-planar"), REGION, tl.Requirement(ball=8.0), 0.05)


def test_cells_tile_the_region(proved):
    assert proved.cell_volumes.sum() == pytest.approx(proved.region_volume)
    assert set(proved.verdict) == {1, -1, 0}
    assert (proved.level[proved.verdict == 0] == proved.subdivision.levels).all()
    inside = float(proved.cell_volumes[proved.verdict == 1].sum())
    outside = float(proved.cell_volumes[proved.verdict == -1].sum())
    assert inside <= proved.volume.lower <= proved.volume.upper <= proved.region_volume - outside + 1e-9


def test_positions_have_the_verdict_of_their_cell(proved):
    np.testing.assert_array_equal(proved.at(proved.centres), proved.verdict)
    corners = proved.centres + 0.499 * proved.edges
    np.testing.assert_array_equal(proved.at(corners), proved.verdict)
    assert proved.at([[0.0, 0.79], [0.0, -0.79], [0.0, 0.81], [0.0, -0.81]]).tolist() == [1, 1, 0, 0]
    assert proved.at([[0.0, 1.2], [1.1, 0.0], [-1.1, 0.0], [0.0, -1.2]]).tolist() == [0, 0, 0, 0]
    assert proved.at(np.zeros((4, 3, 2))).shape == (4, 3)
    with pytest.raises(ShapeError, match="position"):
        proved.at([0.0, 0.0, 0.0])


def test_bounds_stay_bounds_in_few_digits():
    assert Bounds(0.123456, 0.123451).describe() == "0.1234 to 0.1235"
    assert Bounds(1999.9, 2000.1).describe(2) == "1.9e+03 to 2.1e+03"
    assert Bounds(0.0, 1.0).describe() == "0 to 1"


def test_a_dataset_has_a_row_for_each_cell(proved):
    data = proved.to_xarray()
    assert data.sizes == {"cell": len(proved.verdict), "axis": 2}
    assert data.attrs["volume_lower"] == proved.volume.lower
    np.testing.assert_array_equal(data["verdict"], proved.verdict)
    np.testing.assert_allclose(data["centre"], proved.centres)
    assert data["edge"].attrs["units"] == "m"


def test_a_region_is_proved_if_all_of_it_is_inside_and_nothing_beyond_it(proved):
    assert not proved.proved
    region = [(0.1, 0.2), (0.1, 0.2)]
    whole = tl.workspace.certify(tl.load_rig("kntu-planar"), region, tl.Requirement(ball=2.0), 0.05)
    assert whole.proved
    at = [[0.15, 0.15], [0.2, 0.2], [0.21, 0.15], [0.15, 0.21], [0.09, 0.15]]
    assert whole.at(at).tolist() == [1, 1, 0, 0, 0]


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
