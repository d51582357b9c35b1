"""The scenarios render what is expected, on simulated modules with a simulated person; the collision in detail."""

from __future__ import annotations

import numpy as np
import pytest

from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.module import WORLD
from tensionlab.scenarios import SCENARIOS, load_scenario
from tensionlab.scenarios.checks import scenario_fidelity
from tensionlab.scenarios.expected import check_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tests.helpers.examples import PROFILE

WALL = 0.30
# When it has begun to lean, when it turns back, and when it comes again: as in the file, in s.
LEANS, TURNS, RUNS = 3.2, 4.2, 5.4


# Which scenarios, and how long their links take, in s. `test_tracked.py` has all without a delay.
PLAYED = [(name, 0.02) for name in SCENARIOS] + [("collision", 0.0)]
if PROFILE == "nightly":
    PLAYED = [(name, delay) for name in SCENARIOS for delay in (0.0, 0.02)]


def decided(played):
    return [(event.time, event.text) for event in played.run.events if event.kind == "brake"]


def the_motors_warn_before_the_brakes_hold(played):
    locked = next(time for time, text in decided(played) if text.startswith("locked"))
    before = played.person.force[played.person.time < locked]
    assert np.linalg.norm(before, axis=1).max() < 2.5
    assert -before[-1, 0] > 1.8
    assert -before[:1500, 0].mean() < 1.4  # of taut cables, while it is far


def the_head_is_stopped_at_the_wall_and_held_while_it_leans(played):
    person = played.person
    leaning = (person.time > LEANS) & (person.time < TURNS)
    push = -person.force[leaning, 0]
    assert push.min() > 30.0
    assert push.max() < 40.0
    assert np.abs(person.force[leaning, 1:]).max() < 0.1 * push.min()
    reached = person.position[person.time < TURNS, 0].max()
    assert -0.012 < reached - WALL < 0.005
    assert np.ptp(person.position[leaning, 0]) < 0.001


def it_withdraws_freely(played):
    person, upper = played.person, played.scenario.rig.limits.upper
    leant = person.position[(person.time > LEANS) & (person.time < TURNS), 0].mean()
    back = person.time[(person.time > TURNS) & (person.position[:, 0] < leant - 0.002)][0]
    after = (person.time > back + 0.2) & (person.time < RUNS)
    assert (person.tensions[after] <= upper).all()
    assert person.position[after, 0].min() < 0.05


def what_is_too_fast_is_refused_with_a_reason(played):
    second = [text for time, text in decided(played) if time > RUNS]
    assert second[0] == "too fast"
    fast = played.person.time > RUNS
    assert played.person.position[fast, 0].max() > WALL + 0.1
    assert np.linalg.norm(played.person.force[fast], axis=1).max() < 10.0


def the_force_on_a_head_stays_below_60_newtons(played):
    assert np.linalg.norm(played.person.force, axis=1).max() < 60.0


COLLISION = (
    the_motors_warn_before_the_brakes_hold,
    the_head_is_stopped_at_the_wall_and_held_while_it_leans,
    it_withdraws_freely,
    what_is_too_fast_is_refused_with_a_reason,
    the_force_on_a_head_stays_below_60_newtons,
)


def test_all_cables_together_cannot_reach_60_newtons():
    modules = load_scenario("collision").rig.modules
    assert sum(module.upper + (module.brake or 0.0) for module in modules) < 60.0 - 2.0


def test_no_brake_rides_on_the_body():
    modules = load_scenario("collision").rig.modules
    assert {module.name for module in modules if module.brake} == {"left-post", "right-post"}
    assert {module.frame for module in modules if module.brake} == {WORLD}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "delay"), PLAYED)
def test_a_scenario_is_as_expected_even_over_a_slow_link(name, delay):
    scenario = load_scenario(name)
    modules = simulate_modules(scenario, Conditions(delay) if delay else None)
    played = play(scenario, modules)
    modules.group.close()
    assert played.statistics.ended == "duration reached"
    assert not played.statistics.lost
    rows = check_scenario(played)
    assert len(rows) >= 3
    for row in rows:
        assert row.met, row
    if name == "collision":
        assert len(rows) >= 5
        for holds in COLLISION:
            holds(played)
    if not delay:  # a late loop is told, and is no failure of the scenario
        assert all(each.passed is not False for each in scenario_fidelity(played).values())
