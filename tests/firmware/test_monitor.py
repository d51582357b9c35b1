"""The firmware's monitor of its sensors: faults, bounds of a step, and the winding's temperature."""

import numpy as np
import pytest

from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Fault, State
from tensionlab.hardware.protocol.messages import (
    Arm,
    Calibrate,
    ConfigureTelemetry,
    Decoder,
    EmergencyStop,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
    read,
)
from tests.helpers.compiled import FIRMWARE, compile_program, run_program

USUAL = {
    "elapsed": 250, "angle": 10.0, "speed": 0.0, "current": 0.7, "induced": 0.0, "across": 0.0, "supply": 12.0,
    "ok": 1, "commanded": 0.7,
}  # fmt: skip
RADIUS, SPEED_LIMIT, PEAK = 0.0195, 1.5, 2.2  # as a module has them at first


@pytest.fixture(scope="module")
def monitor(tmp_path_factory):
    """Return a function: faults, seconds and length after each sample, given by its unusual values."""
    program = compile_program("monitor", tmp_path_factory.mktemp("monitor"))

    def watch(*samples):
        lines = [" ".join(str((USUAL | sample)[name]) for name in USUAL) for sample in ({"elapsed": 0}, *samples)]
        rows = run_program(program, content="\n".join(lines))
        return [(Fault(int(word)), float(seconds), float(length)) for word, seconds, length in rows][1:]

    return watch


@pytest.mark.parametrize(
    ("unusual", "enough", "fault"),
    [
        ({"ok": 0}, 4, Fault.ENCODER),
        ({"angle": "nan"}, 4, Fault.ENCODER),
        ({"speed": "inf"}, 4, Fault.ENCODER),
        ({"speed": -1.01 * 1.4 * SPEED_LIMIT / RADIUS}, 4, Fault.SPEED),
        ({"speed": 1.01 * 2.25 * SPEED_LIMIT / RADIUS}, 400, Fault.SPEED),
        ({"current": "nan"}, 4, Fault.CURRENT),
        ({"induced": "nan"}, 4, Fault.CURRENT),
        ({"across": "inf"}, 4, Fault.CURRENT),
        ({"current": 1.51 * PEAK}, 4, Fault.CURRENT),
        ({"current": -1.51 * PEAK}, 4, Fault.CURRENT),
        ({"supply": 7.9}, 40, Fault.SUPPLY),
        ({"supply": 16.1}, 40, Fault.SUPPLY),
        ({"supply": "nan"}, 40, Fault.SUPPLY),
        ({"current": 0.34}, 200, Fault.CURRENT),  # less than half of what was commanded: a wire is off
    ],
)
def test_what_is_wrong_for_a_while_is_a_fault_until_it_has_been_right_for_ten_times_as_long(
    monitor, unusual, enough, fault
):
    reports = [found for found, _, _ in monitor(*[unusual] * enough, *[{}] * (10 * enough))]
    right = 10 * enough
    assert reports == [Fault(0)] * (enough - 1) + [fault] * right + [Fault(0)]


@pytest.mark.parametrize(
    "usual",
    [
        {"speed": 2.0 * SPEED_LIMIT / RADIUS},  # a hand pulls the cable out
        {"speed": -0.99 * 1.4 * SPEED_LIMIT / RADIUS, "current": 0.0},  # the supply does not suffice
        {"current": 1.49 * PEAK},
        {"current": -1.49 * PEAK, "commanded": 0.0},
        {"current": 0.36},
        {"current": 0.0, "commanded": 0.1},
        {"supply": 8.0},
        {"supply": 16.0},
    ],
)
def test_what_may_last_is_no_fault(monitor, usual):
    assert {found for found, _, _ in monitor(*[usual] * 1000)} == {Fault(0)}


def test_what_the_encoder_cannot_have_seen_moves_nothing(monitor):
    reports = monitor(
        {"angle": 20.0}, {"angle": "nan"}, {"angle": 30.0, "speed": "inf"}, {"angle": 40.0, "ok": 0}, {}
    )
    assert [length for _, _, length in reports] == pytest.approx([20.0 * RADIUS] * 4 + [10.0 * RADIUS])


@pytest.mark.parametrize(
    ("elapsed", "fault", "seconds"),
    [
        (250, 0, 250e-6),
        (5000, 0, 5e-3),
        (5001, Fault.LOOP, 5e-3),
        (10**9, Fault.LOOP, 5e-3),
        (-1, Fault.LOOP, 0.0),
    ],
)
def test_a_step_that_comes_too_late_or_before_the_last_one_is_a_fault_and_moves_little(
    monitor, elapsed, fault, seconds
):
    reports = monitor({}, {"elapsed": elapsed}, {})
    assert [found for found, _, _ in reports] == [Fault(0), Fault(fault), Fault(0)]
    assert reports[1][1] == pytest.approx(seconds)


