"""The protocol on simulated modules, through the runner."""

import json
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError, InputError, LogError
from tensionlab.model.directions import grid18
from tensionlab.model.kinematics import exponential
from tensionlab.model.layouts import ring_plus_top
from tensionlab.solvers import select_solvers
from tensionlab.validation.error_model import PRESETS, ErrorModel, draw_errors, find_preset, true_rig
from tensionlab.validation.protocol import AXIS_FORCES, JOURNAL_FILE, Protocol, ValidationPlan, measure, validate
from tensionlab.validation.report import as_markdown, evaluate, remarks
from tensionlab.validation.sensors import simulated_setup
from tensionlab.validation.statistics import rotation_angle

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
RIG = tl.load_rig(RIGS / "bartels2026-validation.toml")
QUICK = Protocol(hold=0.14, settle=0.1)
FEW = Protocol(hold=0.4, directions=grid18()[::15])
THREE = Protocol(hold=0.14, settle=0.1, directions=grid18()[::70])
NOTHING = 5e-3  # degrees and per cent: as its winding warms, a motor lags its current by a hundred-thousandth
SOLVERS = list(dict.fromkeys(run.name for run in select_solvers(size=(RIG.n, RIG.m))[0]))


def run(protocol, errors, solver="newton", rig=RIG, seed=0, **parameters):
    modules, clock, sensor = simulated_setup(rig, errors, seed)
    for client in modules.clients:
        for name, value in parameters.items():
            client.set_parameter(name, value)
    found = []
    assert measure(rig, modules, clock, sensor, solver, protocol, found.append)
    modules.close()
    return evaluate(ValidationPlan(rig, solver, protocol, "ideal").setup(simulated=True), found)


def of(rig=RIG, seed=0, **errors):
    return draw_errors(ErrorModel(**errors), rig.m, seed)


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_ideal_rig_shows_nothing_but_the_solver(solver):
    result = run(THREE, of(), solver)
    for aligned in result.aligned.values():
        assert aligned.score["maximum"]["angle"] < NOTHING
        assert aligned.score["maximum"]["magnitude_error"] < NOTHING
    alone = tl.allocate(RIG.structure_matrix(RIG.home), result.desired, RIG.limits, solver=solver)
    assert result.exact == len(result.desired)
    assert result.fallback_used == np.sum(alone.status != tl.Status.EXACT)
    said = [text for text in remarks(result) if "left its answer unproven" in text]
    assert len(said) == (result.fallback_used > 0)
    assert all(text.startswith(f"In {result.fallback_used} of 3 forces {solver} ") for text in said)


def test_an_ideal_rig_with_all_vectors_shows_nothing():
    result = run(QUICK, of())
    score = result.aligned["paper"].score
    assert len(result.desired) == 182
    assert max(score["maximum"]["angle"], score["maximum"]["magnitude_error"]) < NOTHING
    assert {each.samples for each in result.measurements} == {40}
    assert result.fallback_used == 0
    assert len(remarks(result)) == 4  # and none of what is not as it should be
    assert remarks(result)[0] == "These modules are simulated: preset ideal, seed 0."
    assert "in another process" in remarks(replace(result, setup=result.setup | {"preset": None}))[0]
    real = replace(result, setup=result.setup | {"simulated": False})
    assert len(remarks(real)) == 3
    for write, simulated, measured in (
        (str, "simulated, solver", "measured, solver"),
        (as_markdown, "# Technical validation, simulated\n", "# Technical validation\n"),
    ):
        assert simulated in write(result)
        assert measured in write(real)


def test_the_offset_of_a_sensor_is_taken_away():
    modules, clock, sensor = simulated_setup(RIG, of(), 0)
    take, found = sensor.take, []
    sensor.take = lambda: take() + np.array([1.0, -2.0, 3.0])
    measure(RIG, modules, clock, sensor, "newton", THREE, found.append)
    modules.close()
    score = (
        evaluate(ValidationPlan(RIG, "newton", THREE, "ideal").setup(simulated=True), found).aligned["paper"].score
    )
    assert score["maximum"]["vector"] < 1e-3


def test_presets_are_found_by_name():
    assert find_preset("paper-like") is PRESETS["paper-like"]
    with pytest.raises(InputError, match="no preset 'ideel'; there are ideal, paper-like"):
        find_preset("ideel")


def test_a_rig_like_the_published_one():
    score = run(FEW, draw_errors(PRESETS["paper-like"], RIG.m, 0)).aligned["paper"].score
    assert 8.0 < score["mean"]["angle"] < 19.0
    assert 1.7 < score["mean"]["magnitude"] < 2.0
    assert 0.4 < score["mean"]["vector"] < 0.75
    assert score["mean"]["magnitude_error"] < score["mean"]["vector"] - 0.1  # the two readings differ


def test_windings_that_get_hot_may_cool_between_forces():
    """The closed form pulls harder than it must. The estimate's motors have little heat capacity here."""
    up = Protocol(directions=np.repeat(grid18()[::90], 2, axis=0))
    result = run(up, of(), "closed-form", winding_capacity=1.0, housing_capacity=2.0)
    assert 1.0 < result.rested < 60.0
    assert any(f"had to rest for {result.rested:.0f} s" in remark for remark in remarks(result))
    assert result.aligned["paper"].score["maximum"]["angle"] < NOTHING
    assert result.aligned["paper"].score["maximum"]["magnitude_error"] < NOTHING
    assert not any(each.limited_modules for each in result.measurements)
    assert run(THREE, of(), "newton").rested == 0.0


