"""Runs that begin with slack, caught or loose cables, in lockstep with simulated modules."""

import re

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Demand, Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.runner.pretension import MISFIT_S, SHAKING_S, WINDOW_S, require_possible, take_up_slack
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.runner.state_estimation import MAX_LENGTH_ERROR_M, Observation, PoseTracker
from tensionlab.hardware.simulation.simulated_module import COLUMNS
from tensionlab.hardware.simulation.world import World

FOUR = tl.load_rig("bartels2026-validation")
RIGS = [FOUR.name, "seven-modules", "floor-3"]
PULL = np.array([0.0, 0.5, 0.0])


def out_and_back(rig, metres):
    """Return the world of a hand that moved away from home and back in 4 s: all it pulled out hangs slack."""
    away = metres / np.sqrt(14.0) * np.array([3.0, 2.0, 1.0])
    world = World(rig, lambda time: Pose(rig.home + away * np.sin(np.pi * np.clip(time / 4.0, 0.0, 1.0)) ** 2))
    world.advance(4.1)
    return world


def slack(world):
    return np.array([module.sample.length - module.sample.distance for module in world.modules])


def begin(world, rig, rate=50.0, group=None, **options):
    """Run for 0.1 s; how slack cables were and how far the pose was off in the first cycle."""
    found = []

    def demand(state):
        found.append((slack(world).max(), np.linalg.norm(state.pose.position - world.pose.position)))
        return Demand(PULL)

    group = world.group() if group is None else group
    Runner(rig, group, "newton", demand, RunSettings(rate=rate), clock=WorldClock(world), **options).run(0.1)
    return found[0]


def watched(world):
    """Return the list to which the states and commanded tensions of all modules are added while time passes."""
    seen = []
    world.watch = lambda traces: seen.append(
        tuple(max(trace[:, COLUMNS[name]].max() for trace in traces) for name in ("state", "commanded"))
    )
    return seen


@pytest.mark.parametrize("rate", [8.0, 50.0, 1000.0])
@pytest.mark.parametrize("name", RIGS)
def test_a_run_begins_when_slack_has_been_taken_up_and_then_knows_the_pose(name, rate):
    """At 1 kHz, three cycles are over before a slack cable moves; 3 m are taken up by all spools at one speed."""
    rig = tl.load_rig(name)
    for metres in (0.3, 3.0):
        world = out_and_back(rig, metres)
        assert slack(world).max() > 0.6 * metres
        left, off = begin(world, rig, rate)
        assert left < 1e-2  # spools bounce a little as cables become taut
        assert off < 5e-3


def test_until_the_pose_is_known_no_module_pulls_with_more_than_its_minimum():
    """Also where the rig's own lower limits are higher; only then do tensions rise, by the limit on their slew."""
    modules = [tl.Module(each.name, each.anchor, 1.5, 6.0) for each in FOUR.modules]
    rig = tl.Rig("taut", FOUR.kind, modules, FOUR.home)
    world = out_and_back(rig, 2.0)
    group = world.group()
    for client in group.clients:
        client.set_parameter("tension_lower", 0.4)
    seen, begun, sent = watched(world), [], []

    def demand(state):
        begun.append(len(seen))
        sent.extend([] if runner.latest is None else [runner.latest.commanded.max()])
        return Demand()

    runner = Runner(rig, group, "newton", demand, RunSettings(), clock=WorldClock(world))
    runner.run(0.2)
    assert max(tension for _, tension in seen[: begun[0]]) == pytest.approx(0.4)
    assert max(tension for _, tension in seen) == pytest.approx(1.5)
    assert sent[0] <= 0.4 + 60.0 / 50.0


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize(("metres", "tracked"), [(0.0, False), (0.5, False), (0.5, True)])
def test_a_cable_that_holds_nothing_is_named_before_anything_is_rendered(name, metres, tracked):
    """While slack is taken up, two may be too short together: both are named."""
    rig = tl.load_rig(name)
    world = out_and_back(rig, metres)
    loose = world.modules[1]
    loose.damage("cable")
    before, rendered, place = loose.sample.length, [], Pose(rig.home)
    tracker = (lambda time: place) if tracked else None

    def demand(state):
        rendered.append(state)
        return Demand(PULL)

    runner = Runner(rig, world.group(), "newton", demand, clock=WorldClock(world), tracker=tracker)
    said = r"the cable of module (.*) is loose: it was reeled in to .* hook it on"
    with pytest.raises(HardwareError, match=said) as caught:
        runner.run(1.0)
    named = re.search(said, str(caught.value))[1].split(" or ")
    assert f'"{rig.modules[1].name}"' in named
    both = metres > 0.0 and not tracked and name != FOUR.name
    assert len(named) == (2 if both else 1)
    assert not rendered
    assert before - loose.sample.length < 2.0
    assert {module.sample.state for module in world.modules} == {State.IDLE}


