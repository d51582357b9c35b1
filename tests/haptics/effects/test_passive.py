"""Passive effects never give more energy than they were given, however the hand goes around."""

import numpy as np
import pytest
from hypothesis import given, settings

from tensionlab.haptics.effects import (
    Bow,
    Box,
    Friction,
    Magnet,
    Shape,
    Spring,
    Texture,
    Viscous,
    Wall,
    Water,
    Weight,
)
from tests.helpers.examples import many
from tests.helpers.motions import closed_paths, follow
from tests.helpers.motions import given as energy_given

STEPS = 600
# Offset of a path from the bow's hand, where the pull flips its direction: the trapezoid rule is off by up to 1 N
# times the step that crosses it, an error of the test and no energy of the effect.
AWAY_M = {"bow": 0.3, "compound bow": 0.3}
PASSIVE = {
    "wall": Wall(),
    "magnetic": Magnet(),
    "box": Shape(Box(size=(0.05, 0.05, 0.05))),
    "ball": Shape(),
    "friction": Friction(),
    "water": Water(),
    "viscous": Viscous(),
    "spring": Spring(),
    "bow": Bow(brace=0.25),
    "compound bow": Bow(brace=0.25, let_off=0.8, draw_length=0.2),
    "held weight": Weight(limit=0.0),
}


def leak(forces, path):
    """What the trapezoid rule may be wrong by: half of what each step's change of force does on its way."""
    return (np.abs(np.diff(forces, axis=0)) * np.abs(np.diff(path, axis=0))).sum(axis=(0, -1)) / 2


@pytest.mark.parametrize("name", PASSIVE)
@settings(max_examples=many(3))
@given(path=closed_paths(STEPS))
def test_a_closed_motion_gains_nothing(name, path):
    """Twice around; the second time begins with what the first left in bristles and proxies."""
    round_trip = np.concatenate([path, path[1:]]) + np.array([AWAY_M.get(name, 0.0), 0.0, 0.0])
    forces = follow(PASSIVE[name], round_trip, 0.001)
    gained = energy_given(forces, round_trip)
    tolerance = 0.05 * leak(forces, round_trip) + 1e-6
    assert (gained[STEPS - 1] <= tolerance).all()
    assert (gained[-1] - gained[STEPS - 1] <= stored(name) + tolerance).all()


def stored(name):
    """What may be left in bristles after the first time around, in J: (mu_s F_n)²/2 s0, under the load of 1 N."""
    return 0.5**2 / 800 if name == "friction" else 0.0


def test_the_test_sees_a_leak():
    """A wall that lets go more slowly than it gave way is seen at once."""
    z = 0.02 * np.sin(np.linspace(0, 2 * np.pi, STEPS))
    path = np.stack([0 * z, 0 * z, z], axis=-1)
    forces = follow(Wall(damping=0.0), path, 0.001)
    late = np.roll(forces, 20, axis=0)
    assert energy_given(late, path)[-1] > 10 * (0.05 * leak(late, path) + 1e-6)


@settings(max_examples=many(5))
@given(path=closed_paths(STEPS, size=0.01))
def test_a_texture_gives_no_more_than_its_ripples_can(path):
    """At most ``2 A`` times each rise of the wall's push."""
    texture = Texture(friction=Friction(static=0.0, dynamic=0.0))
    forces = follow(texture, path, 0.01)
    rises = np.maximum(np.diff(forces[..., 2], axis=0), 0.0).sum(axis=0)
    assert (energy_given(forces, path)[-1] <= 2 * 0.0003 * rises + 0.05 * leak(forces, path) + 1e-6).all()
