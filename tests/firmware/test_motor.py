"""The firmware on a simulated gimbal motor: which faults it notices, and that normal use is no fault."""

from itertools import repeat

import numpy as np
import pytest

from tensionlab.hardware.protocol.codes import Fault, State
from tensionlab.hardware.simulation.simulated_module import DRIVER_ON
from tests.helpers.modules import Host

SOON = 0.06  # s: within this, a fault is noticed and the driver is off
MOTORS = [
    {"supply": supply, "resistance": resistance, "inductance": inductance}
    for supply in (12.0, 15.0)
    for resistance in (2.8, 3.6)
    for inductance in (0.5e-3, 2e-3)
]
each_motor = pytest.mark.parametrize("motor", MOTORS, ids=lambda motor: "-".join(map(str, motor.values())))


def armed(motor, **parameters) -> Host:
    host = Host(plant=motor)
    host.calibrate(length=1.0)
    host.set(**parameters)
    host.arm()
    return host


def play(host: Host, tension, seconds: float, path=None) -> float:
    """Repeat a set-point at 50 Hz while the far end follows a path; the time until the driver is off, in s."""
    begin, count = host.module.seconds, round(1e3 * seconds)
    places = repeat(None, count) if path is None else path(1e-3 * np.arange(1, count + 1)).tolist()
    for step, place in enumerate(places):
        if step % 20 == 0 and host.state in (State.ARMED, State.RUNNING):
            host.pull(tension(1e-3 * step) if callable(tension) else tension)
            host.hear()
        if not host.module.samples(1e-3, place)[-1, DRIVER_ON]:
            break
    return host.module.seconds - begin


def cut(motor, tension):
    """The time until a module that pulls has noticed that its cable is cut, and the cable it has reeled in."""
    host = armed(motor)
    host.hold(tension, 0.5)
    host.pull(tension)
    host.module.damage("cable")
    before = host.module.sample.length
    return play(host, tension, 1.0), before - host.module.sample.length, host.module.faults


@each_motor
@pytest.mark.parametrize("tension", [1.5, 2.0, 3.0, 6.0])
def test_a_cable_that_is_cut_is_noticed(motor, tension):
    seconds, _, faults = cut(motor, tension)
    assert (seconds < SOON, faults) == (True, Fault.SPEED)


@each_motor
@pytest.mark.parametrize(("tension", "soon"), [(0.5, 0.7), (1.0, 0.62)])
def test_at_a_low_tension_a_cut_is_noticed_when_no_hand_gives_so_much_slack(motor, tension, soon):
    """Until then it is like a hand that is faster than the spool, and the speed limit holds."""
    seconds, way, faults = cut(motor, tension)
    assert (seconds < soon, faults) == (True, Fault.CABLE)
    assert way < 1.9 * seconds


@each_motor
@pytest.mark.parametrize(
    ("degrees", "direction", "tension", "fault"),
    [(degrees, 1.0, tension, Fault.MOTOR) for degrees in (120, 180, -120) for tension in (0.5, 3.0, 6.0)]
    + [(0, -1.0, tension, Fault.SPEED) for tension in (3.0, 6.0)],
)
def test_a_motor_that_pushes_is_noticed(motor, degrees, direction, tension, fault):
    host = armed(motor | {"zero_error": np.radians(degrees)}, motor_direction=direction)
    assert play(host, tension, 0.2) < SOON
    assert host.module.faults == fault


@each_motor
@pytest.mark.parametrize("degrees", [60, -60])
@pytest.mark.parametrize(("tension", "speed"), [(0.5, 0.5), (2.0, 1.0)])
def test_a_zero_that_takes_half_of_the_tension_is_noticed_as_soon_as_the_cable_is_pulled(
    motor, degrees, tension, speed
):
    host = armed(motor | {"zero_error": np.radians(degrees)})
    host.hold(tension, 0.3)
    assert host.state == State.RUNNING, "at rest, nothing tells"
    assert play(host, tension, 0.2, lambda seconds: 1.0 + speed * seconds) < SOON
    assert host.module.faults == Fault.MOTOR


@each_motor
def test_at_the_minimum_tension_a_reversed_motor_is_noticed_when_it_takes_up_too_much(motor):
    """Nothing tells it from a module that takes up slack."""
    host = armed(motor, motor_direction=-1.0, length_upper=1.5)
    before = host.module.sample.length
    seconds = play(host, 0.5, 2.0)
    assert host.module.sample.length - before < 2.2
    assert seconds > 0.8, "at the speed limit, no faster"
    assert host.module.faults == Fault.CABLE


