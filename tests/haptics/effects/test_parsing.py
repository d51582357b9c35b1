"""Effects from files and messages: what a client may describe, and how it hears that it may not."""

import dataclasses
import math
from pathlib import Path

import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import SOLIDS, Plane, Wall
from tensionlab.haptics.effects.parsing import parse_effect
from tensionlab.model.files import load_rig
from tensionlab.model.layouts import ring_plus_top

RIG = dataclasses.replace(ring_plus_top(1.0), up="z")
FLAT = load_rig(Path(__file__).parents[3] / "datasets" / "rigs" / "kntu-planar.toml")


def test_parameters_reach_the_parts_of_an_effect():
    wall = parse_effect("floor", {"kind": "wall", "stiffness": 100, "plane": {"point": [0, 0, 1]}}, RIG)
    assert wall == Wall(Plane(point=(0.0, 0.0, 1.0)), stiffness=100.0)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_shape_is_of_any_solid(kind):
    assert isinstance(parse_effect("it", {"kind": "shaped", "field": {"kind": kind}}, RIG).field, SOLIDS[kind])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"kind": "wal"}, "kind is 'wal'; give one of wall,"),
        ({"kind": "wall", "stifness": 1}, "stifness is an unknown key; did you mean 'stiffness'?"),
        ({"kind": "shaped", "field": {"kind": "cone"}}, "field: kind is 'cone'; give one of sphere,"),
        ({"kind": "shaped", "field": {"size": [1, 1, 1]}}, "field: size is an unknown key; the keys here"),
        (3, "is 3; give a table"),
        ({"kind": "wall", "stiffness": "100"}, "stiffness is '100'; give a number (Stiffness K"),
        ({"kind": "wall", "stiffness": 1e308}, "stiffness is 1e+308; give 0 to 1e+06 (Stiffness K"),
        ({"kind": "wall", "plane": {"point": [0, 0]}}, "plane.point is (0.0, 0.0); give 3 components"),
        ({"kind": "wall", "plane": {"normal": [1e-300, 0, 0]}}, "plane.normal: (1e-300, 0.0, 0.0)"),
        ({"kind": "vibrating", "frequency": 501}, "frequency is 501; give 0.001 to 500"),
        ({"kind": "weight", "grasped": math.nan}, "grasped is nan"),
        ({"kind": "recoil", "shots": [0.1 * each for each in range(8500)]}, "8500 entries; give 100 at most"),
        ({"kind": "textured", "ripples": {"period": 1e-300}}, "ripples.period is 1e-300"),
        ({"kind": "textured", "ripples": {"direction": [1, 0]}}, "give both as many components"),
        ({"kind": "shaped", "field": {"kind": "box", "size": [1, 1]}}, "size is (1.0, 1.0)"),
        ({"kind": "bow", "loosed": -math.inf}, "loosed is -inf"),
    ],
)
def test_what_cannot_be_is_refused_by_its_name(given, said):
    with pytest.raises(EffectError, match="effect 'mine'") as refused:
        parse_effect("mine", given, RIG)
    assert said in str(refused.value)
    assert len(str(refused.value)) <= 300


@pytest.mark.parametrize("up", ["x", "y", "-y"])
def test_directions_that_are_left_out_turn_with_what_is_up(up):
    """A floor is a floor, and friction acts along it, whichever axis points up."""
    rig = dataclasses.replace(RIG, up=up)
    upward = tuple(rig.upward.tolist())
    assert parse_effect("it", {"kind": "wall", "plane": {"point": [0, 0, 1]}}, rig).plane == Plane(
        (0.0, 0.0, 1.0), upward
    )
    assert parse_effect("it", {"kind": "wall", "plane": {"normal": [0, 0, 1]}}, rig).plane.normal == (
        0.0,
        0.0,
        1.0,
    )
    assert parse_effect("it", {"kind": "water"}, rig).surface.normal == upward
    assert parse_effect("it", {"kind": "vibrating"}, rig).axis == upward
    small = {"kind": "vibrating", "axis": [0, 0, 1e-4]}
    assert parse_effect("it", small, rig).axis == (0.0, 0.0, 1e-4)
    ripples = parse_effect("it", {"kind": "textured"}, rig).ripples.direction
    weight = parse_effect("it", {"kind": "weight"}, rig).gravity
    assert weight == pytest.approx(-9.81 * rig.upward)
    assert not any(math.copysign(1.0, part) < 0 for part in (*weight, *ripples) if part == 0.0)
    assert math.hypot(*ripples) == 1.0
    assert rig.upward @ ripples == 0.0


def test_directions_of_a_texture_are_compared_after_their_defaults_turned():
    """With Y up, ripples along Z lie on the floor, and ripples along Y do not."""
    rig = dataclasses.replace(RIG, up="y")
    level = {"kind": "textured", "ripples": {"direction": [0, 0, 1]}}
    assert parse_effect("it", level, rig).wall.plane.normal == (0.0, 1.0, 0.0)
    with pytest.raises(EffectError, match=r"effect 'it': .*; give a direction along the surface"):
        parse_effect("it", {"kind": "textured", "ripples": {"direction": [0, 1, 0]}}, rig)


def test_a_rig_that_does_not_say_what_is_up_has_no_weights():
    rig = dataclasses.replace(RIG, up=None)
    with pytest.raises(EffectError, match=r"effect 'it': rig .* key \"up\" is missing; give gravity"):
        parse_effect("it", {"kind": "weight"}, rig)
    assert parse_effect("it", {"kind": "weight", "gravity": [0, 0, -9.81]}, rig).gravity[2] == -9.81


def test_in_the_plane_vectors_have_two_components_also_those_left_out():
    flat = {"point": [0, 0], "normal": [0, 1]}
    assert parse_effect("floor", {"kind": "wall", "plane": flat}, FLAT) == Wall(Plane((0.0, 0.0), (0.0, 1.0)))
    with pytest.raises(EffectError, match=r"'floor': plane.point is \(0.0, 0.0, 0.0\); give 2 components"):
        parse_effect("floor", {"kind": "wall"}, FLAT)
