"""The firmware on the simulated hardware: the tension of the cable."""

import numpy as np
import pytest

from tensionlab.hardware.protocol.codes import BrakeState, Code, Limit, ResetReason, State
from tensionlab.hardware.protocol.messages import Clear, ConfigureTelemetry, EmergencyStop, Save, Stop
from tensionlab.hardware.simulation.simulated_module import STEP_S, HangingMass, Trace
from tests.helpers.modules import Host, armed

HOLD = 186.0  # N, published: what the brake holds


def joined(traces: list[Trace]) -> Trace:
    return np.concatenate(traces).view(np.recarray)


def scale(host: Host, tension: float, speed: float) -> float:
    """Return the force on a scale that draws the cable out, or follows it in, at constant speed."""
    start = host.module.sample.distance
    trace = joined(host.hold(tension, 0.4, distance=start + 0.4 * speed))
    return trace.tension[len(trace.tension) // 2 :].mean()  # it swings at first


def calibrate_with_scale(host: Host) -> None:
    """Calibrate N/A and friction from forces at some currents and speeds, by least squares, as on a bench."""
    rows, forces = [], []
    host.arm()
    for tension in (1.5, 3.0):
        for speed in (0.05, -0.05, 0.3, -0.3):
            forces.append(scale(host, tension, speed))
            rows.append([tension / 3.0, np.sign(speed), speed])  # the module asks for tension / 3 A
    newton_per_ampere, coulomb, viscous = np.linalg.lstsq(np.array(rows), np.array(forces), rcond=None)[0]
    host.module.close_link()
    host.session += 1
    host.say(Stop())
    host.module.advance(0.2)
    host.calibrate(newton_per_ampere)
    host.set(friction_coulomb=max(coulomb, 0.0), friction_viscous=max(viscous, 0.0))


MOTORS = [
    {},
    {"torque_constant": 0.045},  # KV 185
    {"radius": 0.023, "dry_friction": 0.15, "viscous_friction": 0.3},
    {"torque_constant": 0.065, "radius": 0.016, "inertia": 2e-5, "cogging": 0.05},
]


@pytest.mark.parametrize("plant", MOTORS)
@pytest.mark.parametrize("tension", [1.5, 3.0, 4.0])
@pytest.mark.parametrize("speed", [-0.25, -0.1, 0.1, 0.25])
def test_calibrated_tension_is_within_3_per_cent(plant, tension, speed):
    host = Host(plant=plant)
    host.calibrate()
    calibrate_with_scale(host)
    host.arm()
    host.hold(tension, 0.1)
    assert scale(host, tension, speed) == pytest.approx(tension, rel=0.03)


def test_a_step_from_the_minimum_tension_to_3_newton_settles_in_50_ms():
    host = armed()
    host.hold(0.5, 0.3)
    host.pull(3.0)
    trace = host.module.trace(0.24)
    after = np.arange(1, len(trace.tension) + 1) * STEP_S
    assert np.abs(trace.tension[after > 0.05] / 3.0 - 1.0).max() < 0.05
    assert trace.tension[after < 0.01].max() < 1.5, "and not faster than the slew"


def test_6_newton_are_pulled_for_a_while_and_3_continuously():
    """The motor has a tenth of its heat capacity here, and so has the estimate: minutes become seconds."""
    small = {"winding_capacity": 1.0, "housing_capacity": 3.0}
    host = armed(parameters=small, plant={name: 1.2 * value for name, value in small.items()})
    trace = joined(host.hold(6.0, 60.0))
    assert (trace.commanded >= 5.999)[round(0.2 / STEP_S)]
    derated = trace.commanded[-round(5.0 / STEP_S) :]
    assert derated.max() < 3.3
    assert derated.min() > 2.9
    assert trace.limit[-1] == Limit.THERMAL
    # It sinks smoothly, and neither the winding nor its estimate passes the limit.
    assert np.diff(trace.commanded[round(0.2 / STEP_S) :]).min() > -0.02
    assert 95.0 < trace.estimated_winding.max() <= 100.2
    assert (trace.winding <= trace.estimated_winding).all()
    assert trace.winding.max() > 75.0
    # Rested, it has some of its strength back.
    host.hold(0.5, 30.0)
    assert joined(host.hold(6.0, 0.3)).commanded[-1] == pytest.approx(6.0)


def test_after_a_reset_of_its_own_a_module_takes_its_winding_for_hot():
    trace = joined(armed(reset_reason=ResetReason.WATCHDOG).hold(6.0, 1.0))
    assert trace.commanded.max() < 3.7


# The brake


def braked(force: float) -> Host:
    """Return a host whose cable is drawn out against the brake (there is a tooth at 1 m) up to this tension."""
    host = armed()
    host.hold(0.5, 0.3, brake=True)
    host.hold(0.5, 0.5, distance=1.0 + force / 4000.0, brake=True)
    return host


def test_the_brake_holds_186_newton_while_the_motor_gives_half_a_newton():
    host = braked(0.0)
    start = host.module.sample.distance
    held = joined(host.hold(0.5, 1.0, distance=start + (HOLD - 2.0) / 4000.0, brake=True))
    assert held.tension.max() == pytest.approx(HOLD - 2.0, abs=1.0)
    assert np.ptp(held.length[held.tension > 2.0]) < 1e-4, "not a tenth of a mm pays out"
    np.testing.assert_allclose(held.commanded, 0.5)
    assert held.current.max() < 0.25
    host.pull(0.5, brake=True)
    beyond = host.module.trace(0.2, host.module.sample.distance + 4.0 / 4000.0)
    assert beyond.tension.max() < HOLD + 3.0
    assert beyond.length[-1] > held.length[-1] + 0.0029, "beyond, the pawl slips to the next tooth"


def test_a_braked_cable_reels_in_at_once():
    host = braked(50.0)
    before = host.module.sample
    assert before.brake_force == pytest.approx(before.tension, abs=0.6)
    assert before.tension > 40.0
    trace = joined(host.hold(0.5, 0.4, distance=before.distance - 0.1, brake=True))
    assert trace.pawl_down.all()
    slack = trace.distance - trace.length
    assert slack.min() > -3e-3, "hardly slack while the hand follows at 0.25 m/s"
    assert trace.tension[800:].min() > 0.1
    assert trace.tension[800:].max() < 1.0
    # And it holds again at the next tooth.
    out = joined(host.hold(0.5, 0.4, distance=before.distance - 0.08, brake=True))
    assert out.length[-1] - trace.length[-1] < 0.003 + 1e-6
    assert out.tension[-1] > 40.0


def test_a_loaded_brake_is_released_by_reeling_in():
    host = braked(1.5)
    loaded = host.module.sample
    assert loaded.brake_force == pytest.approx(1.0, abs=0.1), "too much for the servo to lift the pawl"
    host.code(ConfigureTelemetry(5))
    seen, traces = set(), []
    for _ in range(40):
        host.pull(0.5)
        traces.append(host.module.trace(0.02))
        seen |= {(report.brake, report.limit) for report in host.hear()}
    trace = joined(traces)
    assert {(BrakeState.RELEASING, Limit.RELEASING), (BrakeState.OPENING, Limit.RELEASING)} <= seen
    assert trace.commanded.max() == pytest.approx(2.0), "the release tension"
    assert trace.commanded[-1] == 0.5
    assert not trace.pawl_down[-1]
    pulled = joined(host.hold(0.5, 0.5, distance=loaded.distance + 0.05))
    assert pulled.tension.max() < 2.0, "and it is free"


def test_a_module_that_is_to_pull_more_than_the_release_tension_does_so_while_it_releases():
    host = braked(1.5)
    trace = joined(host.hold(4.0, 0.3))
    assert trace.commanded.max() == pytest.approx(4.0)
    assert Limit.RELEASING not in trace.limit


def test_a_brake_under_more_load_than_the_motor_can_take_opens_when_the_load_is_gone():
    host = braked(50.0)
    host.hold(0.5, 1.0)
    assert host.module.sample.pawl_down, "jammed"
    host.hold(0.5, 0.5, distance=0.99)
    assert not host.module.sample.pawl_down


@pytest.mark.parametrize("dwell", [0.1, 0.6])
def test_the_brake_keeps_its_dwell_however_fast_it_is_asked(dwell):
    host = armed(parameters={"brake_dwell": 1000.0 * dwell})
    host.hold(0.5, 0.2)
    flips = []
    for step in range(500):
        host.pull(0.5, brake=step % 2 == 0)
        flips.append(host.module.trace(0.01))
    down = joined(flips).pawl_down
    changes = np.flatnonzero(np.diff(down)) * STEP_S
    assert len(changes) > 3
    assert np.diff(changes).min() > 0.9 * dwell


def test_a_brake_that_has_rested_for_half_a_clock_is_ready():
    host = armed()
    host.hold(0.5, 0.4, brake=True)
    host.hold(0.5, 0.6)
    host.code(Stop())
    host.module.advance(2200.0)  # 2^31 us and some
    host.session += 1
    host.arm()
    assert joined(host.hold(0.5, 0.4, brake=True)).pawl_down[-1]


def test_a_spring_that_wants_more_than_the_limit_gets_the_limit():
    host = armed(distance=1.0)
    host.render(rest=0.9, stiffness=500.0, ttl_ms=1000)
    trace = host.module.trace(0.4)
    assert trace.commanded.max() == pytest.approx(6.0)
    assert trace.limit[-1] == Limit.UPPER


@pytest.mark.parametrize(("keep", "brake"), [(0.0, True), (1.0, True), (1.0, False)])
def test_a_timeout_lifts_the_brake_unless_it_is_to_be_kept_and_closes_none(keep, brake):
    host = armed(parameters={"timeout_brake": keep})
    host.hold(0.5, 0.4, brake=brake)
    trace = host.module.trace(6.0)
    assert host.state == State.TIMEOUT
    assert trace.pawl_down[-1] == bool(keep and brake)
    assert brake or not trace.pawl_down.any()
    assert not trace.driver_on[-1]


def lifting() -> Host:
    """Return a host whose module has lifted 0.2 kg off the floor, with the brake that closes at a fault."""
    host = Host()
    host.module = HangingMass(0.2)
    host.set(brake_on_fault=1.0)
    host.calibrate(length=1.0)
    host.arm()
    play(host, 3.0, 0.3)
    play(host, 1.96, 0.05)
    assert host.module.sample.distance < 0.9
    return host


def play(host: Host, tension: float, seconds: float, *, brake: bool = False) -> None:
    """Repeat a set-point at 50 Hz, while the load moves by itself."""
    for _ in range(round(seconds / 0.01)):
        host.pull(tension, brake=brake)
        host.module.advance(0.01)


def fail(host: Host, failure: str) -> None:
    """Let a module fail by a part that breaks, a loop that hangs, or an emergency stop."""
    if failure == "loop":
        host.module.pause(0.006)
    elif failure == "estop":
        host.say(EmergencyStop())
    else:
        host.module.damage(failure)


FAILURES = ("encoder", "supply", "loop", "estop")


@pytest.mark.parametrize("failure", FAILURES)
@pytest.mark.parametrize(
    ("releasing", "braked", "most"),
    [(0.0, 0.6, 0.004), (0.1, 0.6, 0.004), (0.0, 0.0, 0.03), (0.32, 0.6, 0.2)],
    ids=["brake closed", "brake being released", "brake open", "brake being opened"],
)
def test_a_brake_for_loads_lets_no_load_drop_at_a_fault(releasing, braked, most, failure):
    """But by a tooth of 3 mm, and by what falls until the servo is through and the dwell over."""
    host = lifting()
    play(host, 1.0, braked, brake=True)
    play(host, 1.0, releasing)
    start = host.module.sample.distance
    fail(host, failure)
    sunk = []
    for _ in range(200):
        host.module.advance(0.01)
        sunk.append(host.module.sample.distance - start)
    assert host.state in (State.FAULT, State.ESTOP)
    assert max(sunk) < most
    assert host.module.sample.pawl_down


@pytest.mark.parametrize("reason", [ResetReason.WATCHDOG, ResetReason.POWER])
def test_a_brake_for_loads_is_closed_after_each_start_until_the_module_pulls(reason):
    before = Host()
    before.set(brake_on_fault=1.0)
    before.calibrate()
    assert before.say(Save()) == []
    before.module.advance(0.01)
    host = Host(reset_reason=reason, settings=before.module.settings)
    host.module.advance(1.0)
    assert (host.state, host.module.sample.pawl_down) == (State.IDLE, True)
    host.arm()
    host.hold(1.0, 1.0)
    assert not host.module.sample.pawl_down


def test_a_brake_for_loads_stays_closed_until_a_module_that_pulls_releases_it():
    host = lifting()
    host.say(EmergencyStop())
    host.module.advance(1.0)
    held = host.module.sample.distance
    assert host.code(Clear()) == Code.OK
    host.module.advance(1.0)
    assert host.module.sample.distance == pytest.approx(held, abs=1e-3)
    host.session += 1
    host.arm()
    play(host, 2.5, 0.3)
    assert not host.module.sample.pawl_down
    assert host.module.sample.distance < held


@pytest.mark.parametrize("failure", FAILURES)
def test_a_brake_for_people_sets_the_hand_free_at_a_fault(failure):
    host = braked(0.0)
    fail(host, failure)
    host.module.advance(0.1)
    trace = host.module.trace(0.5, host.module.sample.distance + 0.2)
    assert host.state in (State.FAULT, State.ESTOP)
    assert not trace.pawl_down.any()
    assert trace.tension.mean() < 0.2  # in jerks of the spool that it takes along


# What a module renders by itself


@pytest.mark.parametrize("stiffness", [20.0, 100.0, 300.0])
def test_a_spring_is_rendered_by_the_module_itself(stiffness):
    host = armed(distance=1.0)
    span = 4.0 / stiffness
    for stretch in (0.25, 0.5, 1.0, 0.75):
        host.render(rest=1.0 - 0.5 / stiffness, stiffness=stiffness, ttl_ms=2000)
        host.module.advance(0.3, 1.0 + span * stretch)
        trace = host.module.trace(0.5)
        expected = 0.5 + stiffness * (trace.length.mean() - 1.0)
        assert trace.commanded.mean() == pytest.approx(expected, rel=0.02)
        assert trace.tension[1000:].mean() == pytest.approx(expected, abs=0.09), "but for friction and cogging"
        assert np.std(trace.tension[1000:]) < 0.05, "and it is calm"


def test_a_damper_pulls_only_while_the_cable_pays_out():
    host = armed()
    host.render(feed_forward=1.0, damping=5.0, ttl_ms=2000)
    out = host.module.trace(0.4, 1.12)
    assert out.commanded[400:].mean() == pytest.approx(1.0 + 5.0 * 0.3, rel=0.05)
    host.render(feed_forward=1.0, damping=5.0, ttl_ms=2000)
    back = host.module.trace(0.4, 1.0)
    assert back.commanded[400:] == pytest.approx(1.0)


def test_a_vibration_has_its_frequency_and_amplitude():
    host = armed()
    host.render(feed_forward=2.0, amplitude=0.1, frequency=50.0, ttl_ms=2000)
    host.module.advance(0.2)
    trace = host.module.trace(1.0)
    spectrum = np.abs(np.fft.rfft(trace.commanded - trace.commanded.mean())) / len(trace.commanded) * 2.0
    assert spectrum.argmax() == 50
    assert spectrum.max() == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("start", [0.0, 61.7, 4200.0])  # the clock wraps around at 4295 s
@pytest.mark.parametrize(("frequency", "phase"), [(50.0, 0.25), (33.3, 0.0), (0.5, 0.8)])
def test_a_vibration_has_its_phase_by_the_modules_clock_whenever_set_points_come(start, frequency, phase):
    host = armed(start_us=round(1e6 * start))
    for wait in (0.017, 0.031, 1.3):
        host.render(feed_forward=2.0, amplitude=0.1, frequency=frequency, phase=phase, ttl_ms=2000)
        host.module.advance(wait)
        before = host.module.seconds
        trace = host.module.trace(0.01)
        turns = float(np.float32(frequency)) * (start + before + 2.5e-4 * np.arange(1, len(trace) + 1)) + phase
        expected = 2.0 + 0.1 * np.sin(2.0 * np.pi * turns)
        if host.module.seconds > 0.1:  # there, by the slew-rate limit
            np.testing.assert_allclose(trace.commanded, expected, atol=0.01)


# Other limits


def test_reeling_in_too_fast_the_tension_gives_way():
    host = armed(parameters={"speed_limit": 0.5})
    host.hold(3.0, 0.2)
    slow, fast = joined(host.hold(3.0, 0.5, distance=0.8)), joined(host.hold(3.0, 0.4, distance=0.56))
    assert slow.commanded[-1] == pytest.approx(3.0)
    assert fast.commanded[-1] < 2.8
    assert fast.limit[-1] == Limit.SPEED


@pytest.mark.parametrize("distance", [0.87, 1.13])
def test_outside_the_allowed_length_only_the_minimum_tension_remains(distance):
    host = armed(parameters={"length_lower": 0.9, "length_upper": 1.1}, distance=1.0)
    trace = joined(host.hold(2.0, 0.5, distance=distance) + host.hold(2.0, 0.2))
    assert trace.commanded[-1] == 0.5
    assert trace.limit[-1] == Limit.LENGTH
    assert host.state == State.RUNNING


def test_friction_is_compensated_but_never_beyond_what_the_winding_bears():
    plant = {"dry_friction": 2.0, "viscous_friction": 5.0}
    parameters = {"friction_coulomb": 2.0, "friction_viscous": 5.0}
    # After this reset it has only its continuous current.
    host = armed(parameters=parameters, plant=plant, reset_reason=ResetReason.WATCHDOG)
    trace = joined(host.hold(3.0, 0.3) + host.hold(3.0, 0.4, distance=0.8))
    assert 0.99 < trace.current.max() < 1.15