def test_three_modules_on_the_floor_do_what_they_can():
    floor = tl.load_rig(RIGS / "floor-3.toml")
    result = run(Protocol(hold=0.06, settle=0.02), of(floor), rig=floor)
    assert result.exact == 22
    assert any("22 of 182 forces are feasible" in remark for remark in remarks(result))
    assert result.aligned["paper"].score["mean"]["angle"] > 70.0
    assert sum(each.status == "NEAREST" for each in result.measurements[AXIS_FORCES:]) == 160


def test_gains_and_biases_are_of_the_cables():
    errors = of(gain=1.2, gain_spread=0.1, bias=0.2, seed=5)
    result = run(FEW, errors)
    chosen = np.array([each.tensions for each in result.measurements[AXIS_FORCES:]])
    expected = (chosen * errors.gains + errors.biases) @ RIG.structure_matrix(RIG.home).T
    assert np.allclose(result.aligned["paper"].forces @ result.aligned["paper"].rotation, expected, atol=1e-3)


def test_friction_is_a_play_of_the_tension():
    """A tension stops short by the friction, on the side it came from, and ignores smaller changes."""
    directions = np.array([[0, 1.0, 0], [0, -1.0, 0], [0, 1.0, 0]])
    errors = of(play=0.1)
    result = run(Protocol(hold=0.4, directions=directions), errors)
    structure = RIG.structure_matrix(RIG.home)
    play, expected = np.zeros(RIG.m), []
    for chosen in [RIG.limits.lower, *(np.array(each.tensions) for each in result.measurements)]:
        play = np.clip(play, chosen - 0.1, chosen + 0.1)
        expected.append(structure @ play)
    rotation = result.aligned["paper"].rotation
    assert np.allclose(result.aligned["paper"].forces @ rotation, expected[1 + AXIS_FORCES :], atol=1e-3)


def test_positions_are_those_of_the_true_rig():
    errors = of(position=0.05, seed=3)
    real = true_rig(RIG, errors)
    np.testing.assert_allclose(real.home - RIG.home, errors.position)
    np.testing.assert_allclose(real.anchors - RIG.anchors, errors.anchors)
    result = run(FEW, errors)
    chosen = np.array([each.tensions for each in result.measurements[AXIS_FORCES:]])
    expected = chosen @ real.structure_matrix(real.home).T
    rotation = result.aligned["paper"].rotation
    assert np.allclose(result.aligned["paper"].forces @ rotation, expected, atol=1e-3)
    assert np.abs(expected - result.desired).max() > 0.02


def test_a_planted_rotation_is_found_by_kabsch_and_its_tilt_stays_in_the_published_way():
    tilt = exponential(np.radians([20.0, 15.0, -10.0]))
    result = run(FEW, replace(of(noise=0.001), tilt=tilt))
    assert rotation_angle(result.aligned["kabsch"].rotation @ tilt) < 0.1
    assert result.aligned["kabsch"].score["mean"]["angle"] < 0.2
    [remark] = [each for each in remarks(result) if "alignment by" in each]
    assert float(remark.split("alignment by ")[1].split()[0]) > 15.0
    assert result.aligned["paper"].score["mean"]["angle"] > 10.0


def test_a_sensor_that_shows_nothing_is_found_out():
    modules, clock, _ = simulated_setup(RIG, of())
    _, _, silent = simulated_setup(RIG, of())
    with pytest.raises(HardwareError, match="showed nothing at zero tension"):
        measure(RIG, modules, clock, silent, "newton", FEW, print)
    modules.close()


RING = ring_plus_top(1.0)


def plan(**changes):
    chosen = {"solver": "newton", "preset": "paper-like", "seed": 3} | changes
    return ValidationPlan(RING, protocol=Protocol(hold=0.35, directions=grid18()[::15]), **chosen)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of a complete validation, and what was measured."""
    folder = tmp_path_factory.mktemp("validation") / "whole"
    return folder, validate(plan(), folder)[1]


@pytest.fixture
def found(tmp_path, whole):
    """Copy it to the test's own folder, and return what was measured."""
    shutil.copytree(whole[0], tmp_path, dirs_exist_ok=True)
    return whole[1]


def interrupted_after(count, total):
    """A progress that presses Ctrl-C."""

    def progress(share):
        if round(share * total) == count:
            os.kill(os.getpid(), signal.SIGINT)

    return progress


def test_interrupted_and_resumed_equals_uninterrupted(tmp_path, whole):
    total = len(plan().protocol.forces)
    folder, uninterrupted = whole
    assert len(uninterrupted) == total
    for count in (2, 9):
        _, part = validate(plan(), tmp_path / "parts", progress=interrupted_after(count, total))
        assert len(part) == count
    with (tmp_path / "parts" / JOURNAL_FILE).open("a") as file:
        file.write('{"number": 9, "dema')  # as a process leaves it that is killed
    _, parts = validate(plan(), tmp_path / "parts")
    assert parts == uninterrupted
    assert (tmp_path / "parts" / JOURNAL_FILE).read_text() == (folder / JOURNAL_FILE).read_text()


@pytest.mark.usefixtures("found")
def test_another_validation_is_not_continued(tmp_path):
    with pytest.raises(LogError, match="of a validation with other seed;"):
        validate(plan(seed=4), tmp_path)
    with pytest.raises(LogError, match="other solver"):
        validate(plan(solver="dykstra"), tmp_path)


@pytest.mark.usefixtures("found")
def test_a_damaged_journal_is_named_by_its_line(tmp_path):
    file = tmp_path / JOURNAL_FILE
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:3], *lines[4:]]) + "\n")
    with pytest.raises(LogError, match="line 4: damaged"):
        validate(plan(), tmp_path)
    first = json.loads(lines[1])
    first["surprise"] = 1
    file.write_text("\n".join([lines[0], json.dumps(first)]) + "\n")
    with pytest.raises(LogError, match=r"line 2: .*surprise"):
        validate(plan(), tmp_path)
