"""Effects from files and messages: what a client may describe, and how it hears that it may not."""

import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import EFFECTS, SOLIDS, Box, Plane, Sphere, Wall
from tensionlab.haptics.effects.described import effect_of


@pytest.mark.parametrize("kind", EFFECTS)
def test_every_effect_has_its_defaults(kind):
    assert effect_of("mine", {"kind": kind}, 3) == EFFECTS[kind]()


def test_parameters_reach_the_parts_of_an_effect():
    wall = effect_of("floor", {"kind": "wall", "stiffness": 100, "plane": {"point": [0, 0, 1]}}, 3)
    assert wall == Wall(Plane(point=(0.0, 0.0, 1.0)), stiffness=100.0)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_shape_is_of_any_solid(kind):
    assert isinstance(effect_of("it", {"kind": "shaped", "field": {"kind": kind}}, 3).field, SOLIDS[kind])


def test_a_solid_has_its_parameters():
    ball = effect_of("ball", {"kind": "shaped", "field": {"centre": [0, 0, 1], "radius": 0.08}}, 3)
    assert ball.field == Sphere(centre=(0.0, 0.0, 1.0), radius=0.08)
    box = effect_of("box", {"kind": "shaped", "field": {"kind": "box", "size": [0.1, 0.2, 0.3]}}, 3)
    assert box.field == Box(size=(0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"kind": "wal"}, "kind is 'wal'; give one of wall,"),
        ({"kind": "wall", "stifness": 1}, "no parameter 'stifness'"),
        ({"kind": "wall", "stiffness": -1}, "stiffness is -1"),
        ({"kind": "wall", "plane": {"poin": [0, 0, 0]}}, "plane: no parameter 'poin'"),
        ({"kind": "shaped", "field": {"kind": "cone"}}, "field: kind is 'cone'; give one of sphere,"),
        ({"kind": "shaped", "field": {"radius": -1}}, "field: Sphere: radius is -1"),
        ({"kind": "shaped", "field": {"size": [1, 1, 1]}}, "field: no parameter 'size'"),
        ({"kind": "shaped", "field": 3}, "field"),
    ],
)
def test_what_cannot_be_is_refused_by_its_name(given, said):
    with pytest.raises(EffectError, match="effect 'mine'") as refused:
        effect_of("mine", given, 3)
    assert said in str(refused.value)