def smooth(share):
    """A hand's way from 0 to 1, with the least jerk."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def pull_out(seconds):
    """A hand that gains 3 m/s in 60 ms, and stops as fast after 3 m."""
    gained = np.clip(seconds - 0.05, 0.0, 1.06)
    steady = 3.0 * gained - 0.09 * (1.0 - (1.0 - np.clip(gained / 0.06, 0.0, 1.0)) ** 2)
    stopping = np.clip(gained - 1.0, 0.0, 0.06)
    return 1.0 + steady - 3.0 * stopping**2 / 0.12


def jerks(seconds):
    """0.1 m out in 0.1 s, and back in 0.25 s."""
    since = seconds % 0.7
    return 1.0 + 0.1 * smooth(since / 0.1) * (1.0 - smooth((since - 0.25) / 0.25))


def reach(seconds):
    """0.5 m towards the module in 0.5 s."""
    return 1.0 - 0.5 * smooth((seconds - 0.1) / 0.5)


def flick(seconds):
    """0.2 m towards the module from rest, with up to 30 m/s^2 and 1.9 m/s."""
    return 1.0 - 0.2 * smooth((seconds - 0.1) / 0.196)


def shake(seconds):
    """0.2 m to and fro, three times a second: faster than the minimum tension can follow."""
    return 1.0 + 0.1 * np.sin(6.0 * np.pi * seconds) * np.minimum(seconds, 1.0)


@each_motor
@pytest.mark.parametrize("tension", [0.5, 1.0, 3.0, 6.0])
@pytest.mark.parametrize("path", [pull_out, jerks, reach, flick, shake], ids=lambda path: path.__name__)
def test_what_a_hand_does_is_no_fault(motor, tension, path):
    host = armed(motor)
    host.hold(0.5, 0.3)
    play(host, tension, 3.0, path)
    assert (host.state, host.module.faults) == (State.RUNNING, Fault(0))


@each_motor
@pytest.mark.parametrize(
    ("tension", "fastest", "speed_limit"), [(0.5, 3.0, 1.5), (1.0, 5.0, 1.5), (3.0, 3.0, 2.2), (6.0, 3.0, 2.2)]
)
@pytest.mark.parametrize("way", [0.3, 0.7])
def test_a_hand_that_outruns_the_spool_from_rest_is_no_fault(motor, tension, fastest, speed_limit, way):
    """Where the spool keeps up with the hand, its speed limit has to fit the hand."""
    host = armed(motor, speed_limit=speed_limit)
    host.hold(0.5, 0.3)
    play(host, tension, 1.5, lambda seconds: 1.0 - way * smooth((seconds - 0.1) * fastest / (1.875 * way)))
    assert (host.state, host.module.faults) == (State.RUNNING, Fault(0))


@each_motor
@pytest.mark.parametrize("tension", [3.0, 6.0])
def test_steps_of_tension_are_no_fault(motor, tension):
    host = armed(motor)
    play(host, lambda seconds: tension if int(5.0 * seconds) % 2 else 0.5, 5.0)
    assert (host.state, host.module.faults) == (State.RUNNING, Fault(0))


@each_motor
def test_a_slack_cable_is_taken_up_at_the_speed_limit_without_a_fault(motor):
    host = armed(motor)
    host.pull(0.5)
    host.module.advance(2.5e-4, 0.1)  # 0.9 m of slack
    before, speeds = host.module.sample.length, []
    for _ in range(60):
        play(host, 0.5, 0.02, lambda seconds: np.full(seconds.shape, 0.1))
        length = host.module.sample.length
        speeds.append((before - length) / 0.02)
        before = length
    assert (host.state, host.module.faults) == (State.RUNNING, Fault(0))
    assert 1.5 < max(speeds) < 1.9, "at the limit, and no faster than where it pulls no more"
    assert host.module.sample.tension == pytest.approx(0.5, abs=0.12)


def test_without_load_the_motor_turns_as_fast_as_its_voltage_allows():
    """12 V over the square root of 3, and 2 V for each m/s: two thirds of 3 N/A."""
    host = armed({}, speed_limit=10.0)
    host.module.advance(2.5e-4, 0.01)
    host.pull(6.0, ttl_ms=500)
    trace = host.module.trace(0.15)
    assert np.diff(trace.length).min() / -2.5e-4 == pytest.approx(3.35, abs=0.12)
