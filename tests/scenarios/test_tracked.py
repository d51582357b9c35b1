"""Scenarios on modules whose tracker sends the poses of hand and bodies by OSC."""

import numpy as np
import pytest

from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.source import tracked_pose
from tensionlab.hardware import World, WorldClock
from tensionlab.scenarios import SCENARIOS, Person, load_scenario
from tensionlab.scenarios.fidelity import run_fidelity
from tensionlab.scenarios.play import ScenarioModules, needs_tracker, play
from tests.helpers.tracked import bundle_of

PARTS = {"materials": 3.0, "collision": 6.2, "recoil": 3.2, "weight": 3.6}  # duration in s, where it is not all
TRACKER_PERIOD_S = 1.0 / 90.0


class TrackedPerson(Person):
    """Person whom a tracker follows, and who begins with the first tension of all cables."""

    due, track = 0.0, None

    def __call__(self, time):
        pose = super().__call__(time)
        if (self._tensions > 0.3).all():
            self.begin()
        if self.track is not None and time >= self.due:
            self.due = time + TRACKER_PERIOD_S
            frames = {name: np.asarray(place) for name, (place, _) in (pose.frames or {}).items()}
            self.track(bundle_of({"hand": pose.position, **frames}, 1.7e9 + time), "127.0.0.1")
        return pose


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_is_as_expected_with_a_person_whom_only_the_modules_and_a_tracker_know(name):
    scenario, ignored = load_scenario(name), []
    person = TrackedPerson(scenario.person, scenario.rig)
    world = World(scenario.rig, person)
    client = ClientState(scenario.rig, lambda: world.time)
    tracker = tracked_pose(client) if needs_tracker(scenario.rig) else None
    links = {module.name: "sim:" for module in scenario.rig.modules}
    with OscServer(client, "127.0.0.1", 0, ignored.append) as osc:
        person.track = osc.receive
        found = play(
            scenario, ScenarioModules(world.group(), WorldClock(world), links, tracker), seconds=PARTS.get(name)
        )
    assert found.statistics.ended == "duration reached"
    assert [ignored, dict(found.statistics.lost), dict(found.statistics.unconfirmed)] == [[], {}, {}]
    fidelity = run_fidelity(found.run)
    assert all(each.passed is not False or each.direction < 45.0 for each in fidelity.values()), fidelity
