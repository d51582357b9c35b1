"""`tensionlab log`: what a stranger would type."""

import json

import pyarrow.parquet as pq
import pytest
import xarray

from tensionlab.hardware.runner.cycle_table import COLUMNS
from tests.helpers import runs


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.seven(), 120, solver="dykstra", lost=2)
    return file


def test_info_says_how_the_run_went(run, file):
    code, out, _ = run("log", "info", file)
    assert code == 0
    for words in (
        "seven-modules, dykstra, nearest in tension",
        "120 in 2.38 s, 50 Hz desired",
        "stopped by the demand",
        "fault ENCODER, lost at 1.200 s",
        "lost: back-floor: module",
    ):
        assert words in out, words


def test_info_says_that_a_log_was_cut_off(run, file, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[:-100])
    code, out, _ = run("log", "info", cut)
    assert code == 0
    assert "the log was never closed" in out


def test_info_for_programs(run, file):
    found = json.loads(run("log", "info", file, "--json")[1])
    assert found["statuses"].keys() == {"EXACT", "NEAREST", "UNPROVEN", "FAILED"}
    assert found["modules"][2]["faults"] == ["ENCODER"]
    assert found["manifest"] == runs.MANIFEST
    assert found["setup"]["parameters"]["tolerance"] == 1e-9


def test_export_to_netcdf(run, file, tmp_path):
    code, out, _ = run("log", "export", file, "--out", tmp_path / "run.nc")
    assert (code, out) == (0, f"{tmp_path / 'run.nc'}: 120 cycles\n")
    with xarray.open_dataset(tmp_path / "run.nc", engine="scipy") as dataset:
        assert set(COLUMNS) - {"frames"} <= set(dataset.variables)  # no module rides on a frame
        assert json.loads(dataset.attrs["manifest"]) == runs.MANIFEST
        assert dataset.lengths.attrs["units"] == "m"
        assert dataset.lengths.sel(module="back-floor").shape == (120,)


def test_export_to_parquet(run, file, tmp_path):
    code, _, _ = run("log", "export", file, "--out", tmp_path / "run.parquet")
    assert code == 0
    table = pq.read_table(tmp_path / "run.parquet")
    assert table.num_rows == 120
    assert {"cycle", "chosen.back-floor", "structure.Fx.back-floor", "desired.Fz"} <= set(table.column_names)
    assert json.loads(table.schema.metadata[b"tensionlab"]) == runs.MANIFEST


def test_a_run_without_a_cycle_is_refused_before_a_page_is_served(run, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.viewer.server.PageServer", lambda **how: pytest.fail("it was served"))
    runs.logged(tmp_path / "empty.mcap", runs.four(), 0)
    code, out, err = run("log", "view", tmp_path / "empty.mcap")
    assert (code, out) == (2, "")
    assert "empty.mcap: the run ended before its first cycle; there is nothing to show" in " ".join(err.split())
