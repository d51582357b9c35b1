"""Modules of a rig, simulated: what each is made of, and what none can be."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.demand import Pose
from tensionlab.errors import HardwareError
from tensionlab.hardware.protocol import messages
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import MAX_HAND_SPEED_M_S, GuidedHand, World, simulated_module
from tensionlab.model.files import load_rig
from tensionlab.model.module import Module


def tell(simulated, *commands):
    for sequence, command in enumerate(commands, start=1):
        simulated.receive(command.frame(sequence).pack())
    return [messages.read(frame) for frame in messages.Decoder().feed(simulated.transmit())]


def test_limits_gain_and_length_are_the_rigs():
    rig = load_rig("bartels2026-validation")
    for module, length in zip(rig.modules, rig.lengths(rig.home), strict=True):
        simulated = simulated_module(module, length, serial_number=7)
        [info] = tell(simulated, messages.Hello())
        assert (info.serial_number, info.calibrated, info.length_known) == (7, True, True)
        got = (info.tension_lower, info.tension_upper, info.newton_per_ampere, info.spool_radius)
        np.testing.assert_allclose(got, (0.5, 6.0, 3.0, 0.0195), rtol=1e-6)
        tell(simulated, messages.ConfigureTelemetry(100))
        simulated.advance(0.11)
        [telemetry] = tell(simulated)
        assert isinstance(telemetry, messages.Telemetry)
        assert telemetry.length == pytest.approx(length, abs=1e-4)


@pytest.mark.parametrize("gain", [2.0, 3.0, 4.0])
def test_what_it_is_told_is_what_it_pulls(gain):
    module = Module("a", [0.0, 0.0, 0.0], 0.4, 5.0, newton_per_ampere=gain, spool_radius=0.015)
    simulated = simulated_module(module, 7.0)
    tell(simulated, messages.Arm(1), messages.SetTension(1, 3.0, ttl_ms=2000))
    trace = simulated.trace(0.5)
    assert trace.tension[-400:].mean() == pytest.approx(3.0, abs=0.1)
    assert trace.current[-400:].mean() == pytest.approx(3.0 / gain, rel=0.03)


def test_an_elastic_cable_stretches_by_its_tension():
    rig = load_rig("bartels2026-validation")
    rig = replace(rig, modules=tuple(replace(module, cable_stiffness=800.0) for module in rig.modules))  # N
    world = World(rig)
    for simulated in world.modules:
        tell(simulated, messages.Arm(1), messages.SetTension(1, 4.0, ttl_ms=2000))
    world.advance(1.0)
    lengths = rig.lengths(rig.home)
    stretch = lengths - [simulated.sample.length for simulated in world.modules]
    np.testing.assert_allclose(stretch, world.tensions * lengths / 800.0, rtol=1e-3)
    assert (stretch > 3e-3).all()


def test_a_module_without_a_brake_holds_nothing():
    with_brake = Module("a", [0.0, 0.0], 0.5, 6.0, brake=100.0)
    without = Module("a", [0.0, 0.0], 0.5, 6.0)
    held = []
    for module in (with_brake, without):
        simulated = simulated_module(module, 1.0)
        tell(simulated, messages.Arm(1), messages.SetTension(1, 0.5, brake=True, ttl_ms=2000))
        simulated.advance(0.5)
        simulated.advance(0.5, 1.012)
        assert simulated.sample.state is State.RUNNING
        held.append(simulated.sample.tension)
    assert held[0] > 10.0
    assert held[1] < 1.0


@pytest.mark.parametrize(
    ("upper", "length", "more", "message"),
    [
        (200.0, 1.0, {}, "its upper limit is 200 N, and a module pulls with 12 N at most"),
        (6.0, 25.0, {}, "its cable would be 25 m long, and a module takes 20 m at most"),
        (6.0, 1.0, {"spool_radius": 0.5}, "spool_radius"),
        (6.0, 1.0, {"newton_per_ampere": 50.0}, "refused Calibrate: BAD_VALUE"),
    ],
)
def test_what_no_module_can_do_is_refused_by_name(upper, length, more, message):
    with pytest.raises(HardwareError, match=f'"winch"(:| ){{1,2}}{message}'):
        simulated_module(Module("winch", [0, 0, 0], 1.0, upper, **more), length)


def test_a_leap_becomes_a_movement_of_a_hand_and_of_bodies():
    places = np.array([[0.0, 0.0, 0.0], [0.3, -0.1, 0.0]])

    def leap(time):
        return Pose(places[int(time > 0.1)], frames={"hip": (places[int(time > 0.1)], None)})

    hand = GuidedHand(leap)
    poses = [hand(0.005 * step) for step in range(200)]
    path = np.array([pose.position for pose in poses])
    speeds = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.005
    np.testing.assert_array_equal(path[:20], 0.0)
    assert 0.9 < speeds.max() <= MAX_HAND_SPEED_M_S + 1e-9
    np.testing.assert_allclose(path[-1], places[1], atol=1e-4)
    assert (path[:, 0] <= 0.3 + 1e-3).all()
    np.testing.assert_array_equal([pose.frames["hip"][0] for pose in poses], path)


@pytest.mark.parametrize("latency", [0.0, 0.004, 0.02, 0.033])
def test_bytes_arrive_when_they_are_due_and_not_with_the_next_cycle(latency):
    """A set-point acts after the latency; its report has the age since it came, whenever the host looks."""
    world = World(load_rig("floor-3"))
    group = world.group(Conditions(latency))
    client = group.clients[0]
    client.command(messages.ConfigureTelemetry(5))
    client.arm()
    client.set_tension(0.5)
    world.advance(0.1)
    client.set_tension(2.0)
    before = world.modules[0].seconds
    while world.modules[0].sample.commanded < 0.51:
        world.advance(1e-3)
    assert world.modules[0].seconds - before == pytest.approx(latency, abs=2.5e-3)
    ages = []
    for _ in range(40):
        world.advance(7e-3)
        ages.append(group.observe()[0][3][0])
    assert min(ages) < 1e-3
    assert 3e-3 < max(ages) < 6e-3  # telemetry comes every 5 ms
