"""The study on few rigs, what it must show, and its quasi-static model against stepped modules."""

import sys
from pathlib import Path

import numpy as np
import pandas
import pytest

import tensionlab as tl
from paper_figures import what_if
from paper_figures.what_if import (
    SIDES_M,
    SINGLE_ERRORS,
    Study,
    friction_play,
    mean_noise,
    medians,
    predict_forces,
)
from tensionlab.model.directions import grid18
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation.error_model import PRESETS, ErrorModel, draw_errors
from tensionlab.validation.protocol import AXIS_FORCES, Protocol, measure
from tensionlab.validation.sensors import DriftNoise, simulated_setup

RIG = ring_plus_top(1.0)
CARD = Path(__file__).parents[2] / "datasets" / "what-if" / "README.md"


@pytest.fixture(scope="module")
def study():
    """Forty rigs, each with its noise."""
    return Study(Protocol(), range(40))


def median(rows, name):
    return float(np.median([row[name] for row in rows]))


def test_rigs_like_the_published_one(study):
    rows = list(study.trials("preset", "paper-like", RIG, PRESETS["paper-like"]))
    assert 11.0 < median(rows, "angle") < 15.0
    assert 1.79 < median(rows, "magnitude") < 1.91
    assert 0.53 < median(rows, "vector") < 0.63
    assert np.mean([row["within"] == 1.0 for row in rows]) >= 0.9
    assert median(rows, "magnitude_error") < 0.45  # the other reading does not fit the published 0.58 N


def test_no_error_is_the_exact_solvers(study):
    one = Study(Protocol(), [0])
    for solver in ("newton", "dykstra", "closed-form", "qp:daqp"):
        (row,) = one.trials("solver alone", solver, RIG, PRESETS["ideal"], solver)
        assert row["exact"] == 182
        assert row["angle_max"] < 1e-3
        assert row["magnitude_error"] < 1e-3
    cut = what_if.study_solvers(RIG)["dykstra, 10 iterations"]
    (row,) = one.trials("solver alone", "dykstra, 10 iterations", RIG, PRESETS["ideal"], cut)
    assert row["angle"] > 1.0


def test_calibration_halves_the_error_of_vectors_it_has_not_seen(study):
    rows = list(study.calibrations(RIG, PRESETS["paper-like"]))
    names = ("none", *what_if.MODELS)
    left = {name: median([row for row in rows if row["choice"] == name], "vector") for name in names}
    assert names == ("none", "one gain", "gain and bias", "linear map")
    assert list(left.values()) == sorted(left.values(), reverse=True)
    assert left["gain and bias"] < 0.5 * left["none"]
    assert {row["vectors"] for row in rows} == {91}


def test_each_model_explains_what_it_is_made_for():
    protocol, structure = Protocol(), RIG.structure_matrix(RIG.home)
    chosen = tl.allocate(structure, protocol.forces, RIG.limits)
    tensions = chosen.tensions[AXIS_FORCES:]

    def fitted(model, **errors):
        drawn = draw_errors(ErrorModel(**errors), RIG.m, 0)
        rendered, noise = chosen.wrench[:AXIS_FORCES], np.zeros((len(protocol.forces), 3))
        forces = predict_forces(RIG, drawn, chosen.tensions, rendered, noise, rotation=np.eye(3)).forces
        return drawn, forces, what_if.MODELS[model](structure, tensions, forces)

    assert np.allclose(fitted("one gain", gain=1.3)[2].map, 1.3 * structure)
    errors, _, model = fitted("gain and bias", gain_spread=0.1, bias=0.1)
    assert np.allclose(model.map, structure * errors.gains)
    assert np.allclose(model.offset, structure @ errors.biases)
    _, forces, model = fitted("linear map", gain=1.2, bias=0.1, position=0.03, tilt=4.0)
    assert np.allclose(tensions @ model.map.T + model.offset, forces)


def test_a_small_triangle_turns_positions_into_angles(study):
    small, wide = (
        list(study.trials("side", "x", ring_plus_top(side), PRESETS["paper-like"])) for side in (0.3, 1.0)
    )
    assert small[0]["exact"] == 153
    assert median(small, "angle") > 1.4 * median(wide, "angle")


def test_the_command_writes_all_questions(tmp_path, monkeypatch, capsys):
    file = tmp_path / "few-simulated.parquet"
    monkeypatch.setattr(sys, "argv", ["what_if", "--rigs", "1", "--out", str(file)])
    what_if.main()
    found = pandas.read_parquet(file)
    choices = found.groupby("question")["choice"].agg(set)
    assert choices["error"] == set(SINGLE_ERRORS)
    assert len(choices["side"]) == len(SIDES_M)
    assert choices["solver"] == choices["solver alone"] == set(what_if.study_solvers(RIG))
    assert all(f"`{column}`" in CARD.read_text(encoding="utf-8") for column in found)
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2 + len(medians(found))


@pytest.mark.parametrize(
    ("seed", "side", "solver", "arming", "protocol"),
    [
        # A length is off by more than 50 mm: the run waits until its cables have been at rest.
        (0, 1.0, "newton", 0.54, Protocol(hold=0.4, directions=grid18()[::15])),
        (1, 0.5, "newton", what_if.ARMING_S, Protocol(hold=0.4, directions=grid18()[::-20])),
        (2, 2.0, "closed-form", what_if.ARMING_S, Protocol(hold=0.6, directions=grid18()[::25])),
    ],
)
def test_the_quasi_static_model_equals_the_protocol_on_stepped_modules(
    monkeypatch, seed, side, solver, arming, protocol
):
    monkeypatch.setattr(what_if, "ARMING_S", arming)
    rig = ring_plus_top(side)
    errors = draw_errors(PRESETS["paper-like"], rig.m, seed)
    modules, clock, sensor = simulated_setup(rig, errors, seed)
    found = []
    measure(rig, modules, clock, sensor, solver, protocol, found.append)
    modules.close()
    assert not any(each.rested for each in found)
    chosen = tl.allocate(rig.structure_matrix(rig.home), protocol.forces, rig.limits, solver=solver)
    assert np.allclose([each.tensions for each in found], chosen.tensions, atol=1e-6)
    noise = mean_noise(errors.noise, seed, protocol)
    quick = predict_forces(rig, errors, chosen.tensions, chosen.wrench[:AXIS_FORCES], noise)
    # In N. An encoder's noise hides some 1e-5 of a current; a run that begins 10 ms later differs by 2e-3.
    assert np.abs(quick.sensor - [each.measured for each in found]).max() < 2e-4


def test_play_follows_with_a_lag_and_ignores_less():
    pulls = np.array([[1.0], [1.15], [2.0], [1.85], [1.7]])
    assert friction_play(pulls, np.array([0.5]), 0.1)[:, 0].tolist() == pytest.approx([0.9, 1.05, 1.9, 1.9, 1.8])
    assert np.array_equal(friction_play(pulls, np.array([0.5]), 0.0), pulls)


def test_noise_drifts_by_so_much_in_pieces_of_any_size():
    whole = DriftNoise(0.03, 5).take(3000)
    process = DriftNoise(0.03, 5)
    assert np.allclose(np.concatenate([process.take(count) for count in (1, 7, 0, 992, 2000)]), whole, atol=1e-12)
    many = np.array([DriftNoise(0.03, seed).take(2001)[[0, 1000, 2000]] for seed in range(400)])
    assert many.std(axis=0) == pytest.approx(0.03, rel=0.15)
    shared = np.mean(many[:, 0] * many[:, 1]) / 0.03**2
    assert shared == pytest.approx(np.exp(-1.0), abs=0.1)  # after a second
