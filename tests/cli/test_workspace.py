import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tensionlab as tl

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
CUBE, TETRA = RIGS / "cube-8.toml", RIGS / "tetra-4.toml"
PLANAR = RIGS / "kntu-planar.toml"


@pytest.fixture
def run(run):
    """Run `tensionlab workspace` in this process: exit status, stdout, stderr."""
    return lambda *words: run("workspace", *words)


def test_a_table_says_how_well_each_rig_does_and_what_that_means(run):
    code, out, err = run(CUBE, TETRA, "--step", 0.1)
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 120
    assert "1,331 poses, 0.1 m apart: x -0.5 to 0.5 m, y -0.5 to 0.5 m, z -0.5 to 0.5 m" in out
    rows = [line.split() for line in out.splitlines()]
    (cube,) = [row for row in rows if row[:2] == ["cube-8", "wrench-closure"]]
    assert cube[2:5] == ["0", "1.00", "1.00"]
    (tetra,) = [row for row in rows if row[:2] == ["tetra-4", "wrench-closure"]]
    assert 15.0 < float(tetra[-3]) < 100 / 3  # the inside of a third of the box, less its surface
    assert sum(row[1:3] == ["isotropic-force", "N"] for row in rows) == 2
    assert "wrench-closure: Whether cables of unlimited strength" in out
    assert "no value: a cable has no length there" in out


def test_json_has_the_numbers_and_where_they_come_from(run):
    words = ["--box", -0.4, 0.4, "-0.4", 0.4, 0.1, 0.1, "--step", 0.1, 0.2, 1, "--metric", "capacity-margin:0.2"]
    code, out, _ = run(CUBE, *words, "--metric", "condition-number,tension-factor", "--json")
    assert code == 0
    report = json.loads(out)
    assert report["poses"] == 9 * 5
    assert [(row["rig"], row["metric"], row["unit"]) for row in report["rows"]] == [
        ("cube-8", "capacity-margin:0.2", "N"),
        ("cube-8", "condition-number", "1"),
        ("cube-8", "tension-factor", "1"),
    ]
    rig = tl.load_rig(CUBE)
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.4, 0.4, 5))
    structure = rig.structure_matrix(np.stack([x, y, 0.1 + 0 * x], axis=-1))
    margins = tl.workspace.capacity_margin(structure, rig.limits, (np.zeros(3), 0.2))
    row = report["rows"][0]
    assert row["min"] == pytest.approx(margins.min())
    assert row["median"] == pytest.approx(np.median(margins))
    assert row["max"] == pytest.approx(margins.max())
    assert row["above_zero"] == np.mean(margins > 0) == 1.0
    assert report["manifest"]["versions"]["tensionlab"] == tl.__version__


def test_a_store_is_written_and_then_only_opened(run, tmp_path):
    out = tmp_path / "a.zarr"
    first = run(TETRA, "--step", 0.25, "--out", out)
    assert first[0] == 0
    assert f"values: {out}" in first[1]
    data = xr.open_zarr(out, chunks=None)
    assert data["isotropic-force"].dims == ("rig", "x", "y", "z")
    assert run(TETRA, "--step", 0.25, "--out", out)[1] == first[1]
    code, _, err = run(TETRA, "--step", 0.2, "--out", out)
    assert code == 2
    assert "a.zarr holds a sweep that differs in poses" in err


def test_poses_come_from_a_file_too(run, tmp_path):
    (tmp_path / "poses.csv").write_text("x,y,z\n0,0,0\n0.1,0,0\n")
    code, out, _ = run(CUBE, "--poses", tmp_path / "poses.csv", "--metric", "least-singular-value", "--json")
    assert code == 0
    # At the centre of a cube W W' = 8/3.
    assert json.loads(out)["rows"][0]["max"] == pytest.approx(np.sqrt(8 / 3))


