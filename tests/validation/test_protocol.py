"""The protocol on simulated modules, through the runner."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError, InputError, RigError
from tensionlab.model.directions import grid18
from tensionlab.model.kinematics import exponential
from tensionlab.solvers import select_solvers
from tensionlab.validation.error_model import PRESETS, ErrorModel, draw_errors, true_rig
from tensionlab.validation.protocol import AXIS_FORCES, Protocol, measure
from tensionlab.validation.report import evaluate, remarks
from tensionlab.validation.session import ValidationPlan
from tensionlab.validation.simulated_sensor import simulated_setup
from tensionlab.validation.statistics import rotation_angle

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
RIG = tl.load_rig(RIGS / "bartels2026-validation.toml")
QUICK = Protocol(hold=0.14, settle=0.1)
FEW = Protocol(hold=0.4, directions=grid18()[::15])
THREE = Protocol(hold=0.14, settle=0.1, directions=grid18()[::70])
SOLVERS = list(dict.fromkeys(run.name for run in select_solvers(size=(RIG.n, RIG.m))[0]))


def run(protocol, errors, solver="newton", rig=RIG, seed=0):
    modules, clock, sensor = simulated_setup(rig, errors, seed)
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
        assert aligned.score.angle.maximum < 1e-3
        assert aligned.score.magnitude_error.maximum < 1e-3
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
    assert score.angle.maximum < 1e-3
    assert score.magnitude_error.maximum < 1e-3
    assert result.fallback_used == 0
    assert {each.samples for each in result.measurements} == {40}
    assert not result.limited_modules


def test_a_rig_like_the_published_one():
    score = run(FEW, draw_errors(PRESETS["paper-like"], RIG.m, 0)).aligned["paper"].score
    assert 8.0 < score.angle.mean.value < 19.0
    assert 1.7 < score.magnitude.mean.value < 2.0
    assert 0.4 < score.vector.mean.value < 0.75
    assert score.magnitude_error.mean.value < score.vector.mean.value - 0.1  # the two readings differ


def test_windings_that_get_hot_may_cool_between_forces():
    """The closed form pulls harder than it must: without rests, the runner would stop it after half a minute."""
    up = Protocol(directions=np.repeat(grid18()[::90], 2, axis=0))
    result = run(up, of(), "closed-form")
    assert result.rested > 3.0
    assert result.aligned["paper"].score.angle.maximum < 1e-3
    assert result.aligned["paper"].score.magnitude_error.maximum < 1e-3
    assert not result.limited_modules
    assert run(THREE, of(), "newton").rested == 0.0


def test_three_modules_on_the_floor_do_what_they_can():
    floor = tl.load_rig(RIGS / "floor-3.toml")
    result = run(Protocol(hold=0.06, settle=0.02), of(floor), rig=floor)
    assert result.exact == 22
    assert result.aligned["paper"].score.angle.mean.value > 70.0
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
    assert result.aligned["kabsch"].score.angle.mean.value < 0.2
    assert result.tilt > 15.0
    assert result.aligned["paper"].score.angle.mean.value > 10.0


def test_what_cannot_be_validated_is_refused():
    planar = tl.load_rig(RIGS / "kntu-planar.toml")
    with pytest.raises(RigError, match="point in space"):
        simulated_setup(planar, of(planar))
    with pytest.raises(InputError, match="hold longer"):
        Protocol(hold=0.3)


def test_a_sensor_that_shows_nothing_is_found_out():
    modules, clock, _ = simulated_setup(RIG, of())
    _, _, silent = simulated_setup(RIG, of())
    with pytest.raises(HardwareError, match="showed nothing at zero tension"):
        measure(RIG, modules, clock, silent, "newton", FEW, print)
    modules.close()
