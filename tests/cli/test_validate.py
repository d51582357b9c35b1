"""The verb: with modules and a sensor of its own, and with served ones."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tensionlab.hardware.client.group import connect
from tensionlab.hardware.runner import settings
from tensionlab.model.directions import grid18
from tensionlab.model.files import load_rig
from tensionlab.validation import sensors
from tensionlab.validation.data_tables import read_recording
from tensionlab.validation.protocol import Protocol, ValidationPlan, validate
from tensionlab.validation.report import evaluate
from tensionlab.validation.sensors import connect_sensor
from tests.helpers.served import Simulation

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
RIG = RIGS / "bartels2026-validation.toml"


def test_one_command_measures_and_compares(run, tmp_path, monkeypatch):
    few = partial(Protocol, directions=grid18()[::18])
    monkeypatch.setattr("tensionlab.cli.validate.Protocol", few)
    out = tmp_path / "ideal"
    code, text, _ = run("validate", RIG, "--preset", "ideal", "--hold", 0.35, "--out", out)
    assert code == 0
    for line in ("mean angle error (degrees)", "within 45 degrees", "as | |F| - |F0| |", "as |F - F0|"):
        assert line in text
    assert "our inference" in " ".join(text.split())
    report = json.loads((out / "report.json").read_text())
    angle, within, magnitude, scalar, vector = report["comparison"]
    assert angle["measured"]["value"] < 1e-3
    assert (angle["published"], magnitude["published"]) == (14.0, 1.84)
    assert scalar["published"] == vector["published"] == 0.58
    assert within["measured"]["value"] == 100.0
    assert report["simulated"] is True
    assert set(report["alignments"]) == {"paper", "kabsch"}
    recording = read_recording(out / "forces-simulated.parquet")
    assert recording.simulated
    assert np.abs(recording.error).max() < 1e-3
    assert "simulated" in (out / "report.md").read_text()
    assert (out / "table.tex").read_text().startswith("% Simulated modules.")

    before = (out / "measurements.jsonl").stat().st_mtime_ns
    code, text, _ = run("validate", RIG, "--preset", "ideal", "--hold", 0.35, "--out", out, "--json")
    assert code == 0
    assert json.loads(text)["comparison"] == report["comparison"]
    assert (out / "measurements.jsonl").stat().st_mtime_ns == before
    code, _, said = run("validate", RIG, "--preset", "paper-like", "--hold", 0.35, "--out", out)
    assert code == 2
    assert "of a validation with other preset" in said


def test_with_served_modules_and_sensor_the_statistics_are_the_same(tmp_path, monkeypatch):
    """Modules and sensor of `tensionlab simulate`, against those that a validation simulates itself."""
    rig = load_rig(RIG)
    protocol = Protocol(hold=0.4, directions=grid18()[::26])
    setup, found = validate(ValidationPlan(rig, "newton", protocol, "paper-like", 2), tmp_path / "here")
    here = evaluate(setup, found)
    simulation = Simulation(RIG, "--sensor-port", 0, "--seed", 2)
    url = simulation.printed.partition("# Force sensor: ")[2].strip()
    for module in (settings, sensors):
        monkeypatch.setattr(module, "time", simulation.time)
    monkeypatch.setattr("socket.create_connection", lambda address, timeout: simulation.connect(url))
    sensor, group = connect_sensor(url), connect(rig, {name: simulation.link(name) for name in simulation.links})
    setup, found = validate(ValidationPlan(rig, "newton", protocol), tmp_path / "there", (group, sensor))
    group.close()
    sensor.close()
    simulation.close()
    there = evaluate(setup, found)
    assert setup["simulated"] is True  # the sensor said so
    assert setup["preset"] is None
    # Both sensors wander by 0.03 N per axis.
    assert np.abs(there.aligned["paper"].forces - here.aligned["paper"].forces).max() < 0.2
    a, b = here.aligned["paper"].score, there.aligned["paper"].score
    assert b.angle.mean.value == pytest.approx(a.angle.mean.value, abs=2.0)
    assert b.magnitude.mean.value == pytest.approx(a.magnitude.mean.value, abs=0.05)
    assert b.vector.mean.value == pytest.approx(a.vector.mean.value, abs=0.05)
    assert min(each.samples for each in there.measurements) >= 5  # fewer on a busy machine
