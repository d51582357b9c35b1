"""Cable lengths of simulated modules whose handle a person moves, in lockstep."""

import signal

import numpy as np
import pytest

from tensionlab.demand import Pose
from tensionlab.errors import CalibrationError, HardwareError, LinkError
from tensionlab.hardware.calibration import lengths as cables
from tensionlab.hardware.calibration.anchors import calibrate_anchors
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry
from tensionlab.hardware.runner.settings import WorldClock
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.support.files.tables import table_text
from tensionlab.support.operating_system import ESTOP_SIGNAL

RIG, PLANAR = load_rig("bartels2026-validation"), load_rig("kntu-planar")
STAY, GO = 1.0, 1.0
PLACES = RIG.home + np.random.default_rng(4).uniform([-0.2, 0.0, -0.2], [0.2, 0.4, 0.2], (15, 3))
PLACES[0] = RIG.home


def hand(time):
    """A person who goes from place to place, and stays a second at each."""
    index, since = divmod(time, STAY + GO)
    here, there = (PLACES[min(int(index) + step, len(PLACES) - 1)] for step in (0, 1))
    share = np.clip((since - STAY) / GO, 0.0, 1.0)
    return Pose(here + (there - here) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2))  # with the least jerk


@pytest.fixture
def world_of():
    """Return a function that makes a world with a motion of the hand, and its group."""
    groups = []

    def make(motion=None):
        world = World(RIG) if motion is None else World(RIG, motion)
        groups.append(world.group())
        return world, groups[-1]

    yield make
    for group in groups:
        group.close()


def test_lengths_at_home_are_set_in_all_modules(world_of):
    world, group = world_of()
    world.advance(3.0)
    before = cables.zero_lengths(group, RIG, WorldClock(world))
    assert 3.0 + cables.TAUT_S + cables.RELEASE_S <= world.time < 3.2 + cables.TAUT_S + cables.RELEASE_S
    np.testing.assert_allclose(before, RIG.lengths(RIG.home), atol=2e-3)
    assert all(module.sample.state is State.IDLE for module in world.modules)
    for client, length in zip(group.clients, RIG.lengths(RIG.home), strict=True):
        client.command(ConfigureTelemetry(5))
        client.listen(0.02)
        assert client.telemetry.message.length == pytest.approx(length, abs=1e-4)


@pytest.mark.parametrize("count", [2, len(PLACES)])
def test_poses_are_recorded_where_the_hand_stays_until_there_are_enough(world_of, count):
    seen, (world, group) = [], world_of(hand)
    measured = cables.record_lengths(group, RIG, WorldClock(world), count, 60.0, seen.append)
    assert seen == list(range(1, count + 1))
    np.testing.assert_allclose(measured, RIG.lengths(PLACES[:count]), atol=1e-3)
    assert all(module.sample.state is State.IDLE for module in world.modules)
    if count == len(PLACES):
        assert np.abs(calibrate_anchors(RIG, measured).anchors - RIG.anchors).max() < 0.01


def test_a_hand_that_never_stays_gives_no_pose(world_of):
    world, group = world_of(lambda time: Pose(RIG.home + 0.05 * np.sin(6.0 * time) * np.array([0.0, 1.0, 0.0])))
    with pytest.raises(CalibrationError, match="never still"):
        cables.record_lengths(group, RIG, WorldClock(world), 5, 2.0)
    assert all(module.sample.state is State.IDLE for module in world.modules)


def test_modules_in_use_or_without_a_length_are_left_alone(world_of):
    world, group = world_of()
    group.clients[1].set_parameter("spool_radius", 0.02)  # which makes it forget
    with pytest.raises(HardwareError, match="cable lengths of floor-2 are not known"):
        cables.record_lengths(group, RIG, WorldClock(world), 5, 2.0)
    world, group = world_of()
    group.clients[0].arm()
    with pytest.raises(LinkError, match="another program has armed it"):
        cables.zero_lengths(group, RIG, WorldClock(world))


@pytest.mark.parametrize(
    ("trouble", "error", "states"),
    [
        (lambda world: signal.raise_signal(signal.SIGINT), KeyboardInterrupt, {State.IDLE}),
        (lambda world: signal.raise_signal(ESTOP_SIGNAL), KeyboardInterrupt, {State.ESTOP}),
        (lambda world: world.modules[2].damage("encoder"), HardwareError, {State.IDLE, State.FAULT}),
    ],
)
def test_whatever_goes_wrong_all_modules_are_stopped(world_of, trouble, error, states):
    world, group = world_of()
    with pytest.raises(error):
        cables.record_lengths(group, RIG, WorldClock(world), 5, 5.0, lambda count: trouble(world))
    assert {module.sample.state for module in world.modules} == states


def test_lengths_come_back_from_a_file_with_poses_and_without(tmp_path):
    path, lengths = tmp_path / "lengths.csv", cables.columns(RIG, RIG.lengths(PLACES))
    known = dict(zip("xyz", PLACES.T, strict=True)) | lengths
    path.write_text(table_text(lengths))
    again, poses = cables.load_lengths(path, RIG)
    np.testing.assert_allclose(again, RIG.lengths(PLACES), rtol=1e-9)
    assert poses is None
    path.write_text(table_text(known))
    np.testing.assert_allclose(cables.load_lengths(path, RIG)[1].position, PLACES, rtol=1e-9)
    for missing, message in (("floor-1", 'column "floor-1" is missing'), ("z", "the columns x, y, z; give all")):
        path.write_text(table_text({name: column for name, column in known.items() if name != missing}))
        with pytest.raises(CalibrationError, match=message):
            cables.load_lengths(path, RIG)
    planar = cables.columns(PLANAR, PLANAR.lengths(PLANAR.home, 0.1)[None])
    pose = {"x": [PLANAR.home[0]], "y": [PLANAR.home[1]], "angle": [0.1]}
    path.write_text(table_text(planar | pose))
    assert cables.load_lengths(path, PLANAR)[1].rotation[0, 1, 0] == pytest.approx(np.sin(0.1))
