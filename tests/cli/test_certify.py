import json
from pathlib import Path

import numpy as np
import pytest

from tensionlab.workspace.certified import Bounds

PLANAR = Path(__file__).parents[2] / "datasets" / "rigs" / "kntu-planar.toml"


@pytest.fixture
def run(run):
    """Run `tensionlab certify` in this process: exit status, stdout, stderr."""
    return lambda *words: run("certify", *words)


def test_a_workspace_is_proved_drawn_and_kept(run, tmp_path):
    (tmp_path / "one.toml").write_text("ball = 1.0\n")
    words = ["bartels2026-validation", "--required", tmp_path / "one.toml", "--step", 0.05]
    files = ["--out", tmp_path / "cells.npz", "--plot", tmp_path / "cells.svg"]
    code, out, err = run(*words, *files)
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 120
    report = json.loads(run(*words, "--out", tmp_path / "cells.npz", "--json")[1])
    low, high = report["volume"]["lower"], report["volume"]["upper"]
    assert 0 < low < 0.0967 < high  # as tests/workspace/certification has it
    assert report["share"]["lower"] == pytest.approx(low / report["region_volume"])
    assert f"workspace: {Bounds(low, high).describe()} m³" in out
    rows = {row[1]: row for row in map(str.split, out.splitlines()) if len(row) > 2}
    assert {verdict: int(rows[verdict][2].replace(",", "")) for verdict in report["cells"]} == report["cells"]
    assert f"{report['evaluations']:,} cells down to" in out
    assert f"cells: {tmp_path / 'cells.npz'}" in out
    cells = np.load(tmp_path / "cells.npz")
    assert len(cells["centre"]) == sum(report["cells"].values())
    assert (cells["share"][:, 0] * cells["edge"].prod(axis=1)).sum() == pytest.approx(low)
    assert "proved inside" in (tmp_path / "cells.svg").read_text(encoding="utf-8")


def test_without_a_requirement_wrench_closure_is_proved_in_all_rotations(run):
    words = [PLANAR, "--step", 0.1, "--json"]
    still, turned = (json.loads(run(*words, *more)[1]) for more in ([], ["--rotations", "angle:-10..10:10"]))
    assert still["required"] == turned["required"] == "wrench closure"
    assert turned["volume"]["upper"] < still["volume"]["lower"]


def test_what_survives_the_loss_of_any_one_cable_is_proved(run, tmp_path):
    (tmp_path / "half.toml").write_text("ball = 0.5\n")
    words = ["seven-modules", "--required", tmp_path / "half.toml", "--step", 0.3, "--loss", 1]
    code, out, err = run(*words)
    assert (code, err) == (0, "")
    assert "a ball of 0.5 N, any one cable lost" in out
    report = json.loads(run(*words, "--json")[1])
    worst = min(report["losses"], key=lambda name: report["losses"][name]["volume"]["upper"])
    assert f"After the loss of one module; the worst is {worst}" in out
    assert report["volume"]["upper"] < report["losses"][worst]["volume"]["upper"]
    assert "nothing survives the loss of one" in run("floor-3", "--loss", 1)[2]
