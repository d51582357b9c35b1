import json

import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab.workspace import Grid
from tensionlab.workspace.sweep import dataset
from tensionlab.workspace.sweep.dataset import Summary, summarise
from tensionlab.workspace.volume import weighted_share


def test_a_metric_is_summarised():
    values = xr.DataArray([[-1.0, 0.0, np.nan], [2.0, 4.0, np.inf]])
    assert summarise(values) == Summary(6, 1, -1.0, 2.0, np.inf, 3 / 6)


def test_where_there_is_no_value_there_is_no_summary():
    found = summarise(xr.DataArray([np.nan, np.nan]))
    assert (found.poses, found.missing) == (2, 2)
    assert np.isnan([found.min, found.median, found.max, found.above_zero]).all()


@pytest.mark.parametrize("sample", [4_000_000, 60])
def test_a_store_is_read_chunk_by_chunk(tmp_path, monkeypatch, sample):
    monkeypatch.setattr(dataset, "MEDIAN_SAMPLE", sample)
    grid = Grid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 8), np.linspace(-1, 1, 7))
    rigs = [tl.box_corners([2, 2, 2]), tl.alternate_corners([2, 2, 2])]
    data = tl.sweep(rigs, grid, "capacity-margin", out=tmp_path / "a.zarr", chunk=20)["capacity-margin"]
    for number in range(2):
        found, whole = summarise(data[number]), data[number].values
        assert (found.poses, found.missing) == (504, np.isnan(whole).sum())
        assert (found.min, found.max) == (np.nanmin(whole), np.nanmax(whole))
        assert found.above_zero == pytest.approx(float(weighted_share(whole > 0, grid.weights())))
        assert found.median == pytest.approx(np.nanmedian(whole), abs=0 if sample > 504 else 0.1)


def test_a_sweep_is_told_from_others_by_rigs_poses_metrics_chunks_and_version():
    anchors = [(-1, -1), (1, -1), (0, 1)]
    modules = tuple(tl.Module(str(i), anchor, 0.5, 6.0) for i, anchor in enumerate(anchors))
    rig = tl.Rig("triangle", "planar-point", modules, np.zeros(2))
    names = ["capacity-margin", "least-singular-value", "reachable-share:2.0"]
    assert json.loads(tl.sweep(rig, Grid([0.0, 0.25], [-0.25, 0.0, 0.25]), names).sweep) == {
        "rigs": "3e6f6c00ed4e206d0569594ad44c387d92e71fffbd98be674f1ad4f6f4176500",
        "poses": "bf362342d92c98d69ffa84c44d407b147f63501cdc8b48f545b78d412a3e9743",
        "metrics": {
            "capacity-margin": "CapacityMargin(radius=0.0)",
            "least-singular-value": "LeastSingularValue()",
            "reachable-share:2.0": "ReachableShare(magnitude=2.0, count=200)",
        },
        "chunks": [1, 2, 3],
        "version": tl.__version__,
    }
