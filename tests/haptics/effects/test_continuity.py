"""Continuous forces have no jumps: a small step of the hand changes them by a bounded amount."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensionlab.haptics.effects import Bow, Box, Magnet, Motion, Plane, Shape, Sphere, Spring, Wall, Water
from tests.helpers.examples import many
from tests.helpers.motions import follow

# The steepest a force may be, in N/m, for a hand at rest.
STEEPEST = {
    "wall": (Wall(), 300.0),
    "magnetic": (Magnet(), 300.0),
    "water": (Water(), 1.0 * 1.5 / 0.02),
    "spring": (Spring(), 30.0),
    "bow": (Bow(brace=0.01), 6.0 / 0.02),  # across, 6 N turn with the hand: none within 2 cm here
    "compound bow": (Bow(brace=0.01, draw_length=0.1, let_off=0.8), 6.0 / 0.02),
}
CORNER = st.tuples(*[st.floats(-0.12, 0.12)] * 3).map(np.array)


@pytest.mark.parametrize("name", STEEPEST)
@settings(max_examples=many(25))
@given(start=CORNER, end=CORNER)
def test_a_small_step_changes_the_force_a_little(name, start, end):
    effect, steepest = STEEPEST[name]
    path = np.linspace(start, end, 400)
    if "bow" in name:
        path = path[np.linalg.norm(path, axis=1) > 0.02]
    force = effect.render(Motion(path, np.zeros_like(path))).force
    stretch = np.linalg.norm(end - start) / 399
    changes = np.linalg.norm(np.diff(force, axis=0), axis=1)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    near = steps < 1.5 * stretch + 1e-12  # a path through the bow's hand was cut
    assert (changes[near] <= 1.05 * steepest * stretch + 2e-3).all()


def test_a_ball_is_entered_and_left_without_a_leap():
    x = np.linspace(-0.15, 0.15, 3001)
    path = np.stack([x, np.full_like(x, 0.06), 0 * x], axis=-1)
    force = follow(Shape(Sphere()), path, 1.0, np.zeros_like(path))
    # On the surface the proxy runs ahead of the hand by R/r, so the force may turn a little faster.
    assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 400.0 * 1e-4 * 1.7
    assert np.linalg.norm(force, axis=1).max() == pytest.approx(400.0 * 0.04, rel=1e-3)


@pytest.mark.parametrize(
    "effect",
    [
        Wall(Plane((0.0, 0.0), (0.0, 1.0))),
        Magnet(Plane((0.0, 0.0), (0.0, 1.0))),
        Shape(Sphere((0.0, -0.1), 0.1)),
        Shape(Box((0.0, -0.1), (0.2, 0.2))),
    ],
    ids=lambda e: type(e).__name__,
)
def test_all_of_it_works_in_the_plane(effect):
    force = effect.render(Motion(np.array([0.0, -0.005]), np.zeros(2))).force
    assert force.shape == (2,)
    assert force[1] > 1.0
    assert force[0] == pytest.approx(0.0, abs=1e-9)