def test_a_suspended_robot_has_a_workspace_beside_its_weight(run, tmp_path):
    words = ["--box", -6, 6, -4, 4, 0, 3, "--step", 1.5, "--json"]
    shares = {}
    (tmp_path / "pushes.toml").write_text("gravity = true\nbox = [200.0, 200.0, 200.0, 0.0, 0.0, 0.0]\n")
    for name, options in {
        "weight": [],
        "nothing": ["--no-gravity"],
        "payload": ["--wrench", 0, 0, 2943, 0, 0, 0],
        "pushes": ["--required", tmp_path / "pushes.toml"],
    }.items():
        code, out, err = run("cogiro", *words, *options)
        assert (code, err) == (0, "")
        rows = {row["metric"]: row for row in json.loads(out)["rows"]}
        feasible = rows.get("wrench-feasible")
        shares[name] = feasible and feasible["above_zero"]
        assert rows["capacity-margin"]["above_zero"] == (shares[name] or 0.0)
    assert shares["nothing"] is None
    assert 0.0 < shares["pushes"] < shares["weight"] < shares["payload"] == 1.0


@pytest.mark.parametrize(
    ("view", "word"), [("slices", "x (m)"), ("volume", "of the box"), ("shares", "share of the volume")]
)
def test_a_picture_of_the_first_metric(run, tmp_path, view, word):
    picture = tmp_path / "w.svg"
    code, out, err = run(CUBE, "--step", 0.2, "--plot", picture, "--view", view)
    assert (code, err) == (0, "")
    assert f"plot: {picture}" in out
    drawn = picture.read_text(encoding="utf-8")
    assert word in drawn
    assert "capacity margin (N)" in drawn


def test_orientations_have_a_total_and_an_inclusive_workspace(run, tmp_path):
    words = ["cogiro", "--box", -6, 6, -4, 4, 2, 2, "--step", 2, "--rotations", "cone:20:10"]
    code, out, err = run(*words, "--metric", "wrench-feasible", "--plot", tmp_path / "w.svg")
    assert (code, err) == (0, "")
    assert "orientations" in out
    assert "least" in out
    (row,) = json.loads(run(*words, "--metric", "wrench-feasible", "--json")[1])["rows"]
    assert row["poses"] == 7 * 5 * 19
    assert 0 < row["total_above_zero"] < row["above_zero"] < row["inclusive_above_zero"] <= 1
    assert "write cone:10" in run(*words[:-1], "rpy:1")[2]


def test_frames_on_the_command_line_place_bodies(run):
    words = ["body-mounted", "--box", 0, 0, 1, 1, 0.4, 0.4, "--step", 1, "--metric", "wrench-closure", "--json"]
    at_rest = json.loads(run(*words)[1])["rows"][0]["max"]
    behind = ["--frame", "shoulder", 0, 1, "1.4", "--frame", "hip", 0, 0.5, 1.4, 0, 0.1, 0]
    placed = json.loads(run(*words, *behind)[1])["rows"][0]["max"]
    assert (at_rest, placed) == (1.0, 0.0)


def test_metrics_stay_in_their_order_in_a_store_and_orientations_are_counted(run, tmp_path):
    words = ["cogiro", "--box", -2, 2, -2, 2, 1, 3, "--step", 2, "--rotations", "cone:10:10"]
    words += ["--metric", "wrench-feasible,capacity-margin", "--out", tmp_path / "a.zarr"]
    for _ in range(2):
        code, out, err = run(*words)
        assert (code, err) == (0, "")
        assert out.index("wrench-feasible") < out.index("capacity-margin")
        assert out.startswith("126 poses, 18 positions in 7 orientations, 2 m apart: x -2 to 2 m")


def test_orientations_of_a_spherical_rig_are_swept_at_home(run, tmp_path):
    from tests.model.test_spherical import RIG

    tl.save_rig(RIG, tmp_path / "wrist.toml")
    status, out, _ = run(tmp_path / "wrist.toml", "--rotations", "cone:20:10", "--metric", "capacity-margin")
    assert status == 0
    assert "19 poses, 1 positions in 19 orientations: x 0 to 0 m, y 0 to 0 m, z 0.05 to 0.05 m" in out
    assert " N·m " in out
