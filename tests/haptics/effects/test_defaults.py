"""The defaults are those of the facts that the project agreed on; a change of one is a decision, not a slip."""

import math
from dataclasses import asdict

import pytest

from tensionlab.haptics.effects import (
    EFFECTS,
    Bow,
    Friction,
    Magnet,
    Recoil,
    Shape,
    Texture,
    Vibration,
    Wall,
    Water,
    Weight,
)
from tensionlab.haptics.rendering.filtering import Stages
from tensionlab.haptics.rendering.stability import MARGIN

AGREED = [
    (Wall(), {"stiffness": 300.0, "damping": 2.0}),
    (Magnet(), {"max_force": 3.0, "reach": 0.10, "stiffness": 300.0, "damping": 1.0}),
    (Texture().ripples, {"period": 0.004, "height": 0.0003}),
    (Texture().wall, {"stiffness": 300.0, "damping": 2.0}),
    (Friction(), {"static": 0.5, "dynamic": 0.35, "stiffness": 400.0, "damping": 2.0}),
    (Texture().friction, {"static": 0.5, "dynamic": 0.35, "stiffness": 400.0, "damping": 2.0}),
    (Shape().coupling, {"stiffness": 400.0, "damping": 0.0}),
    (Vibration(), {"amplitude": 1.0, "frequency": 40.0}),
    (Water(), {"linear": 2.0, "quadratic": 3.0, "lift": 1.0, "mixing": 0.02}),
    (Weight(), {"cutoff": 10.0, "limit": 5.0, "ramp": 0.1, "gravity": (0.0, 0.0, -9.81)}),
    (Recoil(), {"peak": 5.5, "rise": 0.005, "fade": 0.060, "rate": 10.0}),
    (
        Bow(),
        {
            "initial": 1.0,
            "stiffness": 8.3,
            "most": 6.0,
            "draw_length": 0.60,
            "let_off": 0.0,
            "slack": 0.5,
            "loose": 0.010,
            "hum": 1.0,
            "frequency": 60.0,
            "fade": 0.050,
        },
    ),
    (Stages(), {"cutoff": 60.0, "slew": 200.0}),
]


@pytest.mark.parametrize(("effect", "agreed"), AGREED, ids=lambda value: type(value).__name__)
def test_defaults(effect, agreed):
    assert {name: getattr(effect, name) for name in agreed} == agreed


def test_half_of_the_bound():
    assert MARGIN == 0.5


def test_every_effect_is_in_the_table_and_stands_on_its_own():
    for effect in EFFECTS.values():
        assert asdict(effect())
        assert effect() == effect()
        assert "this project" in effect.__doc__ or effect in (Shape, Texture), "says whose its defaults are"
    assert math.isinf(Bow().loosed)
