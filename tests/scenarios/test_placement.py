"""Scenarios moved to where the hand is, turned to where the person faces, and scaled to the rig's reach."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.allocation import Status
from tensionlab.errors import ScenarioError
from tensionlab.haptics.effects import Motion
from tensionlab.scenarios import SCENARIOS, load_scenario

# Y up, facing X: what was x, y, z with z up is now this.
TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
AT = np.array([0.05, 1.1, -0.02])


@pytest.fixture(params=SCENARIOS)
def pair(request, tmp_path):
    """A scenario with Z up, and the same on its rig with Y up, elsewhere; both have the size of the file."""
    scenario = load_scenario(request.param)
    rig = scenario.rig
    modules = tuple(replace(module, anchor=TURN @ module.anchor) for module in rig.modules)
    tl.save_rig(replace(rig, up="y", home=TURN @ rig.home, modules=modules), tmp_path / "turned.toml")
    return scenario, load_scenario(request.param, tmp_path / "turned.toml", AT, [1.0, 0.0, 0.0])


def test_the_person_feels_the_same_wherever_it_is_placed(pair):
    """Every effect and brake target commutes with the motion of the whole."""
    scenario, placed = pair
    rng = np.random.default_rng(5)
    hand = scenario.person.script.waypoints[0].position
    moved = np.zeros(3) if scenario.frame else AT - TURN @ hand
    for phase, other in zip(scenario.phases, placed.phases, strict=True):
        for position in rng.normal(0.0, 0.15, (40, 3)) + (np.zeros(3) if scenario.frame else hand):
            velocity, time = rng.normal(0.0, 0.3, 3), rng.uniform(phase.begin, phase.end)
            for name, effect in phase.effects.items():
                force = effect.render(Motion(position, velocity, time)).force
                turned = Motion(TURN @ position + moved, TURN @ velocity, time)
                felt = other.effects[name].render(turned).force
                np.testing.assert_allclose(felt, TURN @ force, atol=1e-8)
            if phase.hold is not None:
                wall, same = phase.hold.wall(position), other.hold.wall(TURN @ position + moved)
                assert same.distance == pytest.approx(wall.distance)
                np.testing.assert_allclose(same.normal, TURN @ wall.normal, atol=1e-9)


def test_hand_and_bodies_keep_their_distances(pair):
    scenario, placed = pair
    assert placed.rig.up == "y"
    assert placed.person.script.position(0.0) == pytest.approx(AT)
    for time in np.linspace(0.0, scenario.seconds, 50):
        hand, there = (each.person.script.position(time) for each in pair)
        points = [(body.position(time), placed.person.bodies[name].position(time))
                  for name, body in scenario.person.bodies.items()]  # fmt: skip
        points += [(np.array(scenario.feet), np.array(placed.feet))]
        sway = 0.02  # each axis of a sway has its own frequency
        for before, after in points:
            assert np.linalg.norm(after - there - TURN @ (before - hand)) < sway


@pytest.mark.parametrize("height", [0.0, 0.1, 0.2, 0.26])
def test_the_path_is_as_large_as_the_reach_allows(height):
    rig = tl.load_rig("tetra-4")
    scenario, placed = load_scenario("materials"), load_scenario("materials", "tetra-4", [0.0, 0.0, height])
    ways = [np.array([point.position for point in each.person.script.waypoints]) for each in (scenario, placed)]
    sizes = [np.linalg.norm(way - way[0], axis=1) for way in ways]
    scale = sizes[1].max() / sizes[0].max()
    np.testing.assert_allclose(sizes[1], scale * sizes[0], atol=1e-9)
    balls = [each.phases[2].effects["ball"].field for each in (scenario, placed)]
    assert balls[1].radius == pytest.approx(scale * balls[0].radius)

    def is_held(share):
        path = ways[1][0] + share * (ways[1] - ways[1][0])
        return all(rig.allocate(np.zeros(3), position=point).status == Status.EXACT for point in path)

    assert is_held(1.0)
    assert scale == pytest.approx(1.0) or not is_held((scale + 0.05) / scale)
    assert ("of its size" in placed.placement) == (scale < 0.99)


@pytest.mark.parametrize(
    ("at", "facing", "said"),
    [
        ([0.0, 0.0, 0.3], None, r'"materials" does not fit: .* at 50 % .*; start elsewhere \(the rig'),
        (None, [0.0, 2.0, 0.0], r"facing \(0, 2, 0\) points up or down; give a direction along"),
        ([0.0, 0.0], None, "at and facing have 3 components"),
    ],
)
def test_what_does_not_fit_is_refused_in_words(at, facing, said):
    with pytest.raises(ScenarioError, match=said):
        load_scenario("materials", "tetra-4", at, facing)
