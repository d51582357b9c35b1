"""What a scenario needs of its rig: told before it plays, and true."""

import dataclasses

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.scenarios import check_needs, load_scenario
from tensionlab.scenarios.rehearsal import rehearse

TABLE = """
title = "A table"
about = "The hand rests on it."
rig = "seven-modules"
up = "y"
seconds = 1.5
rate = 100.0

[person]
mass = 0.8
stiffness = 300.0
damping = 25.0
script.waypoints = [
    { time = 0.0, position = [0.0, 1.22, 0.0] },
    { time = 0.5, position = [0.0, 1.18, 0.0] },
]

[[phases]]
name = "table"
begin = 0.0
end = 1.5
effects.top = { kind = "wall", plane = { point = [0.0, 1.2, 0.0] }, stiffness = 300.0, damping = 0.0 }
"""


@pytest.fixture
def table(tmp_path):
    """A scenario in a file, with something changed, on a rig."""

    def scenario(old="", new="", rig=None):
        assert old in TABLE
        (tmp_path / "table.toml").write_text(TABLE.replace(old, new, 1) if old else TABLE)
        return load_scenario(tmp_path / "table.toml", rig)

    return scenario


def needs(scenario):
    return {each.name: each for each in check_needs(scenario)}


def rig_of(**changes):
    return dataclasses.replace(tl.load_rig("seven-modules"), **changes)


def saved(rig, folder):
    tl.save_rig(rig, folder / "rig.toml")
    return folder / "rig.toml"


def test_the_hand_rests_where_the_springs_of_arm_and_table_balance(table):
    """Both are 300 N/m, and 4 cm apart at their ends: the hand is in the middle, and 3 N hold it."""
    played = rehearse(table())
    assert played.position[-1] == pytest.approx([0.0, 1.19, 0.0], abs=1e-4)
    assert played.desired[-1] == pytest.approx([0.0, 3.0, 0.0], abs=0.03)
    rig = tl.load_rig("seven-modules")
    np.testing.assert_allclose(played.structure, rig.structure_matrix(played.position))
    np.testing.assert_allclose(played.lengths, rig.lengths(played.position))


def test_a_rig_that_has_everything(table):
    found = needs(table())
    assert {name: each.passed for name, each in found.items()} == {"reach": True, "table": True}
    assert found["table"].text == "up to 3.6 N are desired, and feasible"


def test_where_the_hand_is_out_of_the_rig_is_said(table):
    outside = table("[0.0, 1.18, 0.0]", "[0.0, 1.18, 9.0]")
    found = needs(outside)["reach"]
    assert found.passed is None
    assert "the cables hold the hand" in found.text
    away = needs(table("[0.0, 1.22, 0.0]", "[0.0, 1.22, 9.0]"))  # and at once on its way from there
    assert away["reach"].passed is None
    lost = TABLE.replace("[0.0, 1.22, 0.0]", "[0.0, 1.22, 9.0]").replace("[0.0, 1.18, 0.0]", "[0.0, 1.18, 9.0]")
    assert needs(table(TABLE, lost))["reach"].passed is False


def test_what_the_motors_cannot_is_said_with_how_much_they_can(table, tmp_path):
    """Modules that pull with at most 0.6 N render a part of 3 N, and those that only pull down nothing."""
    rig = rig_of(modules=tuple(dataclasses.replace(each, upper=0.6) for each in rig_of().modules))
    weak = needs(table(rig=saved(rig, tmp_path)))["table"]
    assert weak.passed is None
    along = float(weak.text.split(" s, ")[1].split(" N are")[0])
    W = rig.structure_matrix([0.0, 1.19, 0.0])
    most = tl.allocate(W, [0.0, 3.0, 0.0], rig.limits, policy="direction").wrench[1]
    assert along == pytest.approx(most, abs=0.1)
    assert needs(table(rig="floor-3"))["table"].passed is False


def test_what_the_rig_holds_anyway_is_no_part_of_what_is_felt(table, tmp_path):
    """A platform of 0.3 kg leaves 2.94 N less for what pulls up, and what is missing is said without it."""
    light = rig_of(modules=tuple(dataclasses.replace(each, upper=3.0) for each in rig_of().modules))
    heavy = dataclasses.replace(light, platform=tl.Platform(0.3), required=tl.Requirement(gravity=True))
    W = light.structure_matrix([0.0, 1.19, 0.0])
    most = tl.allocate(W, [0.0, 100.0, 0.0], light.limits, policy="direction").wrench[1]
    assert needs(table(rig=saved(light, tmp_path)))["table"].passed is True
    text = needs(table(rig=saved(heavy, tmp_path)))["table"].text
    along = float(text.split(" s, ")[1].split(" N are")[0])
    assert along == pytest.approx(most - 0.3 * 9.81, abs=0.15)


@pytest.mark.parametrize(("brake", "passed"), [(100.0, True), (12.0, None), (None, False)])
def test_brakes_are_weighed_where_the_hand_is_stopped(table, tmp_path, brake, passed):
    hold = "end = 1.5\nhold = { force = 40.0, plane = { point = [0.0, 1.195, 0.0], normal = [0.0, 1.0, 0.0] } }"
    rig = rig_of(modules=tuple(dataclasses.replace(each, brake=brake) for each in rig_of().modules))
    found = needs(table("end = 1.5", hold, saved(rig, tmp_path)))["table: brakes"]
    assert found.passed is passed, found.text
    assert ("no module has a brake" in found.text) is (brake is None)


@pytest.mark.parametrize("name", ["recoil", "bow"])
def test_scenarios_that_come_along_have_nothing_that_their_rigs_cannot(name):
    assert all(each.passed is not False for each in check_needs(load_scenario(name)))
