import numpy as np
import pytest

import tensionlab as tl
from tensionlab.haptics.brakes.map import brake_map
from tensionlab.model.directions import circle, fibonacci

WALLS = fibonacci(3000)
BOX3 = tl.TensionLimits(np.full(3, 0.5), np.full(3, 6.0))


def ceiling(radius):
    angles = np.radians([90.0, 210.0, 330.0])
    return np.stack([radius * np.cos(angles), np.ones(3), radius * np.sin(angles)]) / np.hypot(radius, 1.0)


def test_three_modules_on_the_ceiling_hold_about_half_of_the_walls():
    found = brake_map(ceiling(1.0), WALLS, 50.0, BOX3, np.full(3, 186.0))
    assert 0.35 < found.share() < 0.6
    # All they can do is pull up.
    down = WALLS[:, 1] < -np.sqrt(0.5)
    assert np.all(found.off[down] > np.pi / 4)
    assert not found.chosen.able[WALLS[:, 1] < -0.9].any()


def test_one_cable_holds_what_is_near_its_direction():
    # In the plane, one cable to the right: normals within 45 degrees of it, a quarter.
    U, box = np.array([[1.0], [0.0]]), tl.TensionLimits([0.0], [6.0])
    found = brake_map(U, circle(360), 20.0, box, [186.0])
    np.testing.assert_allclose(found.share(), 0.25, atol=0.01)
    # Behind it there is no force at all.
    assert np.mean(found.off == np.pi) == pytest.approx(0.5, abs=0.01)
    assert found.chosen.unresisted.min() == pytest.approx(0.0, abs=1e-2)


def test_brakes_add_nothing_where_the_motors_do_and_much_where_they_do_not():
    rig = tl.load_rig("datasets/rigs/cube-8.toml")
    U = rig.structure_matrix(np.array([rig.home, [0.2, 0.1, 0.0]]))
    for force, least in ((3.0, 0.99), (50.0, 0.99)):
        brakes = brake_map(U, WALLS, force, rig.limits, np.full(8, 186.0))
        motors = brake_map(U, WALLS, force, rig.limits, np.zeros(8))
        assert brakes.off.shape == (2, 3000)
        assert np.all(brakes.share() >= least)
        assert np.all(brakes.chosen.unresisted <= motors.chosen.unresisted + 1e-6)
        assert (
            np.mean(motors.chosen.unresisted) < 1e-6 if force < 5.0 else np.mean(motors.chosen.unresisted) > 35.0
        )


def test_a_map_needs_a_force():
    with pytest.raises(tl.ShapeError, match="force is 0"):
        brake_map(ceiling(1.0), WALLS, 0.0, BOX3, np.full(3, 186.0))
