import numpy as np
import pytest

from tensionlab.validation.alignment import UPRIGHT, angle, kabsch, yaw
from tensionlab.validation.error_model import turned

AXES = 1.5 * np.eye(3)


def test_upright_puts_the_sensors_z_on_y():
    assert np.array_equal(UPRIGHT @ [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
    assert np.linalg.det(UPRIGHT) == 1.0


@pytest.mark.parametrize("degrees", [-30.0, -3.0, 0.0, 17.0, 30.0])
def test_a_turn_about_the_vertical_comes_back_either_way(degrees):
    planted = turned(np.array([0.0, np.radians(degrees), 0.0]))
    measured = AXES @ planted.T
    for find in (yaw, kabsch):
        found = find(AXES, measured)
        assert np.allclose(found @ planted, np.eye(3), atol=1e-12)
        assert angle(found) == pytest.approx(abs(degrees))


def test_a_planted_rotation_is_found_to_a_tenth_of_a_degree_by_kabsch_alone():
    random = np.random.default_rng(0)
    for degrees in (1.0, 5.0, 10.0, 20.0, 30.0):
        axis = random.standard_normal(3)
        planted = turned(np.radians(degrees) * axis / np.linalg.norm(axis))
        noise = 0.03 / np.sqrt(700.0) * random.standard_normal((3, 3))  # 0.7 s of a sensor's white noise
        measured = AXES @ planted.T + noise
        assert angle(kabsch(AXES, measured) @ planted) < 0.1
    leaning = turned(np.radians([20.0, 0.0, 0.0]))
    left = yaw(AXES, AXES @ leaning.T) @ leaning
    assert angle(left) == pytest.approx(20.0, abs=1.0)


def test_kabsch_never_mirrors():
    mirrored = AXES * [1.0, 1.0, -1.0]
    assert np.linalg.det(kabsch(AXES, mirrored)) == pytest.approx(1.0)


def test_nothing_measured_turns_nothing():
    assert np.array_equal(yaw(AXES, np.zeros((3, 3))), np.eye(3))
