"""Scenarios in TOML: the five that come along, and what is said about others; brake targets."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tensionlab.errors import RigError, ScenarioError
from tensionlab.haptics.effects import Bow, Plane
from tensionlab.model.files import load_rig
from tensionlab.scenarios import SCENARIOS, BrakeTarget, load_scenario
from tensionlab.scenarios.scenario import FOLDER


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_five_scenarios_can_be_read_and_are_proposals(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.rig.source.startswith("A proposal of this project")
    assert scenario.rig.up == "z"
    assert max(phase.end for phase in scenario.phases) <= scenario.seconds
    assert scenario.phases[0] in scenario.active_phases(scenario.phases[0].begin)


@pytest.fixture
def bow(tmp_path):
    """A copy of the bow that may be changed: the file, and what changes it."""
    for name in ("bow.toml", "bow.rig.toml"):
        shutil.copy(FOLDER / name, tmp_path / name)
    path = tmp_path / "bow.toml"

    def change(old, new):
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))
        return path

    return path, change


def test_a_file_of_ones_own_brings_its_rig(bow):
    path, change = bow
    change("loosed = 3.2", "loosed = 2.0, stiffness = 5.0")
    mine = load_scenario(path)
    assert mine.phases[0].effects["string"] == Bow(loosed=2.0, stiffness=5.0)
    assert mine.rig == load_scenario("bow").rig


def test_another_rig_may_take_its_place(bow):
    path, _ = bow
    with pytest.raises(ScenarioError, match="modules are attached to"):
        load_scenario("materials", rig="body-mounted")
    with pytest.raises(ScenarioError, match=r'frame is "bow", no body frame of rig "materials"; give a rig with'):
        load_scenario(path, rig=FOLDER / "materials.rig.toml")
    unseen = load_scenario("recoil", rig=FOLDER / "materials.rig.toml")  # the shoulder moves
    assert unseen.rig.frames == ()
    with pytest.raises(RigError, match="no such file"):
        load_scenario(path, rig=path.with_name("nothing.toml"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('up = "z"', "", "up is missing"),
        ('up = "z"', 'up = "w"', "key \"up\" is 'w'; give the axis that points up"),
        ('up = "z"', 'up = "z"\nrig = 3', "rig is 3; give a text"),
        ("seconds = 5.0", "seconds = -1.0", "seconds is -1.0; give more than 0"),
        ('frame = "bow"', 'frame = "bw"', 'frame is "bw"'),
        ("time = 2.0", "tme = 2.0", "tme is an unknown key"),
        ("frequency = 0.4", "freq = 0.4", "bodies.bow.sway.freq is an unknown key"),
        ('effects.string = { kind = "bow", loosed = 3.2 }', "effects.string = 3", "effect 'string': is 3; give a"),
        ('{ kind = "bow", loosed = 3.2 }', '{ kind = "spring", centre = [0, 0] }', "centre is (0.0, 0.0); give 3"),
        ("reach = 0.80", "plane = { point = [0, 0] }", "hold: plane.point is (0.0, 0.0); give 3"),
        ("reach = 0.80", "reach = 0.80, plane = {}", "a plane or a reach"),
        ("end = 5.0", "end = -5.0", 'phase "draw": begin 0.0, end -5.0'),
        ('policy = "force"', 'policy = "nowhere"', "policy is 'nowhere'; give 'force', 'tension' or 'direction'"),
        ("[person.bodies.bow]", "[person.bodies.bw]", "modules are attached to ['bow']"),
    ],
)
def test_a_refusal_names_the_file_and_the_key(bow, old, new, said):
    path, change = bow
    change(old, new)
    with pytest.raises(ScenarioError) as refused:
        load_scenario(path)
    assert "bow.toml" in str(refused.value)
    assert said in str(refused.value)


def test_a_scenario_is_turned_for_a_rig_and_one_that_does_not_say_how_is_refused(tmp_path):
    """Unturned, a rig with Y up would play a scenario with Z up, most of its forces out of reach."""
    own = load_rig("bartels2026-validation")
    turned = load_scenario("materials", rig="bartels2026-validation")
    assert (turned.rig, turned.up) == (own, "y")
    assert turned.placement == 'turned to have y up, as rig "bartels2026-validation" has'
    unturned = load_scenario("materials")
    for before, after in zip(unturned.person.script.waypoints, turned.person.script.waypoints, strict=True):
        np.testing.assert_array_equal(after.position, np.array(before.position)[[1, 2, 0]])  # x ahead is now z
    assert turned.phases[0].effects["magnet"].plane.normal == (0.0, 1.0, 0.0)
    assert load_scenario("materials").placement == ""
    text = Path("datasets/rigs/bartels2026-validation.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace('up = "y"\n', ""))
    with pytest.raises(ScenarioError, match='rig "bartels2026-validation": key "up" is missing; give'):
        load_scenario("materials", rig=tmp_path / "mine.toml")


def test_a_file_names_its_rig_or_has_it_beside_it(bow, tmp_path):
    path, change = bow
    (tmp_path / "bow.rig.toml").rename(tmp_path / "fist.toml")
    with pytest.raises(RigError, match=r"bow\.rig\.toml: no such file"):
        load_scenario(path)
    change('up = "z"', 'up = "z"\nrig = "fist.toml"')
    assert load_scenario(path).rig.name == "bow"
    change('rig = "fist.toml"', 'rig = "fst"')
    with pytest.raises(RigError, match="no rig is called 'fst'"):
        load_scenario(path)


def test_a_plane_is_as_far_as_it_is():
    hold = BrakeTarget(40.0, plane=Plane(point=(0.3, 0.0, 0.0), normal=(-2.0, 0.0, 0.0)))
    wall = hold.wall(np.array([0.1, 5.0, 5.0]))
    assert wall.normal == pytest.approx([-1.0, 0.0, 0.0])
    assert wall.distance == pytest.approx(0.2)
    assert wall.force == 40.0


def test_the_end_of_a_reach_is_a_wall_across_it():
    wall = BrakeTarget(50.0, reach=0.8).wall(np.array([0.0, -0.6, 0.0]))
    assert wall.normal == pytest.approx([0.0, 1.0, 0.0])
    assert wall.distance == pytest.approx(0.2)
