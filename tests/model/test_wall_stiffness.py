import numpy as np
import pytest

from tensionlab.model.wall_stiffness import host_stiffness, module_stiffness


def test_a_module_renders_all_of_its_stiffness_along_its_cable_and_none_behind_it():
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(module_stiffness(directions, normals), [500.0, 0.0, 320.0, 180.0])


def test_the_host_renders_half_of_the_bound_of_a_late_loop():
    assert host_stiffness() == pytest.approx(0.5 * 2.0 / 0.03)
    assert host_stiffness(0.01, 0.0) == pytest.approx(200.0)
