"""The defaults are those of the facts that the project agreed on; a change of one is a decision, not a slip."""

import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import (
    Bow,
    Friction,
    Magnet,
    Recoil,
    Ripples,
    Texture,
    Vibration,
    VirtualCoupling,
    Wall,
    Water,
    Weight,
)
from tensionlab.haptics.rendering.renderer import Stages
from tensionlab.haptics.rendering.stability import MARGIN

AGREED = [
    Wall(stiffness=300.0, damping=2.0),
    Magnet(max_force=3.0, reach=0.10, stiffness=300.0, damping=1.0),
    Ripples(period=0.004, height=0.0003),
    Friction(static=0.5, dynamic=0.35, stiffness=400.0, damping=2.0),
    Texture(Wall(), Friction(), Ripples()),
    VirtualCoupling(stiffness=400.0, damping=0.0),
    Vibration(amplitude=1.0, frequency=40.0),
    Water(linear=2.0, quadratic=3.0, lift=1.0, mixing=0.02),
    Weight(cutoff=10.0, limit=5.0, ramp=0.1, gravity=(0.0, 0.0, -9.81)),
    Recoil(peak=5.5, rise=0.005, fade=0.060, rate=10.0),
    Bow(initial=1.0, stiffness=8.3, most=6.0, draw_length=0.60, let_off=0.0, slack=0.5, loose=0.010),
    Bow(hum=1.0, frequency=60.0, fade=0.050),
    Stages(cutoff=60.0, slew=200.0),
]
REFUSED = {
    "Bow: valley": lambda: Bow(valley=1.0),
    "shots are": lambda: Recoil(shots=(1.0, 0.5)),
    "Wall: stiffness is -1.0": lambda: Wall(stiffness=-1.0),
    "give a direction along the surface": lambda: Texture(ripples=Ripples(direction=(0.0, 0.0, 1.0))),
    "Friction: dynamic is 0.3, above static": lambda: Friction(static=0.2, dynamic=0.3),
}


def test_defaults():
    for effect in AGREED:
        assert type(effect)() == effect
    assert MARGIN == 0.5, "of the bound of stiffness"


@pytest.mark.parametrize("said", REFUSED)
def test_a_parameter_out_of_its_range_is_refused_by_name(said):
    with pytest.raises(EffectError, match=said):
        REFUSED[said]()