def test_the_rest_of_a_windings_budget_may_be_spent_within_a_tenth_of_its_time(tmp_path):
    """It bears 1 A continuously, 2.2 A at most, and warms with 20 s: at 2 A its budget is spent after 5.8 s."""
    allowed, spent = np.array(run_program(compile_program("thermal", tmp_path), 2.0, 1200), dtype=float).T
    warmth = 4.0 * (1.0 - (1.0 - 0.01 / 20.0) ** np.arange(1, 1201))
    np.testing.assert_allclose(spent, np.minimum(warmth, 1.0), atol=1e-4)
    rest = np.maximum(1.0 - warmth, 0.0)
    np.testing.assert_allclose(allowed, np.minimum(np.sqrt(1.0 + 10.0 * rest), PEAK), atol=1e-3)
    assert allowed[0] == pytest.approx(PEAK)
    assert allowed[-1] == 1.0


# The core step by step, with made-up samples

STEP_US, TAUT_A = 250, np.float32(0.5) / np.float32(3.0)
READY = (Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0), Arm(77))


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """Return a function: the core's outputs after each step of a story of commands and samples."""
    program = compile_program("module", tmp_path_factory.mktemp("module"), *FIRMWARE.glob("core/*.cpp"))

    def play(*story):
        lines, sequence = [], 0
        for each in story:
            if isinstance(each, dict):
                sample = {"elapsed": STEP_US, "angle": 0.0, "speed": 0.0, "current": 0.0} | each
                lines.append("step " + " ".join(str(value) for value in sample.values()))
            else:
                sequence += 1
                lines.append("receive " + each.frame(sequence).pack().hex())
        rows = run_program(program, content="\n".join(lines))
        on, current, state = (np.array([float(row[column]) for row in rows]) for column in range(3))
        decoder = Decoder()
        sent = [[read(frame) for frame in decoder.feed(bytes.fromhex(row[3][1:]))] for row in rows]
        return on != 0.0, current, state, sent

    return play


def parameter(name, value):
    return SetParameter(PARAMETERS[name].index, value)


@pytest.mark.parametrize("off", [(), (*READY, {}, Stop(), *[{}] * 100), (*READY, {}, EmergencyStop())])
def test_while_the_driver_is_off_the_motor_gets_no_current_however_the_spool_turns(core, off):
    """Friction is compensated, and a spool that runs down reels in: that is no reason to pull, nor warms it."""
    turning = [{"speed": -5.0}] * 300
    on, current, _, sent = core(
        {}, parameter("friction_coulomb", 2.0), *off, ConfigureTelemetry(20), *turning, *[{"speed": -100.0}] * 80
    )
    assert not on[-380:].any()
    assert not current[-380:].any()
    reports = [message for step in sent[-380:] for message in step if isinstance(message, Telemetry)]
    assert {message.faults for message in reports} == {Fault(0)}, "as if a wire were off"
    assert reports[-1].thermal == pytest.approx(reports[0].thermal, rel=2e-3)


def thermal_after(core, seconds, current, *before):
    """Return the share of the budget that is spent while a motor has this current."""
    steps = round(1e6 * seconds / STEP_US)
    sample = {"current": current}
    sent = core({}, *before, *[sample] * steps, ConfigureTelemetry(5), *[sample] * 20)[3]
    return sent[-1][0].thermal


def spent(current, seconds):
    """Return the share that a current spends: the winding bears 1 A continuously, and warms with 20 s."""
    return current**2 * (1.0 - np.exp(-seconds / 20.0))


def test_a_winding_is_warmed_by_the_larger_of_measured_and_commanded_current(core):
    assert thermal_after(core, 0.5, 0.9) == pytest.approx(spent(0.9, 0.505), rel=1e-3), "also while it is off"
    assert thermal_after(core, 0.5, -0.9) == pytest.approx(spent(0.9, 0.505), rel=1e-3)
    assert thermal_after(core, 0.2, 0.9, *READY) == pytest.approx(spent(0.9, 0.205), rel=1e-3)
    assert thermal_after(core, 0.04, -0.9, *READY) == pytest.approx(spent(0.9, 0.045), rel=5e-3), "either way"
    assert thermal_after(core, 0.2, 0.09, *READY) == pytest.approx(spent(TAUT_A, 0.205), rel=0.06)


def test_the_first_step_that_is_too_late_is_the_one_after_the_end_of_a_set_points_life(core):
    """It lives as long as it says, and one step more: at its very end it still counts."""
    story = [{}, *READY, {}, SetTension(77, 1.0, False, 100), *[{"current": 0.3}] * 1000]
    _, _, state, _ = core(*story)
    begin = 2  # the first step after the set-point
    assert (state[begin : begin + 400] == State.RUNNING).all()
    assert state[begin + 400] == State.TIMEOUT


def test_what_arms_a_module_lets_it_live_as_long_as_its_own_parameter_says(core):
    """However long set-points of the session before lived."""
    story = [{}, parameter("ttl", 500.0), *READY, {}, SetTension(77, 1.0, False, 2000), {}, Stop(), *[{}] * 200]
    _, _, state, _ = core(*story, Arm(78), *[{"current": TAUT_A}] * 2100)
    assert (state[-2100:-100] == State.ARMED).all()
    assert state[-100] == State.TIMEOUT


def test_two_seconds_after_the_timeout_to_the_step_the_cable_is_released(core):
    _, current, state, _ = core({}, *READY, *[{"current": TAUT_A}] * 10_000)
    begin = int(np.argmax(state == State.TIMEOUT))
    assert current[begin : begin + 8000] == pytest.approx(TAUT_A)
    assert current[begin + 8000] < TAUT_A - 1e-4
