"""What of a scenario can be seen, and what of that is in the logs of its runs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensionlab.errors import LogError
from tensionlab.haptics.effects import Box, Shape
from tensionlab.hardware.log.reader import read_run
from tensionlab.model.module import upward
from tensionlab.scenarios import SCENARIOS, Phase, load_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.scenarios.scenery import ScenerySurface, as_mapping, read_scenery, scenery, standing_person


def kinds(name):
    return {phase.name: [each.kind for each in phase.surfaces] for phase in scenery(load_scenario(name)).phases}


def test_each_phase_has_the_surfaces_of_its_effects_and_of_its_brakes():
    assert kinds("materials") == {
        "magnetic": ["plane"], "textured": ["plane"], "shaped": ["ball"], "vibrating": [], "water": ["plane"],
    }  # fmt: skip
    assert kinds("bow") == {"draw": [], "full draw": ["reach"]}
    assert kinds("recoil") == {"shots": []}
    [wall] = scenery(load_scenario("collision")).phases
    cue, hold = wall.surfaces  # the same cue for two modules is one surface
    assert (cue.point[0], cue.brakes, hold.point[0], hold.brakes) == (0.26, False, 0.30, True)


def test_a_box_has_its_edges():
    bow = load_scenario("bow")
    shape = Shape(field=Box(centre=(0.1, 0.0, 1.0), size=(0.2, 0.3, 0.4)))
    seen = scenery(replace(bow, phases=(Phase("box", 0.0, 1.0, {"solid": shape}),)))
    assert seen.phases[0].surfaces == (ScenerySurface("box", (0.1, 0.0, 1.0), size=(0.2, 0.3, 0.4)),)


def test_phases_are_active_by_the_time_and_again_where_the_scenario_is_repeated():
    bow = load_scenario("bow")
    once, again = scenery(bow), scenery(bow, repeat=True)
    assert [phase.name for phase in once.active_phases(1.0)] == ["draw", "full draw"]
    assert [phase.name for phase in once.active_phases(4.0)] == ["draw"]
    assert once.active_phases(6.0) == ()
    assert [phase.name for phase in again.active_phases(6.0)] == ["draw", "full draw"]


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_is_written_is_read_again(name):
    scenario = load_scenario(name)
    written = json.loads(json.dumps(as_mapping(scenario, repeat=True)))
    assert read_scenery(written, scenario.rig, "run.mcap", LogError) == scenery(scenario, repeat=True)


def test_the_log_of_a_scenario_has_its_scenery_and_that_of_another_run_none(tmp_path):
    bow = load_scenario("bow")
    play(bow, simulate_modules(bow), seconds=0.1, log=tmp_path / "bow.mcap")
    run = read_run(tmp_path / "bow.mcap")
    assert read_scenery(run.setup.scenery, run.rig, "bow.mcap", LogError) == scenery(bow)
    assert read_scenery({}, run.rig, "run.mcap", LogError) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda given: given | {"phases": 3}, "the scenery is damaged: phases is 3"),
        (lambda given: given | {"middle": [0.0, 1.0]}, "does not have the 3 axes of the rig"),
        (lambda given: given | {"middle": [0.0, None, 1.0]}, r"middle\[1\] is null"),
        (lambda given: given | {"frame": "sling"}, 'in the frame "sling", which the rig does not have'),
        (
            lambda given: given | {"phases": [{"name": "a", "begin": 0, "end": 1, "surfaces": [
                {"kind": "ball", "point": [0, 0, 0]}
            ]}]},
            "a ball of the scenery has no radius",
        ),
    ],
)  # fmt: skip
def test_a_scenery_that_is_none_of_the_rig_is_refused(change, message):
    bow = load_scenario("bow")
    given = change(json.loads(json.dumps(as_mapping(bow))))
    with pytest.raises(LogError, match=message):
        read_scenery(given, bow.rig, "run.mcap", LogError)


def placed(*places, up="z", feet=(0.1, 0.2, 0.0)):
    """Where a person stands, and the direction that it faces, for places of its parts."""
    bodies, at_rest = standing_person(np.array(feet), up, [(name, np.array(place)) for name, place in places])
    assert {body.frame for body in bodies} == {at_rest.name}
    ahead = np.roll(upward(up, 3), 1)
    return at_rest.position, Rotation.from_rotvec(np.array(at_rest.rotation)).apply(ahead)


def test_a_person_faces_its_hands_from_below_its_trunk():
    at, ahead = placed(("left hand", (0.6, 0.4, 1.2)), ("right hand", (0.6, 0.0, 1.0)))
    np.testing.assert_allclose(at, [0.1, 0.2, 0.0])
    np.testing.assert_allclose(ahead, [1.0, 0.0, 0.0], atol=1e-12)
    at, ahead = placed(("torso", (0.5, 0.0, 1.4)), ("head", (0.7, 0.0, 1.6)), ("hand", (0.6, -0.9, 1.2)))
    np.testing.assert_allclose(at, [0.6, 0.0, 0.0])
    np.testing.assert_allclose(ahead, [0.0, -1.0, 0.0], atol=1e-12)
    at, ahead = placed(("hand", (1.1, 1.3, 0.2)), up="y", feet=(0.1, 0.0, 0.2))
    np.testing.assert_allclose([*at, *ahead], [0.1, 0.0, 0.2, 1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(placed(("hand", (0.1, 0.2, 2.0)))[1], placed()[1], atol=1e-12)
