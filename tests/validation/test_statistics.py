"""Alignment of the sensor, deviations of forces, and models fitted to a rig."""

import numpy as np
import pytest

import tensionlab as tl
from paper_figures.what_if import predict_forces
from tensionlab.errors import ShapeError
from tensionlab.model.directions import grid18
from tensionlab.model.kinematics import exponential
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation.error_model import ErrorModel, draw_errors
from tensionlab.validation.protocol import AXIS_FORCES, Protocol
from tensionlab.validation.statistics import (
    ALIGNMENTS,
    deviations,
    estimate_cables,
    fit_yaw,
    rotation_angle,
    score,
)

fit_rotation = ALIGNMENTS["kabsch"]
AXES = 1.5 * np.eye(3)
DESIRED = 1.5 * grid18()
RIG = ring_plus_top(1.0)
STRUCTURE = RIG.structure_matrix(RIG.home)
PROTOCOL = Protocol()
CHOSEN = tl.allocate(STRUCTURE, PROTOCOL.forces, RIG.limits)
TENSIONS = CHOSEN.tensions[AXIS_FORCES:]


@pytest.mark.parametrize("degrees", [-30.0, -3.0, 0.0, 17.0, 30.0])
def test_a_turn_about_the_vertical_comes_back_either_way(degrees):
    planted = exponential(np.array([0.0, np.radians(degrees), 0.0]))
    measured = AXES @ planted.T
    for find in (fit_yaw, fit_rotation):
        found = find(AXES, measured)
        assert np.allclose(found @ planted, np.eye(3), atol=1e-12)
        assert rotation_angle(found) == pytest.approx(abs(degrees))


@pytest.mark.parametrize("axis", np.eye(3))
def test_the_angle_of_a_rotation_is_that_about_its_axis(axis):
    for degrees in (1e-6, 30.0, 179.0):
        assert rotation_angle(exponential(np.radians(degrees) * axis)) == pytest.approx(degrees)


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


def test_kabsch_never_mirrors_and_no_force_turns_nothing():
    assert np.linalg.det(fit_rotation(AXES, AXES * [1.0, 1.0, -1.0])) == pytest.approx(1.0)
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


def test_weights_take_the_poles_for_what_they_are():
    wrong = (
        np.where(np.abs(DESIRED[:, [1]]) > 1.4, 2.0, 1.0) * DESIRED
    )  # 42 vectors about the poles are twice too long
    found = score(DESIRED, wrong).loc["vector"]
    assert found["mean"] == pytest.approx(1.5 * 42 / 182)
    assert found["weighted"] == pytest.approx(1.5 * 0.0979, abs=2e-3)  # sin 18° of the sum of sines, twice
    assert found["mean_lower"] < found["mean"] < found["mean_upper"]


def test_bootstrap_intervals_are_as_wide_as_theory_says():
    random = np.random.default_rng(1)
    long = DESIRED * (1.0 + 0.1 * random.standard_normal((182, 1)))
    found = score(DESIRED, long).loc["magnitude"]
    sd = np.linalg.norm(long, axis=1).std() / np.sqrt(182)
    assert found["mean_upper"] - found["mean_lower"] == pytest.approx(2 * 1.96 * sd, rel=0.1)


def test_share_within_45_degrees():
    c = np.cos(np.radians(46.0))
    measured = np.array([[1.0, 0, 0], [c, np.sqrt(1 - c * c), 0]])
    assert score(np.array([[1.0, 0, 0]] * 2), measured)["mean"]["within"] == 50.0
    with pytest.raises(ShapeError, match="no forces"):
        score(np.empty((0, 3)), np.empty((0, 3)))


def measured_forces(errors, noise=0.0):
    """Forces of a rig with errors, in the axes of the nominal one, without an alignment."""
    noise = np.broadcast_to(noise, (len(PROTOCOL.forces), 3))
    tensions, rendered = CHOSEN.tensions, CHOSEN.wrench[:AXIS_FORCES]
    return predict_forces(RIG, errors, tensions, rendered, noise, rotation=np.eye(3)).forces


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