@pytest.mark.parametrize(
    ("name", "wrong", "said"),
    [
        (
            "seven-modules",
            {4: 0.4},
            'that of module "{4}" is 0.40 m too long. A cable is too long where it is slack',
        ),
        ("seven-modules", {4: -0.4}, 'that of module "{4}" is 0.40 m too short. A cable is too short where'),
        ("seven-modules", {1: 0.6, 4: 0.8}, "no single one explains it. Cables are slack, caught, or off"),
        # With one cable more than unknowns, each explains it by the same sign.
        ("bartels2026-validation", {3: 0.4}, 'that of module "{3}" is 0.40 m too long'),
    ],
)
def test_lengths_at_rest_that_fit_no_pose_are_named_and_a_place_helps(name, wrong, said):
    rig = tl.load_rig(name)
    world = World(rig)
    group = world.group()
    for index, metres in wrong.items():
        group.clients[index].calibrate(Calibration.LENGTH, float(rig.lengths(rig.home)[index]) + metres)
    with pytest.raises(HardwareError, match=r"fit no pose.*--at X Y Z") as caught:
        begin(world, rig, group=group)
    text = str(caught.value)
    assert said.format(*(module.name for module in rig.modules)) in text
    if name == "bartels2026-validation":
        assert text.count("too long") == 1 + text.count("that of module")
        assert "too short" not in text
    assert {module.sample.state for module in world.modules} == {State.IDLE}
    place = Pose(rig.home)
    begin(world, rig, group=group, tracker=lambda time: place)


@pytest.mark.parametrize("name", ["seven-modules", "kntu-planar", "ipanema-1", "cogiro"])
def test_lengths_of_a_pose_are_possible_with_slack_and_not_once_two_cables_do_not_meet(name):
    rig, draw = tl.load_rig(name), np.random.default_rng(0)
    size = np.ptp(rig.anchors, axis=0)
    for _ in range(50):
        lengths = rig.lengths(rig.home + draw.uniform(-0.4, 0.4, rig.dimension) * size)
        require_possible(rig, lengths + draw.exponential(0.5, rig.m))
    gaps = [np.linalg.norm(places[0] - places[-1]) for places in (rig.anchors, rig.attachments)]
    apart = gaps[0] - gaps[1]
    lengths[[0, -1]] = apart / 2.0 - 1.1 * MAX_LENGTH_ERROR_M
    with pytest.raises(HardwareError, match=r"need .* m together to meet"):
        require_possible(rig, lengths)


def test_lengths_too_short_for_any_pose_are_refused_before_a_module_is_armed():
    """Slack cannot explain them: it makes lengths longer."""
    world = World(FOUR)
    group = world.group()
    for client in group.clients[:3]:
        client.calibrate(Calibration.LENGTH, 0.1)
    seen = watched(world)
    said = r'cables of modules "floor-\d" and "\S+" are .* m together to meet\. .* calibrate them .*--at X Y Z'
    with pytest.raises(HardwareError, match=said):
        begin(world, FOUR, group=group)
    assert {state for state, _ in seen} == {State.IDLE}


