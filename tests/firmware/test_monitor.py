"""The firmware's monitor of its sensors: faults, bounds of a step, and temperatures."""

import numpy as np
import pytest

from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Fault, State
from tensionlab.hardware.protocol.messages import (
    Arm,
    Calibrate,
    ConfigureTelemetry,
    Decoder,
    EmergencyStop,
    Log,
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
                sample = {"elapsed": STEP_US, "angle": 0.0, "speed": 0.0, "current": 0.0, "thermistor": 1e4} | each
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
    assert {message.winding for message in reports} == {30}


def winding_after(core, seconds, current, *before):
    """Return the estimated temperature of a small winding, in °C, while a motor has this current."""
    steps = round(1e6 * seconds / STEP_US)
    sample = {"current": current}
    small = parameter("winding_capacity", 0.2)
    sent = core({}, small, *before, *[sample] * steps, ConfigureTelemetry(5), *[sample] * 20)[3]
    return sent[-1][0].winding


def warmed(current, seconds):
    """Return the temperature of the same winding: 3 ohm at 20 °C, 0.2 J/K, 4.6 K/W to its housing of 30 °C."""
    celsius = 30.0
    for _ in range(round(1e4 * seconds)):
        power = 1.5 * 3.0 * (1.0 + 0.00393 * (celsius - 20.0)) * current**2
        celsius += 1e-4 * (power - (celsius - 30.0) / 4.6) / 0.2
    return celsius


def test_a_winding_is_warmed_by_the_larger_of_measured_and_commanded_current(core):
    assert winding_after(core, 0.5, 0.9) == pytest.approx(warmed(0.9, 0.505), abs=0.7), "also while it is off"
    assert winding_after(core, 0.5, -0.9) == pytest.approx(warmed(0.9, 0.505), abs=0.7)
    assert winding_after(core, 0.2, 1.5, *READY) == pytest.approx(warmed(1.5, 0.205), abs=0.7)
    # Held taut with 0.17 A, of which a little more than half is measured: in 50 ohm.
    assert winding_after(core, 0.4, 0.09, parameter("winding_resistance", 50.0), *READY) == 34


def thermistor(celsius):
    """Return the resistance of one with 10 kOhm at 25 °C and a beta of 3950 K."""
    return 1e4 * np.exp(3950.0 * (1.0 / (celsius + 273.15) - 1.0 / 298.15))


@pytest.mark.parametrize("celsius", [35.0, 60.0, 95.0])
def test_a_housing_that_is_warmer_than_estimated_warms_the_winding(core, celsius):
    fast = (parameter("winding_to_housing", 0.2), parameter("winding_capacity", 0.2))
    story = [{"thermistor": thermistor(celsius)}] * 3000
    *_, sent = core({}, *fast, parameter("thermistor_resistance", 1e4), *story, ConfigureTelemetry(5), *story[:20])
    assert sent[-1][0].winding == pytest.approx(celsius, abs=0.6)
    *_, sent = core({}, *fast, *story, ConfigureTelemetry(5), *story[:20])
    assert sent[-1][0].winding == 30, "none is fitted"


@pytest.mark.parametrize(
    ("resistance", "said"),
    [
        ("inf", "thermistor: broken; goes on without it"),
        ("nan", "thermistor: broken; goes on without it"),
        (-5.0, "thermistor: broken; goes on without it"),
        (thermistor(-30.0), "thermistor: broken; goes on without it"),
        (0.0, "thermistor: shorted; goes on without it"),
        (thermistor(160.0), "thermistor: shorted; goes on without it"),
        (thermistor(-20.0), ""),
        (thermistor(140.0), ""),
    ],
)
def test_a_thermistor_that_is_broken_or_shorted_for_50_ms_is_reported_once(core, resistance, said):
    fitted, bad = parameter("thermistor_resistance", 1e4), {"thermistor": resistance}
    story = ({}, fitted, *[{}] * 300, *[bad] * 199, {}, *[bad] * 700)
    *_, sent = core(*story)
    lines = [
        (index, message.text) for index, step in enumerate(sent) for message in step if isinstance(message, Log)
    ]
    assert lines == ([(700, said)] if said else [])


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
    _, _, state, _ = core(*story, Arm(78, 1), *[{"current": TAUT_A}] * 2100)
    assert (state[-2100:-100] == State.ARMED).all()
    assert state[-100] == State.TIMEOUT


def test_two_seconds_after_the_timeout_to_the_step_the_cable_is_released(core):
    _, current, state, _ = core({}, *READY, *[{"current": TAUT_A}] * 10_000)
    begin = int(np.argmax(state == State.TIMEOUT))
    assert current[begin : begin + 8000] == pytest.approx(TAUT_A)
    assert current[begin + 8000] < TAUT_A - 1e-4
