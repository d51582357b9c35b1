"""The verb on a simulated rig, and what it refuses."""

import json
import socket

import numpy as np
import pyarrow.parquet as pq
import pytest

import tensionlab as tl
from benchmarks.processes import simulated
from tensionlab.validation.characterisation import CharacterisationPlan, characterise


def test_one_command_measures_a_rig_as_a_device(run, tmp_path, monkeypatch):
    few = {"WALL_DAMPINGS_NS_M": (0.0,), "DIRECTIONS": np.eye(3), "RATE_SHARES": np.array([0.02, 0.1])}
    for name, values in (few | {"VIBRATIONS_HZ": np.array([20.0, 60.0, 80.0, 100.0])}).items():
        monkeypatch.setattr(f"tensionlab.validation.characterisation.{name}", values)
    monkeypatch.setattr("tensionlab.validation.measurements.MAX_TRIALS", 1)
    monkeypatch.setattr("tensionlab.validation.protocol.ZERO_S", 0.3)
    out = tmp_path / "tetra"
    code, text, _ = run("characterise", "tetra-4", "--out", out)
    assert code == 0
    for line in (
        "tetra-4, simulated",
        "force bandwidth (Hz)",
        "backdrive friction (N)",
        "STRIVE",
        "Novint Falcon",
    ):
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


@pytest.mark.realtime  # modules and sensor in another process, over real TCP
def test_over_tcp_the_known_limits_of_modules_come_back(run, tmp_path, monkeypatch):
    fewer = {
        "WALL_DAMPINGS_NS_M": (0.0,),
        "DIRECTIONS": np.eye(3),
        "OFFSETS": np.empty((0, 3)),
        "RATE_SHARES": np.array([0.1]),
        "VIBRATIONS_HZ": np.array([60.0, 80.0, 100.0]),
        "MOTION_S": 2.0,
        "feasible_axes": lambda plan: {"x": np.eye(3)[0]},
    }
    for name, values in fewer.items():
        monkeypatch.setattr(f"tensionlab.validation.characterisation.{name}", values)
    monkeypatch.setattr("tensionlab.validation.measurements.MAX_TRIALS", 1)
    monkeypatch.setattr("tensionlab.validation.protocol.ZERO_S", 0.3)
    rig = tl.load_rig("tetra-4")
    here = characterise(CharacterisationPlan(rig))  # in lockstep
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    file, url, out = tmp_path / "modules.toml", f"socket://127.0.0.1:{port}", tmp_path / "out"
    with simulated("tetra-4", "--modules", file, "--sensor", port, "--latency-ms", 10):
        code, _, said = run("characterise", "tetra-4", "--modules", file, "--sensor", url, "--out", out)
    assert code == 0, said
    report = json.loads((out / "report.json").read_text())
    assert report["simulated"] is True
    found = {row["name"]: row["values"] for row in report["figures"]}
    # Within 5 % in lockstep (tests/validation); here of half of the motions, by the wall clock.
    assert found["friction of a cable"]["rig"] == pytest.approx(0.05, rel=0.1)
    assert 20.0 < found["round trip of a ping"]["rig"] < 30.0
    for axis, step in here.steps.items():
        assert found["latency to 10 % of a step"][axis] == pytest.approx(1e3 * step.latency, abs=20.0)  # a cycle
    for module, response in here.vibrations.items():
        assert found[f"vibration bandwidth, {module}"]["rig"] == pytest.approx(response.bandwidth, rel=0.1)
    assert found["force error, mean"]["rig"] < 0.15


def test_options_that_do_not_go_together_are_refused(run, tmp_path):
    for words in (("--sensor", "socket://localhost:1"), ("--modules", "sim:")):
        code, _, said = run("characterise", "tetra-4", "--out", tmp_path / "no", *words)
        assert code == 2
        assert "--modules and --sensor go together" in said
    code, _, said = run("characterise", "floor-3", "--out", tmp_path / "no")
    assert code == 2
    assert "both ways along any axis" in said
    assert not (tmp_path / "no").exists()
