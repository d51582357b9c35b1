"""The force on a head stays below 60 N, however it comes at the wall; where it does not, the report shows it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.impacts import (
    MAX_FORCE_N,
    STILL_S,
    Impact,
    brake_wall,
    draw_impact,
    impacts,
    outcome,
    report,
    scenario_of,
    with_strength,
)
from tensionlab.errors import ScenarioError
from tensionlab.scenarios import load_scenario
from tests.helpers.examples import many

COUNT = many(20, least=4)  # `make impacts` plays 1,000
COLLISION = load_scenario("collision")
HEAD_ON = Impact(1.0, (1.0, 0.0, 0.0), (0.3, 0.0, 1.65), 0.15, 6.0, 1500.0, 0.0, 0)


@pytest.mark.slow
def test_no_head_is_pulled_by_more_than_60_newtons():
    outcomes = list(impacts(COLLISION, COUNT))
    assert len(outcomes) == COUNT
    assert max(each.force for each in outcomes) <= MAX_FORCE_N, report(outcomes)
    assert not any(each.fault for each in outcomes)
    assert {each.end for each in outcomes} >= {"stopped", "refused"}


def test_a_fast_head_is_refused_with_a_small_force_and_so_it_is_again():
    found = outcome(HEAD_ON, COLLISION)
    assert outcome(HEAD_ON, COLLISION) == found
    assert found.end == "refused"
    assert found.speed > 0.5
    assert found.depth > 0.1
    assert found.force < 20.0


def test_a_slow_head_is_stopped():
    found = outcome(replace(HEAD_ON, speed=0.08, distance=0.02), COLLISION)
    assert found.end == "stopped"
    assert found.depth < 0.005
    assert 10.0 < found.force < MAX_FORCE_N


def test_without_refusal_and_breakaway_the_force_on_the_same_head_is_too_large():
    careless = replace(
        COLLISION,
        rig=with_strength(COLLISION.rig, 186.0),
        phases=tuple(replace(each, hold=replace(each.hold, cap=None)) for each in COLLISION.phases),
    )
    found = outcome(HEAD_ON, careless)
    assert found.force > MAX_FORCE_N
    assert "1 above 60 N" in report([found])


def test_a_head_on_brakes_without_breakaway_links_is_refused():
    said = "hold up to 380 N together, and a hold's cap allows 60 N; put breakaway links"
    with pytest.raises(ScenarioError, match=said):
        replace(COLLISION, rig=with_strength(COLLISION.rig, 186.0))
    replace(COLLISION, rig=with_strength(COLLISION.rig, 26.0))


def test_impacts_are_drawn_as_said():
    rng, wall = np.random.default_rng(1), brake_wall(COLLISION)
    drawn = [draw_impact(rng, wall) for _ in range(2000)]
    cosines = np.array([each.direction @ -wall.n for each in drawn])
    assert cosines.min() >= math.cos(math.radians(40.0))
    assert np.allclose([np.linalg.norm(each.direction) for each in drawn], 1.0)
    speeds, masses = np.array([each.speed for each in drawn]), np.array([each.mass for each in drawn])
    assert 0.05 <= speeds.min() < 0.1
    assert 1.9 < speeds.max() <= 2.0
    assert 0.3 < np.median(speeds) < 0.34
    assert 3.0 <= masses.min() < 3.1
    assert 5.9 < masses.max() <= 6.0
    assert np.allclose([wall.height(np.array(each.position)) for each in drawn], 0.0)


def test_an_impact_means_to_pass_the_wall_at_its_speed():
    scenario = scenario_of(HEAD_ON, COLLISION)
    script, half = scenario.person.script, STILL_S + HEAD_ON.duration / 2
    assert np.allclose(script.position(half), HEAD_ON.position)
    assert (script.position(half + 1e-4) - script.position(half))[0] / 1e-4 == pytest.approx(1.0, rel=1e-3)
