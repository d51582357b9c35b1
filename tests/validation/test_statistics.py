"""Alignment of the sensor, deviations of forces, and models fitted to a rig."""

import numpy as np
import pytest

import tensionlab as tl
from paper_figures.what_if import mean_noise, predict_forces
from tensionlab.errors import ShapeError
from tensionlab.model.directions import grid18
from tensionlab.model.kinematics import exponential
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation.error_model import ErrorModel, draw_errors
from tensionlab.validation.protocol import AXIS_FORCES, Protocol
from tensionlab.validation.sensors import UPRIGHT
from tensionlab.validation.statistics import (
    MODELS,
    deviations,
    estimate_cables,
    fit_gain,
    fit_gains_and_biases,
    fit_linear_map,
    fit_rotation,
    fit_yaw,
    rotation_angle,
    score,
)

AXES = 1.5 * np.eye(3)
DESIRED = 1.5 * grid18()
RIG = ring_plus_top(1.0)
STRUCTURE = RIG.structure_matrix(RIG.home)
PROTOCOL = Protocol()
CHOSEN = tl.allocate(STRUCTURE, PROTOCOL.forces, RIG.limits)
TENSIONS = CHOSEN.tensions[AXIS_FORCES:]


def test_upright_puts_the_sensors_z_on_y():
    assert np.array_equal(UPRIGHT @ [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    assert np.linalg.det(UPRIGHT) == 1.0


@pytest.mark.parametrize("degrees", [-30.0, -3.0, 0.0, 17.0, 30.0])
def test_a_turn_about_the_vertical_comes_back_either_way(degrees):
    planted = exponential(np.array([0.0, np.radians(degrees), 0.0]))
    measured = AXES @ planted.T
    for find in (fit_yaw, fit_rotation):
        found = find(AXES, measured)
        assert np.allclose(found @ planted, np.eye(3), atol=1e-12)
        assert rotation_angle(found) == pytest.approx(abs(degrees))


def test_a_planted_rotation_is_found_to_a_tenth_of_a_degree_by_kabsch_alone():
    random = np.random.default_rng(0)
    for degrees in (1.0, 5.0, 10.0, 20.0, 30.0):
        axis = random.standard_normal(3)
        planted = exponential(np.radians(degrees) * axis / np.linalg.norm(axis))
        noise = 0.03 / np.sqrt(700.0) * random.standard_normal((3, 3))  # 0.7 s of a sensor's white noise
        measured = AXES @ planted.T + noise
        assert rotation_angle(fit_rotation(AXES, measured) @ planted) < 0.1
    leaning = exponential(np.radians([20.0, 0.0, 0.0]))
    left = fit_yaw(AXES, AXES @ leaning.T) @ leaning
    assert rotation_angle(left) == pytest.approx(20.0, abs=1.0)


def test_kabsch_never_mirrors():
    mirrored = AXES * [1.0, 1.0, -1.0]
    assert np.linalg.det(fit_rotation(AXES, mirrored)) == pytest.approx(1.0)


def test_nothing_measured_turns_nothing():
    assert np.array_equal(fit_yaw(AXES, np.zeros((3, 3))), np.eye(3))


def test_each_deviation_by_hand():
    found = deviations(
        np.array([[1.5, 0, 0], [1.5, 0, 0], [0, 2.0, 0]]), np.array([[0, 1.5, 0], [3.0, 0, 0], [0, 0, 0]])
    )
    assert found.angle[:2].tolist() == [90.0, 0.0]
    assert np.isnan(found.angle[2])
    assert found.magnitude.tolist() == [1.5, 3.0, 0.0]
    assert found.magnitude_error.tolist() == [0.0, 1.5, 2.0]
    assert found.vector == pytest.approx([1.5 * np.sqrt(2.0), 1.5, 2.0])


def test_a_perfect_rig_has_no_errors():
    found = score(DESIRED, DESIRED)
    assert found.angle.maximum == 0.0
    assert found.magnitude.mean.value == pytest.approx(1.5)
    assert found.vector.weighted == (0.0, 0.0, 0.0)
    assert found.within == 1.0


def test_weights_take_the_poles_for_what_they_are():
    wrong = (
        np.where(np.abs(DESIRED[:, [1]]) > 1.4, 2.0, 1.0) * DESIRED
    )  # 42 vectors about the poles are twice too long
    found = score(DESIRED, wrong).vector
    assert found.mean.value == pytest.approx(1.5 * 42 / 182)
    assert found.weighted.value == pytest.approx(1.5 * 0.0979, abs=2e-3)  # sin 18° of the sum of sines, twice
    assert found.mean.lower < found.mean.value < found.mean.upper


def test_bootstrap_intervals_are_as_wide_as_theory_says():
    random = np.random.default_rng(1)
    long = DESIRED * (1.0 + 0.1 * random.standard_normal((182, 1)))
    found = score(DESIRED, long).magnitude.mean
    sd = np.linalg.norm(long, axis=1).std() / np.sqrt(182)
    assert found.upper - found.lower == pytest.approx(2 * 1.96 * sd, rel=0.1)


def test_share_within_45_degrees():
    c = np.cos(np.radians(46.0))
    measured = np.array([[1.0, 0, 0], [c, np.sqrt(1 - c * c), 0]])
    assert score(np.array([[1.0, 0, 0]] * 2), measured).within == 0.5


def test_no_forces_are_refused():
    with pytest.raises(ShapeError, match="no forces"):
        score(np.empty((0, 3)), np.empty((0, 3)))


def measured_forces(errors, noise=None):
    """Forces of a rig with errors, in the axes of the nominal one; no rotation to be found."""
    noise = np.zeros((len(PROTOCOL.forces), 3)) if noise is None else noise
    return predict_forces(
        RIG, errors, CHOSEN.tensions, CHOSEN.wrench[:AXIS_FORCES], noise, rotation=np.eye(3)
    ).forces


def measurable_part(biases):
    """What of the biases can be measured at the point."""
    return np.linalg.pinv(STRUCTURE) @ STRUCTURE @ biases


def test_planted_gains_and_biases_come_back_within_their_intervals():
    """Nineteen of twenty intervals of 95 % hold the planted number, with other noise for each force."""
    hits = []
    for seed in range(50):
        errors = draw_errors(ErrorModel(gain=1.28, gain_spread=0.08, bias=0.12), RIG.m, seed)
        noise = 0.03 * np.random.default_rng(seed).standard_normal((len(PROTOCOL.forces), 3))
        found = estimate_cables(STRUCTURE, TENSIONS, measured_forces(errors, noise))
        assert max(each.half_width for each in (*found.gains, *found.biases)) < 0.05
        hits += [gain in each for gain, each in zip(errors.gains, found.gains, strict=True)]
        hits += [bias in each for bias, each in zip(measurable_part(errors.biases), found.biases, strict=True)]
    assert 0.92 < np.mean(hits) < 0.98


def test_without_noise_they_come_back_as_they_are():
    errors = draw_errors(ErrorModel(gain=1.1, gain_spread=0.1, bias=0.2), RIG.m, 4)
    found = estimate_cables(STRUCTURE, TENSIONS, measured_forces(errors))
    assert [each.value for each in found.gains] == pytest.approx(errors.gains, abs=1e-9)
    assert [each.value for each in found.biases] == pytest.approx(measurable_part(errors.biases), abs=1e-9)


def test_each_model_explains_what_it_is_made_for():
    common = measured_forces(draw_errors(ErrorModel(gain=1.3), RIG.m, 0))
    assert np.allclose(fit_gain(STRUCTURE, TENSIONS, common).map, 1.3 * STRUCTURE)
    each = draw_errors(ErrorModel(gain_spread=0.1, bias=0.1), RIG.m, 0)
    model = fit_gains_and_biases(STRUCTURE, TENSIONS, measured_forces(each))
    assert np.allclose(model.map, STRUCTURE * each.gains)
    assert np.allclose(model.offset, STRUCTURE @ each.biases)
    moved = draw_errors(ErrorModel(gain=1.2, bias=0.1, position=0.03, tilt=4.0), RIG.m, 0)
    forces = measured_forces(moved)
    model = fit_linear_map(STRUCTURE, TENSIONS, forces)
    assert np.allclose(TENSIONS @ model.map.T + model.offset, forces)


def test_with_all_errors_more_of_a_model_explains_more():
    errors = draw_errors(ErrorModel(1.28, 0.08, 0.12, 0.025, 3.0, 0.1, 0.03), RIG.m, 1)
    forces = measured_forces(errors, mean_noise(errors.noise, 1, PROTOCOL))
    left = [
        np.linalg.norm(forces - TENSIONS @ model.map.T - model.offset)
        for model in (find(STRUCTURE, TENSIONS, forces) for find in MODELS.values())
    ]
    assert left == sorted(left, reverse=True)
