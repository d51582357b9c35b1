"""Water slows and lifts, springs draw, vibrations shake."""

import numpy as np
import pytest

from tensionlab.haptics.effects import Motion, Spring, Vibration, Water
from tests.helpers.motions import at


def test_spring_draws_to_its_centre_and_damps():
    spring = Spring(centre=(0.1, 0.0, 0.0), stiffness=50.0, damping=2.0)
    assert spring.render(at(0.0, 0.0, 0.2, velocity=(0.0, 1.0, 0.0))).force == pytest.approx([5.0, -2.0, -10.0])


def test_water_slows_and_lifts():
    deep = Water().render(at(0.0, 0.0, -1.0, velocity=(0.5, 0.0, 0.0))).force
    assert deep == pytest.approx([-(2.0 * 0.5 + 3.0 * 0.25), 0.0, 1.0])
    assert not Water().render(at(0.0, 0.0, 0.001, velocity=(0.5, 0.0, 0.0))).force.any()


def test_terminal_speed_in_water():
    """b v + c v² = F: pushed by 4 N, and rising by the lift alone."""
    for push, direction in ((4.0, 0), (0.0, 2)):
        position, velocity = np.array([0.0, 0.0, -5.0]), np.zeros(3)
        for _ in range(3000):
            force = Water().render(Motion(position, velocity)).force
            lift = 0.0 if direction == 2 else -force[2]  # held at its depth
            velocity = velocity + (force + np.array([push, 0.0, lift])) / 0.3 * 0.001
            position = position + velocity * 0.001
        pushed = push or 1.0
        assert velocity[direction] == pytest.approx((np.sqrt(4.0 + 12.0 * pushed) - 2.0) / 6.0, rel=1e-3)


def test_vibration_is_a_sine_along_its_axis():
    time = np.arange(1000) / 1000
    motion = Motion(np.zeros((1000, 3)), np.zeros((1000, 3)), time)
    force = Vibration(axis=(0.0, 3.0, 4.0)).render(motion).force
    assert force @ [0.0, 0.6, 0.8] == pytest.approx(np.sin(2 * np.pi * 40 * time))
    assert np.linalg.norm(np.cross(force, [0.0, 0.6, 0.8]), axis=1) == pytest.approx(0.0, abs=1e-12)
