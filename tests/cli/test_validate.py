"""The verb: with modules and a sensor of its own, and with served ones."""

import json
from functools import partial
from pathlib import Path

import numpy as np

from tensionlab.model.directions import grid18
from tensionlab.model.files import load_rig
from tensionlab.validation.data_tables import read_recording
from tensionlab.validation.error_model import draw_errors, find_preset
from tensionlab.validation.protocol import Protocol, ValidationPlan, validate
from tensionlab.validation.sensors import simulated_setup

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
RIG = RIGS / "bartels2026-validation.toml"


def test_one_command_measures_and_compares(run, tmp_path, monkeypatch):
    few = partial(Protocol, directions=grid18()[::18])
    monkeypatch.setattr("tensionlab.cli.validate.Protocol", few)
    out = tmp_path / "ideal"
    code, text, _ = run(
        "validate", RIG, "--preset", "ideal", "--hold", 0.35, "--out", out, "--plot", tmp_path / "f.png"
    )
    assert code == 0
    assert (tmp_path / "f.png").stat().st_size > 10_000
    assert "simulated (95 %)" in text
    assert "measured (95 %)" not in text
    assert "not the published rig" not in text
    for line in ("mean angle error (degrees)", "within 45 degrees", "as | |F| - |F0| |", "as |F - F0|"):
        assert line in text
    assert "our inference" in " ".join(text.split())
    report = json.loads((out / "report.json").read_text())
    angle, within, magnitude, scalar, vector = report["comparison"].values()
    assert angle["mean"] < 1e-3
    assert (angle["published"], magnitude["published"]) == (14.0, 1.84)
    assert scalar["published"] == vector["published"] == 0.58
    assert within["mean"] == 100.0
    assert report["simulated"] is True
    assert set(report["alignments"]) == {"paper", "kabsch"}
    recording = read_recording(out / "forces-simulated.parquet")
    assert recording.simulated
    assert np.abs(recording.error).max() < 1e-3
    assert "simulated" in (out / "report.md").read_text()

    before = (out / "measurements.jsonl").stat().st_mtime_ns
    code, text, _ = run("validate", RIG, "--preset", "ideal", "--hold", 0.35, "--out", out, "--json")
    assert code == 0
    assert json.loads(text)["comparison"] == report["comparison"]
    assert (out / "measurements.jsonl").stat().st_mtime_ns == before
    code, _, said = run("validate", RIG, "--preset", "paper-like", "--hold", 0.35, "--out", out)
    assert code == 2
    assert "of a validation with other preset" in said


def test_published_numbers_beside_another_rig_have_a_remark(run, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.cli.validate.Protocol", partial(Protocol, directions=grid18()[::60]))
    code, text, _ = run("validate", "tetra-4", "--hold", 0.35, "--out", tmp_path / "mine")
    assert code == 0
    assert "tetra-4 is not the published rig" in " ".join(text.split())


def test_modules_and_a_sensor_that_are_given_measure_what_those_of_a_preset_do(tmp_path, monkeypatch):
    rig = load_rig(RIG)
    protocol = Protocol(hold=0.4, directions=grid18()[::26])
    _, found = validate(ValidationPlan(rig, "newton", protocol, "paper-like", 2), tmp_path / "preset")
    group, clock, sensor = simulated_setup(rig, draw_errors(find_preset("paper-like"), rig.m, 2), 2)
    monkeypatch.setattr("tensionlab.validation.protocol.RealClock", lambda clients: clock)
    setup, given = validate(ValidationPlan(rig, "newton", protocol), tmp_path / "given", (group, sensor))
    assert (setup["simulated"], setup["preset"]) == (True, None)
    assert given == found
