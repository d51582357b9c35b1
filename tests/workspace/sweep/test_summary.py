import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab.workspace import Grid
from tensionlab.workspace.shares import weighted_share
from tensionlab.workspace.sweep import dataset

RIGS = [tl.box_corners([2, 2, 2]), tl.alternate_corners([2, 2, 2])]


def swept(values):
    """A sweep of one rig with these values at a list of poses."""
    values = xr.DataArray(np.asarray(values, float), dims="pose", attrs={"units": "N"})
    return xr.Dataset({"a": values}, coords={"rig": "one", "kind": "point"})


def test_a_metric_is_summarised():
    (row,) = tl.workspace.summary(swept([-1.0, 0.0, np.nan, 2.0, 4.0, np.inf])).to_dict("records")
    statistics = {"min": -1.0, "median": 2.0, "max": np.inf, "above_zero": 3 / 6}
    assert row == {"rig": "one", "metric": "a", "unit": "N", "poses": 6, "missing": 1, **statistics}


def test_where_there_is_no_value_there_is_no_summary():
    (row,) = tl.workspace.summary(swept([np.nan, np.nan])).to_dict("records")
    assert (row["poses"], row["missing"]) == (2, 2)
    assert np.isnan([row[key] for key in ("min", "median", "max", "above_zero")]).all()


@pytest.mark.parametrize("sample", [4_000_000, 60])
def test_a_store_is_summarised_in_parts(tmp_path, monkeypatch, sample):
    monkeypatch.setattr(dataset, "MEDIAN_SAMPLE", sample)
    grid = Grid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 8), np.linspace(-1, 1, 7))
    data = tl.sweep(RIGS, grid, "capacity-margin", out=tmp_path / "a.zarr", chunk=20)
    for (_, row), whole in zip(tl.workspace.summary(data).iterrows(), data["capacity-margin"].values, strict=True):
        assert (row["poses"], row["missing"]) == (504, np.isnan(whole).sum())
        assert (row["min"], row["max"]) == (np.nanmin(whole), np.nanmax(whole))
        assert row["above_zero"] == pytest.approx(float(weighted_share(whole > 0, grid.weights())))
        assert row["median"] == pytest.approx(np.nanmedian(whole), abs=0 if sample > 504 else 0.1)


def test_configurations_are_named_after_what_tells_them_apart():
    poses = [[0.0, 0.3, 0.0]]
    varied = tl.workspace.vary(tl.ring_plus_top, side=[1.0], count=[3, 4])
    names = [
        tl.workspace.summary(tl.sweep(each, poses, "wrench-closure"))["rig"].tolist() for each in (RIGS, varied)
    ]
    assert names == [[rig.name for rig in RIGS], ["count 3", "count 4"]]
