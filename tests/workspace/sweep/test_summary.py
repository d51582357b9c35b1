import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab.workspace import Grid
from tensionlab.workspace.sweep import summary
from tensionlab.workspace.sweep.summary import Summary, summarise


def test_a_measure_is_summed_up():
    values = xr.DataArray([[-1.0, 0.0, np.nan], [2.0, 4.0, np.inf]])
    assert summarise(values) == Summary(6, 1, -1.0, 2.0, np.inf, 3 / 5)


def test_where_there_is_no_value_there_is_no_summary():
    found = summarise(xr.DataArray([np.nan, np.nan]))
    assert (found.poses, found.missing) == (2, 2)
    assert np.isnan([found.least, found.median, found.largest, found.above_zero]).all()


@pytest.mark.parametrize("sample", [4_000_000, 60])
def test_a_store_is_read_chunk_by_chunk(tmp_path, monkeypatch, sample):
    monkeypatch.setattr(summary, "SAMPLE", sample)
    grid = Grid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 8), np.linspace(-1, 1, 7))
    rigs = [tl.box_corners([2, 2, 2]), tl.alternate_corners([2, 2, 2])]
    data = tl.sweep(rigs, grid, "capacity-margin", out=tmp_path / "a.zarr", chunk=20)["capacity-margin"]
    for number in range(2):
        found, whole = summarise(data[number]), data[number].values
        assert (found.poses, found.missing) == (504, np.isnan(whole).sum())
        assert (found.least, found.largest) == (np.nanmin(whole), np.nanmax(whole))
        assert found.above_zero == np.mean(whole[~np.isnan(whole)] > 0)
        assert found.median == pytest.approx(np.nanmedian(whole), abs=0 if sample > 504 else 0.1)
