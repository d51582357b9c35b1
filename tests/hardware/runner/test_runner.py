"""What a run renders, in lockstep with simulated modules; `test_faults.py` has what can go wrong."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.demand import Demand, Impedance, Pose
from tensionlab.errors import HardwareError, LinkError, ModuleFault
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import World
from tensionlab.model.module import GRAVITY_M_S2
from tensionlab.solvers.base import Answer, Status


@pytest.fixture
def rig():
    return tl.load_rig("bartels2026-validation")


def run(world, rig, demand, seconds=1.0, solver="newton", **options):
    settings = options.pop("settings", RunSettings())
    runner = Runner(rig, world.group(), solver, demand, settings, clock=WorldClock(world), **options)
    runner.run(seconds)
    return runner


@dataclass(frozen=True)
class GivesUp:
    """Never proves anything."""

    policies = ("force",)

    def solve(self, problem):
        count, _, m = problem.structure.shape
        return Answer(np.full((count, m), 3.0), np.full(count, 7))


@pytest.mark.parametrize("solver", ["newton", "dykstra", "qp:daqp", "least-sum", "closed-form", GivesUp()])
def test_the_modules_pull_with_the_force_that_is_asked_for_and_no_unproved_answer_is_sent(rig, solver):
    world, force = World(rig), np.array([0.5, 0.3, -1.0])
    runner = run(world, rig, lambda state: Demand(force), solver=solver)
    last, statistics = runner.latest, runner.statistics
    assert last.allocation.status == Status.EXACT
    np.testing.assert_allclose(last.state.structure @ last.state.tensions, force, atol=2e-4)
    assert (statistics.cycles, statistics.statuses) == (50, {Status.EXACT: 50})
    assert statistics.fallback_used == (50 if isinstance(solver, GivesUp) else 0)
    assert last.fallback_used == isinstance(solver, GivesUp)
    assert {module.sample.state for module in world.modules} == {State.IDLE}


@pytest.fixture
def heavy(rig):
    """A rig whose cables hold a platform of 0.1 kg, against a push of 0.2 N along x."""
    load = tl.Requirement(wrench=[0.2, 0.0, 0.0], box=[0.1, 0.1, 0.1], gravity=True)
    return replace(rig, platform=tl.Platform(0.1), required=load)


@pytest.mark.parametrize("force", [None, (0.5, 0.3, -0.5)])
def test_what_the_rig_requires_is_rendered_in_addition_to_what_is_desired(heavy, force):
    demand = Demand(None if force is None else np.array(force))
    last = run(World(heavy), heavy, lambda state: demand).latest
    held = np.array([0.2, 0.0, 0.0]) + 0.1 * GRAVITY_M_S2 * heavy.upward
    expected = held if force is None else held + force
    np.testing.assert_allclose(last.demand.wrench, expected)
    np.testing.assert_allclose(last.state.structure @ last.state.tensions, expected, atol=2e-4)


def test_the_force_follows_a_hand_that_moves(rig):
    """Where the hand is comes from the cable lengths alone; cables stretch, so that it is not quite true."""

    def motion(time):
        return Pose(rig.home + 0.05 * np.array([np.cos(4 * time) - 1, 0.2 * np.sin(4 * time), np.sin(4 * time)]))

    world, force, errors = World(rig, motion), np.array([0.0, 0.0, 1.5]), []

    def demand(state):
        angle = 4.0 * world.time
        velocity = 0.2 * np.array([-np.sin(angle), 0.2 * np.cos(angle), np.cos(angle)])
        errors.append([*(state.pose.position - world.pose.position), *(state.twist - velocity)])
        return Demand(force)

    runner = run(world, rig, demand, 2.0)
    assert np.abs(np.array(errors)[5:, :3]).max() < 1e-3
    assert np.abs(np.array(errors)[5:, 3:]).max() < 0.03
    np.testing.assert_allclose(runner.latest.allocation.wrench, force, atol=1e-6)


def test_a_platform_is_found_with_its_rotation():
    rig = tl.load_rig("ipanema-1")
    modules = [tl.Module(each.name, each.anchor, 0.5, 6.0, each.attachment) for each in rig.modules]
    rig = tl.Rig(rig.name, rig.kind, modules, rig.home)

    def motion(time):
        turn = Rotation.from_euler("z", 0.1 * time).as_matrix()
        return Pose(rig.home + np.array([0.1, 0.05, -0.02]) * time, turn)

    world, true = World(rig, motion), []

    def demand(state):
        true.append(world.pose)
        return Demand()

    state = run(world, rig, demand, 1.0).latest.state
    np.testing.assert_allclose(state.pose.position, true[-1].position, atol=2e-3)
    # Cables stretch by 0.13 mm, and those of this rig hardly resist a turn about the vertical.
    np.testing.assert_allclose(state.pose.rotation, true[-1].rotation, atol=6e-3)
    np.testing.assert_allclose(state.twist[:3], [0.1, 0.05, -0.02], atol=0.02)


@pytest.mark.parametrize("solver", ["newton", "closed-form", "safe"])
def test_without_a_wrench_the_cables_are_held_taut(rig, solver):
    runner = run(World(rig), rig, lambda state: Demand(), solver=solver)
    np.testing.assert_allclose(runner.latest.commanded, rig.limits.lower, atol=1e-9)


def test_set_points_change_no_faster_than_the_modules_allow(rig):
    cycles, world = [], World(rig)

    def demand(state):
        cycles.append(runner.latest)
        return Demand(np.array([0.0, 0.0, 3.0 if state.cycle % 2 else -3.0]))

    runner = Runner(rig, world.group(), "newton", demand, clock=WorldClock(world))
    runner.run(1.0)
    sent = np.array([cycle.commanded for cycle in cycles[1:]])
    assert np.abs(np.diff(sent, axis=0)).max() <= 60.0 / 50.0 + 1e-9
    assert runner.statistics.slew_limited > 40
    # All go the same share of their way: the wrench stays between the old one and the new one, in direction too.
    rendered = np.array([cycle.state.structure @ cycle.commanded for cycle in cycles[1:]])
    assert np.abs(rendered[10:, :2]).max() < 0.01


def test_rate_limited_tensions_are_reached_in_each_cycle(rig):
    def swing(state):
        return Demand(np.array([2.0 * np.sin(40.0 * state.time), 0.0, 1.0]))

    late = [run(World(rig), rig, swing, settings=RunSettings(rate_limited=limited)) for limited in (False, True)]
    assert late[0].statistics.slew_limited > 5
    assert late[1].statistics.slew_limited == 0


def test_modules_with_an_impedance_render_it_and_the_others_share_the_wrench(rig):
    spring = Impedance(rest=1.9, stiffness=10.0, feed_forward=0.5)
    force = np.array([0.0, -1.0, 0.0])
    world = World(rig)
    runner = run(world, rig, lambda state: Demand(force, impedances={"top": spring}))
    cycle = runner.latest
    assert cycle.state.tensions[3] == pytest.approx(0.5 + 10.0 * 0.1, abs=0.02)
    assert np.isnan(cycle.commanded[3])
    assert cycle.sequences[3] >= 0
    # All together exert the force; what the spring pulls is known from the cable's reported length.
    pulls = np.append(cycle.commanded[:3], spring.tension(cycle.state.lengths[3], cycle.state.speeds[3]))
    np.testing.assert_allclose(cycle.state.structure @ pulls, force, atol=1e-6)


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_it_knows_the_latency_of_its_loop(rig, latency):
    delays, world = [], World(rig)

    def demand(state):
        delays.append(state.delays)
        return Demand(np.array([0.0, np.sin(9.0 * state.time), 0.0]))

    Runner(rig, world.group(Conditions(latency)), "newton", demand, clock=WorldClock(world)).run(1.0)
    settled = np.array(delays[20:])
    assert (settled > 2 * latency).all()
    assert (settled <= 2 * latency + 3.1 / 50.0).all()  # what is on its way moves on once a cycle


def test_a_tracker_takes_the_place_of_the_lengths_and_nothing_is_sent_before_the_first_cycle(rig):
    delays, place = [], Pose(rig.home + np.array([0.01, 0.0, 0.0]))

    def demand(state):
        delays.append(state.delays)
        return Demand(np.array([0, 0, 1.0]))

    runner = run(World(rig), rig, demand, tracker=lambda time: place)
    np.testing.assert_array_equal(runner.latest.state.structure, rig.structure_matrix(place.position))
    assert np.isnan(delays[0]).all()
    assert np.isfinite(delays[5]).all()


def test_brakes_are_laid_on(rig):
    world = World(rig)

    def demand(state):
        return Demand(brakes=frozenset({"top"}), stop=state.time > 0.5 and closed(state))

    def closed(state):
        return world.modules[3].sample.pawl_down

    runner = run(world, rig, demand, None)
    assert runner.statistics.ended == "stopped by the demand"


def test_a_rig_on_a_body_needs_a_tracker():
    rig = tl.load_rig("body-mounted")
    world = World(rig)
    with pytest.raises(HardwareError, match="modules are attached to shoulder, hip, so cable lengths do not tell"):
        run(world, rig, lambda state: Demand())
    frames = {"shoulder": (np.array([0.0, 1.4, 0.0]), None), "hip": (np.array([0.0, 1.0, 0.0]), None)}
    moved = World(rig, lambda time: Pose(rig.home, frames=frames))
    force = np.array([0.0, 0.0, 0.5])
    runner = run(moved, rig, lambda state: Demand(force), tracker=lambda time: Pose(rig.home, frames=frames))
    np.testing.assert_allclose(runner.latest.allocation.wrench, force, atol=1e-6)


def test_modules_that_cannot_run_are_refused_before_any_is_armed(rig):
    def refused(error, message, prepare=lambda client: None, wanted=rig):
        world = World(rig)
        prepare(world.group().clients[1])
        with pytest.raises(error, match=message):
            run(world, wanted, lambda state: Demand())
        assert {module.sample.state for module in (world.modules[0], *world.modules[2:])} == {State.IDLE}

    def forget_length(client):
        client.set_parameter("spool_radius", 0.02)  # turns no longer tell the length
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)

    modules = [tl.Module(each.name, each.anchor, 0.5, 9.0) for each in rig.modules]
    strong = tl.Rig(rig.name, rig.kind, modules, rig.home)
    refused(HardwareError, r'"floor-1" pulls with 0\.5 to 6 N, but the rig wants 0\.5 to 9 N', wanted=strong)
    refused(LinkError, '"floor-2" is (ARMED|RUNNING): another program has armed it', lambda client: client.arm())
    refused(ModuleFault, '"floor-2" is in ESTOP: find out why, then', lambda client: client.estop())
    refused(HardwareError, "cable lengths of floor-2 are not known", forget_length)


def round_trip(rig, radius=0.2, period=4.0):
    """Return the motion of a hand that goes round home."""

    def motion(time):
        angle = 2.0 * np.pi * time / period
        return Pose(rig.home + radius * np.array([np.cos(angle), np.sin(angle), 0.0]))

    return motion


@pytest.mark.parametrize("name", ["bartels2026-validation", "seven-modules", "floor-3"])
def test_a_run_begins_with_slack_cables_while_the_hand_moves(name):
    """Between runs nothing reels in: the hand pays cables out, and they hang slack as it comes back."""
    rig = tl.load_rig(name)
    world = World(rig, round_trip(rig))
    world.advance(7.3)
    slack = [module.sample.length - module.sample.distance for module in world.modules]
    assert max(slack) > 0.1
    errors = []

    def demand(state):
        errors.append(np.linalg.norm(state.pose.position - world.pose.position))
        return Demand()

    runner = run(world, rig, demand, 2.0)
    assert runner.statistics.ended == "duration reached"
    assert max(errors) < 1e-2


def test_lengths_of_different_instants_are_compared_at_one(rig):
    """Behind links with jitter, each module is heard at another time, while the hand makes 0.8 m/s."""
    world, errors = World(rig, round_trip(rig, 0.2, 1.6)), []
    group = world.group(Conditions(latency=0.02, jitter=0.02), seed=1)

    def demand(state):
        errors.append(np.linalg.norm(state.pose.position - world.pose.position))
        return Demand()

    Runner(rig, group, "newton", demand, RunSettings(), clock=WorldClock(world)).run(2.0)
    assert max(errors) < 0.8 * 0.1  # no further behind than the link is


def test_a_fast_hand_that_leaves_cables_slack_for_a_moment_does_not_end_a_run(rig):
    """It gets to 1.75 m/s in 0.15 s, faster than spools follow; nothing of that is taken for a fault."""
    begun = []

    def motion(time):
        share = np.clip((time - begun[0] - 0.5) / 0.3, 0.0, 1.0) if begun else 0.0
        moved = 0.28 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # with the least jerk
        return Pose(rig.home + np.array([0.0, moved, 0.0]))

    world, off = World(rig, motion), []

    def demand(state):
        if not begun:
            begun.append(world.time)
        off.append(np.linalg.norm(state.pose.position - world.pose.position))
        return Demand()

    runner = run(world, rig, demand, 2.0)
    assert runner.statistics.ended == "duration reached"
    assert max(off[-30:]) < 1e-3
