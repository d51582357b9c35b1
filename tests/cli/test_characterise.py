"""The verb on a simulated rig, and what it refuses."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest


def test_one_command_measures_a_rig_as_a_device(run, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.validation.characterisation.WALL_DAMPINGS_NS_M", (0.0,))
    monkeypatch.setattr("tensionlab.validation.characterisation.DIRECTIONS", np.eye(3))
    monkeypatch.setattr("tensionlab.validation.measurements.MAX_TRIALS", 3)
    out = tmp_path / "tetra"
    code, text, _ = run("characterise", "tetra-4", "--out", out)
    assert code == 0
    for line in ("tetra-4, simulated", "force bandwidth (Hz)", "felt friction (N)", "STRIVE", "Novint Falcon"):
        assert line in text
    report = json.loads((out / "report.json").read_text())
    figures = {row["name"]: row["values"] for row in report["figures"]}
    assert figures["round trip of a ping"]["rig"] == pytest.approx(20.0, abs=1.0)
    assert 0.04 < figures["friction of a cable"]["rig"] < 0.06
    assert (out / "characterisation.png").stat().st_size > 20_000
    table = pq.read_table(out / "measurements-simulated.parquet")
    assert {"gain", "step response", "growth at a wall"} <= set(table["measurement"].to_pylist())
    assert "seed" in json.loads(table.schema.metadata[b"tensionlab"])
    assert "# Characterisation of tetra-4, simulated" in (out / "report.md").read_text()


def test_options_that_do_not_go_together_are_refused(run, tmp_path):
    for words in (("--sensor", "socket://localhost:1"), ("--modules", "sim:")):
        code, _, said = run("characterise", "tetra-4", "--out", tmp_path / "no", *words)
        assert code == 2
        assert "--modules and --sensor go together" in said
    code, _, said = run("characterise", "floor-3", "--out", tmp_path / "no")
    assert code == 2
    assert "both ways along any axis" in said
    assert not (tmp_path / "no").exists()
