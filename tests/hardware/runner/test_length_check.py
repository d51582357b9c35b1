"""A module whose length drifts away from the truth is noticed before the force is wrong by 1 N."""

import re

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.length_drift import Case, DriftingLink, clean, drifts, play
from tensionlab.demand import Demand, Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import WorldClock
from tensionlab.hardware.runner.state_estimation import PoseTracker
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.world import World
from tests.helpers.runs import EventList

RIGS = ("bartels2026-validation", "cube-8", "seven-modules", "tetra-4")


@pytest.mark.parametrize("rate", [-0.2, -0.02, 0.02, 0.1])
@pytest.mark.parametrize("rig", RIGS)
def test_a_drift_is_noticed_before_the_force_is_wrong_by_1_newton(rig, rate):
    found = play(Case(RIGS.index(rig), rig, rate, speed_agrees=rate > 0.0))
    assert found.force_error < 1.0
    assert re.search(f'(drifted apart: .*that|cable length) of module "{re.escape(found.victim)}"', found.reason)
    assert found.after < 1.0 + 0.15 / abs(rate)


@pytest.mark.parametrize("seed", [39, 54, 179, 229, 239])
def test_near_singular_poses_the_force_is_limited_so_that_a_drift_changes_it_by_less_than_1_newton(seed):
    case = next(case for case in drifts(1, seed) if case.rig == "bartels2026-validation-0.3m")
    assert play(case).force_error < 1.0


def rendered(name, away, force):
    """Return the latest cycle of a run with a force at a pose away from home, and its events `unchecked`."""
    rig = tl.load_rig(name)
    world = World(rig, lambda _: Pose(rig.home + away))
    events, demand = EventList(), Demand(np.array(force))
    runner = Runner(rig, world.group(), "newton", lambda _: demand, sinks=[events], clock=WorldClock(world))
    runner.run(1.0)
    return runner.latest, [event.text for event in events if event.kind == "unchecked"]


def test_a_limited_force_is_logged_as_such_and_is_what_the_tensions_render():
    cycle, events = rendered("bartels2026-validation-0.3m", [-0.07, 0.0, 0.0], [-0.5, 0.0, 0.0])
    assert cycle.demand.desired.tolist() == [-0.5, 0.0, 0.0]
    assert np.linalg.norm(cycle.demand.wrench - cycle.demand.desired) > 0.1
    assert cycle.state.structure @ cycle.commanded == pytest.approx(cycle.demand.wrench, abs=1e-6)
    assert len(events) == 1
    assert "the force is limited there" in events[0]


@pytest.mark.parametrize("rig", RIGS)
def test_away_from_singular_poses_no_force_is_limited(rig):
    cycle, events = rendered(rig, [0.05, 0.05, 0.05], [0.5, 0.3, 0.8])
    assert cycle.demand.desired is None
    assert cycle.demand.wrench.tolist() == [0.5, 0.3, 0.8]
    assert events == []


def test_the_module_that_drifts_is_the_only_one_named_where_two_cables_are_to_spare():
    found = play(Case(3, "seven-modules", -0.02))
    assert found.reason.count("that of module") == 1
    assert found.victim in found.reason
    assert "mm too short" in found.reason


@pytest.mark.parametrize("case", [*clean(2.0 / 60.0, rigs=RIGS, minutes=0.5)], ids=str)
def test_quick_hands_late_telemetry_and_anchors_that_are_a_little_off_stop_no_run(case):
    found = play(case)
    assert found.reason == ""
    assert found.doubt < 0.6


def drifting(name, victim, rate, *, speed_agrees):
    """Return a runner of a hand at rest, and the list to which it adds by how much a length is wrong."""
    rig = tl.load_rig(name)
    world, offsets = World(rig), []

    def demand(state):
        offsets.append(link.offset())
        return Demand(np.zeros(3))

    links = [SimulatedLink(module) for module in world.modules]
    links[victim] = link = DriftingLink(links[victim], 1.0, rate, speed_agrees=speed_agrees)
    clients = [ModuleClient(each.name, link, 0) for each, link in zip(rig.modules, links, strict=True)]
    return Runner(rig, ModuleGroup(clients), "newton", demand, clock=WorldClock(world)), offsets


def test_without_redundancy_the_run_says_so_and_goes_by_the_cables_own_speed():
    runner, offsets = drifting("floor-3", 1, 0.02, speed_agrees=False)
    runner.sinks.append(events := EventList())
    with pytest.raises(HardwareError, match=r'module "floor-2" has drifted by \+6\d mm that its speed does not'):
        runner.run(10.0)
    assert 0.059 < offsets[-1] < 0.08
    said = [event.text for event in events if event.kind == "unchecked"]
    assert len(said) == 1
    assert said[0].startswith("3 cables for 3 unknowns do not check each other's lengths")


def test_lengths_that_jump_as_fast_as_their_speed_says_are_refused_as_soon_as_they_have_fitted_no_pose():
    """Faster than any drift: a cable that is being reeled in, as far as speeds tell."""
    runner, offsets = drifting("bartels2026-validation", 3, -2.0, speed_agrees=True)
    with pytest.raises(HardwareError, match="cable lengths fit no pose"):
        runner.run(3.0)
    rig, tracker, seconds = runner.rig, PoseTracker(runner.rig), 0.0
    away = np.array([0.0, 0.0, 0.0, -2.0])
    while tracker.fits or not seconds:
        seconds += 0.01
        tracker.follow(rig.lengths(rig.home) + seconds * away, np.ones(4, dtype=bool))
    assert -offsets[-1] / 2.0 == pytest.approx(seconds + 0.25, abs=0.06)


def test_in_lockstep_each_cycle_begins_at_its_deadline():
    world = World(tl.load_rig("bartels2026-validation"))
    runner = Runner(world._rig, world.group(), "newton", lambda _: Demand(np.zeros(3)), clock=WorldClock(world))
    assert np.abs(runner.run(1.0).start_delays).max() < 1e-9
