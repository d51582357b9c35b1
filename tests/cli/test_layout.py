import json
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.model.files import load_rig
from tensionlab.model.requirement import Requirement

SPACE = (Path(__file__).parents[1] / "data" / "flat_space.toml").read_text()


@pytest.fixture
def run(run):
    """Run `tensionlab layout search` in this process: exit status, stdout, stderr."""
    return lambda *words: run("layout", "search", *words)


@pytest.fixture
def space(tmp_path):
    path = tmp_path / "flat.toml"
    path.write_text(SPACE)
    return path


def test_search_prints_the_layout_and_writes_the_rig(run, space, tmp_path):
    code, out, err = run(space, "--out", tmp_path / "rig.toml")
    assert (code, err) == (0, "")
    rig = load_rig(tmp_path / "rig.toml")
    assert rig.m == 3
    assert all(module.name in out for module in rig.modules)
    assert "N in every direction throughout the target" in out
    assert f"flat-3: {tmp_path / 'rig.toml'}" in out
    assert "# flat-3: 3 modules, score" in (tmp_path / "rig.toml").read_text()


def test_json_has_every_layout_and_the_manifest(run, space, tmp_path):
    space.write_text(SPACE.replace("[3]", "[3, 4]"))
    code, out, err = run(space, "--json", "--seed", 9, "--out", tmp_path / "rig.toml")
    assert (code, err) == (0, "")
    report = json.loads(out)
    assert report["manifest"]["seed"] == 9
    assert [layout["rig"] for layout in report["layouts"]] == ["flat-3", "flat-4"]
    assert [len(layout["modules"]) for layout in report["layouts"]] == [3, 4]
    first = report["layouts"][0]
    assert first["on_front"] is True
    assert first["score"] == pytest.approx(first["worst_margin"])
    assert set(first["modules"][0]) == {"name", "frame", "anchor", "lower", "upper", "contribution"}
    assert report["written"] == [str(tmp_path / "rig-3.toml"), str(tmp_path / "rig-4.toml")]
    anchors = [module["anchor"] for module in report["layouts"][1]["modules"]]
    assert load_rig(tmp_path / "rig-4.toml").anchors.tolist() == anchors


def test_several_numbers_of_modules_are_compared_and_drawn(run, space, tmp_path):
    space.write_text(SPACE.replace("[3]", "[2, 3]") + "\n[objective]\nforce = 1.0\n")
    code, out, _ = run(space, "--plot", tmp_path / "search.svg")
    assert code == 0
    assert f"plot: {tmp_path / 'search.svg'}" in out
    assert "flat-3" in (tmp_path / "search.svg").read_text()
    rows = [line.split() for line in out.splitlines() if line.strip().startswith(("2 ", "3 "))]
    assert [(row[0], row[-1]) for row in rows] == [("2", "yes"), ("3", "yes")]
    assert "flat-3 renders 1 N in every direction in 100 % of the target" in out


def test_what_is_required_is_in_the_score_and_in_the_rig(run, space, tmp_path):
    code, out, err = run(space, "--wrench", 0, 2.5, "-o", tmp_path / "rig.toml")
    assert (code, err) == (0, "")
    assert "in every direction about the wrench (0, 2.5) N throughout the target" in " ".join(out.split())
    assert load_rig(tmp_path / "rig.toml").required == Requirement(wrench=[0.0, 2.5])
    space.write_text(SPACE.replace("counts", 'up = "y"\nplatform = { mass = 0.2 }\ncounts'))
    report = json.loads(run(space, "--gravity", "--json")[1])
    assert report["score"].endswith("about its weight of 0.2 kg, everywhere in the target")
    assert "--wrench has 3 components; this space needs 2" in run(space, "--wrench", 0, 1, 2)[2]


def test_a_search_that_finds_nothing_that_holds_says_so_and_ends_with_status_1(run, space, tmp_path):
    code, out, err = run(space, "--wrench", 0, 40, "-o", tmp_path / "rig.toml")
    assert code == 1
    assert "score" in out
    assert "no layout was found that holds the wrench (0, 40) N everywhere in the target: the worst margin" in err
    assert "the worst margin is -" in err
    assert load_rig(tmp_path / "rig.toml").m == 3


def test_a_layout_is_proved_or_falls_short(run, space, tmp_path):
    code, out, err = run(space, "--certify", "--out", tmp_path / "rig.toml")
    assert (code, err) == (0, "")
    assert "flat-3: proved everywhere in the target: 3.1" in out
    assert "# proved everywhere in the target: 3.1" in (tmp_path / "rig.toml").read_text()
    (layout,) = json.loads(run(space, "--certify", "--json")[1])["layouts"]
    assert 0.97 * layout["worst_margin"] < layout["proved_force"] <= layout["worst_margin"]
    assert json.loads(run(space, "--json")[1])["layouts"][0]["proved_force"] is None
    space.write_text(SPACE.replace("search =", "objective = { force = 3.2 }\nsearch ="))
    code, out, err = run(space, "--certify")
    assert code == 1
    assert "3.2 N in every direction is not proved everywhere in the target: of flat-3 " in err
    assert "N less; give more modules" in err


PLATFORM = """
name = "bar"
counts = [4]
symmetry = ["x"]
limits = { lower = 1, upper = 9.0 }
surfaces = [{ name = "floor", corner = [-2, 0], edges = [[4, 0]] }, { name = "hook", corner = [-1, 3] }]
attachments = [{ name = "end", corner = [0.3, 0] }, { name = "side", corner = [-0.3, -0.1], edges = [[0.6, 0]] }]
target = { x = [-0.2, 0.2], y = [1.0, 1.4], step = 0.2, rotations = "angle:-5..5" }
search = { generations = 3, starts = 2 }
"""


def test_a_platform_is_searched_for_and_written_with_its_attachments(run, tmp_path):
    (file := tmp_path / "bar.toml").write_text(PLATFORM)
    code, out, err = run(file, "--json", "--out", tmp_path / "rig.toml")
    assert (code, err) == (0, "")
    (layout,) = json.loads(out)["layouts"]
    rig = load_rig(tmp_path / "rig.toml")
    assert rig.kind == "planar"
    assert [module["attachment"] for module in layout["modules"]] == rig.attachments.tolist()
    np.testing.assert_allclose(rig.attachments[1::2], rig.attachments[::2] * [-1, 1])
    poses = tl.workspace.box([-0.2, 0.2], [1.0, 1.4], step=0.2, rotations=np.radians([-5.0, 0.0, 5.0]))
    margin = tl.sweep(rig, poses, ["capacity-margin"])["capacity-margin"].values.min()
    assert margin == pytest.approx(layout["score"], abs=1e-6)
    assert "(torques at" in run(file)[1]
    file.write_text(PLATFORM.replace('"angle:-5..5"', '"cone:5"'))
    assert "bar.toml: rotations 'cone:5': write angle:-30..30" in run(file)[2]