def test_cables_that_do_not_come_to_rest_are_named():
    rig = tl.load_rig("floor-3")
    world = out_and_back(rig, 50.0)
    group = world.group()
    for client in group.clients:  # a module that takes up more than there is has a fault
        client.set_parameter("length_upper", 20.0)
        client.set_parameter("speed_limit", 0.5)
    said = r'not come to rest within 20 s \(module "floor-1", "floor-2", "floor-3"'
    with pytest.raises(HardwareError, match=said):
        begin(world, rig, group=group)
    assert {module.sample.state for module in world.modules} == {State.IDLE}


def test_a_run_that_is_told_the_place_takes_up_slack_first_too():
    place = Pose(FOUR.home)
    left, _ = begin(out_and_back(FOUR, 2.0), FOUR, tracker=lambda time: place)
    assert left <= MAX_LENGTH_ERROR_M
    world = out_and_back(FOUR, 2.0)
    group = world.group()
    for client in group.clients:  # they forget their lengths
        client.set_parameter("motor_direction", -1.0)
        client.set_parameter("motor_direction", 1.0)
    left, _ = begin(world, FOUR, group=group, tracker=lambda time: place)
    assert left < 1e-2
    world = World(FOUR)
    begin(world, FOUR, tracker=lambda time: place)
    assert world.time < 0.1 + WINDOW_S, "where no cable is slack a run begins at once"


def test_an_interruption_while_slack_is_taken_up_stops_all_modules():
    world = out_and_back(FOUR, 3.0)

    class Interrupting(WorldClock):
        def wait_until(self, when):
            super().wait_until(when)
            if slack(world).max() < 2.0:
                raise KeyboardInterrupt

    runner = Runner(FOUR, world.group(), "newton", lambda state: Demand(PULL), clock=Interrupting(world))
    with pytest.raises(KeyboardInterrupt):
        runner.run(1.0)
    assert 1.5 < slack(world).max() < 2.1
    assert {module.sample.state for module in world.modules} == {State.IDLE}
    assert runner.statistics.cycles == 0


# Cables by script

TAUT = FOUR.lengths(FOUR.home)
# Changes of length, (m,), of norm 1, that fit no motion.
AGAINST = np.linalg.svd(FOUR.structure_matrix(FOUR.home))[2][-1]


def taken_up(lengths, speeds=0.0, expected=None):
    """Take up cables whose lengths are a function of the time; return the time it took."""
    began = now = 1000.0
    zero = np.zeros(FOUR.m)

    class Clock:
        def now(self):
            return now

    def cycle():
        nonlocal now
        now += 0.02
        return Observation(lengths(now - began), zero + speeds, *[zero] * 9)

    tracker = PoseTracker(FOUR) if expected is None else None
    take_up_slack(FOUR, cycle, np.ones(FOUR.m, dtype=bool), Clock(), tracker, expected)
    return now - began


def test_cables_that_move_as_no_platform_does_are_believed_after_some_seconds():
    swinging = taken_up(lambda time: TAUT + 0.24 * AGAINST * (time % 1.0 < 0.5))
    assert SHAKING_S <= swinging < SHAKING_S + WINDOW_S + 0.6
    assert taken_up(lambda time: TAUT) == pytest.approx(WINDOW_S, abs=0.05)


def test_lengths_at_rest_that_fit_no_pose_are_refused_after_a_second():
    times = []
    with pytest.raises(HardwareError, match="fit no pose"):
        taken_up(lambda time: times.append(time) or TAUT + 0.24 * AGAINST)
    assert times[-1] == pytest.approx(WINDOW_S + MISFIT_S, abs=0.1)


def test_a_cable_shorter_than_the_others_let_it_be_is_loose_at_once():
    short, fast = TAUT - [0.0, 0.2, 0.0, 0.0], np.array([0.0, -1.0, 0.0, 0.0])
    with pytest.raises(HardwareError, match='cable of module "floor-2" is loose'):
        taken_up(lambda time: short, fast)
    with pytest.raises(HardwareError, match="fit no pose"):
        taken_up(lambda time: short)


def test_with_a_place_it_ends_as_soon_as_all_lengths_are_those_of_the_place():
    took = taken_up(lambda time: TAUT + max(0.3 - 0.6 * time, 0.0), -0.6, lambda: TAUT)
    assert took == pytest.approx(0.25 / 0.6, abs=0.03)
