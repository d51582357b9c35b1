"""Scenario B: a head that leans into a wall is warned, stopped and let go; one that is too fast is not stopped."""

from __future__ import annotations

import numpy as np
import pytest

from tensionlab.hardware.simulation.channel import Conditions
from tensionlab.model.module import WORLD
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.expected import expected
from tensionlab.scenarios.play import play, simulated

WALL = 0.30
LEANS, TURNS, RUNS = 3.2, 4.2, 5.4
"""When it has begun to lean, when it turns back, and when it comes again: as in the file, in s."""


@pytest.fixture(scope="module", params=[None, Conditions(0.02)], ids=["no delay", "20 ms"])
def played(request):
    scenario = load_scenario("collision")
    return play(scenario, simulated(scenario, request.param))


def decided(played):
    return [(event.time, event.text) for event in played.run.events if event.kind == "brake"]


def test_the_motors_warn_before_the_brakes_hold(played):
    locked = next(time for time, text in decided(played) if text.startswith("locked"))
    before = played.felt.force[played.felt.time < locked]
    assert np.linalg.norm(before, axis=1).max() < 2.5
    assert -before[-1, 0] > 1.8
    assert -before[:1500, 0].mean() < 1.4  # of taut cables, while it is far


def test_the_head_is_stopped_at_the_wall_and_held_while_it_leans(played):
    felt = played.felt
    leaning = (felt.time > LEANS) & (felt.time < TURNS)
    push = -felt.force[leaning, 0]
    assert push.min() > 30.0
    assert push.max() < 40.0
    assert np.abs(felt.force[leaning, 1:]).max() < 0.1 * push.min()
    reached = felt.position[felt.time < TURNS, 0].max()
    assert -0.012 < reached - WALL < 0.005
    assert np.ptp(felt.position[leaning, 0]) < 0.001


def test_it_withdraws_freely(played):
    felt, most = played.felt, played.scenario.rig.limits.upper
    leant = felt.position[(felt.time > LEANS) & (felt.time < TURNS), 0].mean()
    back = felt.time[(felt.time > TURNS) & (felt.position[:, 0] < leant - 0.002)][0]
    after = (felt.time > back + 0.2) & (felt.time < RUNS)
    assert (felt.tensions[after] <= most).all()
    assert felt.position[after, 0].min() < 0.05


def test_what_is_too_fast_is_refused_with_a_reason(played):
    second = [text for time, text in decided(played) if time > RUNS]
    assert second[0] == "too fast"
    fast = played.felt.time > RUNS
    assert played.felt.position[fast, 0].max() > WALL + 0.1
    assert np.linalg.norm(played.felt.force[fast], axis=1).max() < 10.0


def test_a_head_never_feels_60_newtons(played):
    assert np.linalg.norm(played.felt.force, axis=1).max() < 60.0


def test_it_feels_as_expected(played):
    rows = expected(played)
    assert len(rows) >= 5
    assert [row for row in rows if not row.met] == []


def test_all_cables_together_cannot_reach_60_newtons():
    modules = load_scenario("collision").rig.modules
    assert sum(module.upper + (module.brake or 0.0) for module in modules) < 60.0 - 2.0


def test_no_brake_rides_on_the_body():
    modules = load_scenario("collision").rig.modules
    assert {module.name for module in modules if module.brake} == {"left-post", "right-post"}
    assert {module.frame for module in modules if module.brake} == {WORLD}
