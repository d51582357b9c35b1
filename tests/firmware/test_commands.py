"""Commands to the firmware: which it obeys, and which it refuses."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Code, Fault, Limit, State, Type
from tensionlab.hardware.protocol.messages import (
    DELIMITER,
    Acknowledge,
    Arm,
    Calibrate,
    Clear,
    ConfigureTelemetry,
    EmergencyStop,
    Event,
    GetParameter,
    Hello,
    ParameterValue,
    Ping,
    Pong,
    Save,
    SetImpedance,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
    WireFrame,
)
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule
from tests.helpers.modules import SESSION, Host, host_in

NO_NUMBERS = (math.nan, math.inf, -math.inf)
PLAIN = {"rest": 0.0, "stiffness": 0.0, "damping": 0.0, "feed_forward": 1.0}
UPPER = PARAMETERS["length_upper"].default


def raw(host: Host, kind: Type, layout: str, *values) -> Code:
    """Return the answer to a payload that the host's own classes would not send."""
    host.sequence += 1
    host.module.receive(WireFrame(kind, host.sequence, struct.pack("<" + layout, *values)).pack())
    (answer,) = host.hear()
    return answer.code


# Sessions and sequence numbers


def test_a_module_is_armed_only_when_idle_calibrated_and_free_of_faults():
    host = Host()
    assert host.code(Arm(SESSION)) == Code.NOT_CALIBRATED
    host.calibrate()
    assert host.code(Arm(0)) == Code.BAD_VALUE
    host.module.damage("supply")
    host.module.advance(0.02)
    assert (host.code(Arm(SESSION)), host.state) == (Code.FAULT_PRESENT, State.IDLE)
    assert host.module.faults == Fault.SUPPLY
    host.module.damage("supply", broken=False)
    host.module.advance(0.2)
    assert (host.code(Arm(SESSION)), host.state) == (Code.OK, State.ARMED)


def test_before_its_first_step_a_module_cannot_be_armed():
    module = SimulatedModule()
    module.receive(Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0).frame(1).pack() + Arm(SESSION).frame(2).pack())
    module.advance(STEP_S)
    assert module.sample.state == State.IDLE


def test_arm_may_be_repeated_while_it_lasts():
    host = host_in(State.ARMED)
    again = host.say(Arm(SESSION))
    assert again == [Acknowledge(Type.ARM, Code.OK, State.ARMED, SESSION)], "it may have been lost"
    host.pull(2.0)
    assert host.code(Arm(SESSION)) == Code.OK
    assert host.state == State.RUNNING
    assert host.code(Arm(SESSION + 1, host.info().stops)) == Code.BAD_STATE


STOPS = {
    "STOP": lambda host: host.say(Stop()),
    "ESTOP, CLEAR": lambda host: host.say(EmergencyStop()) + host.say(Clear()),
    "the end of the link": lambda host: host.module.close_link(),
    "STOP by another link": lambda host: host.module._module.overhear(Stop().frame(9).pack()),
}


@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("state", [State.IDLE, State.ARMED, State.RUNNING, State.TIMEOUT])
def test_no_arm_that_was_sent_before_a_stop_arms_after_it(state, stop):
    """Neither a late copy nor one that the stop overtook."""
    host = host_in(state)
    sent = [Arm(session, host.info().stops) for session in (SESSION, SESSION + 1)]
    STOPS[stop](host)
    if host.state == State.TIMEOUT:
        assert host.code(Stop()) == Code.OK
    assert [host.code(arm) for arm in sent] == [Code.STOPPED] * 2
    assert host.state == State.IDLE
    host.session += 1
    host.arm()


def test_no_arm_that_was_sent_before_a_fault_arms_after_it():
    host = host_in(State.FAULT)
    sent = Arm(SESSION + 1, host.info().stops)
    assert host.code(sent) == Code.BAD_STATE
    assert host.code(Clear()) == Code.OK
    assert host.code(sent) == Code.STOPPED


@given(st.integers(0, 65535).filter(lambda session: session != SESSION))
def test_foreign_sessions_are_refused(session):
    host = host_in(State.ARMED)
    assert host.code(SetTension(session, 3.0)) == Code.BAD_SESSION
    assert host.code(SetImpedance(session, **PLAIN)) == Code.BAD_SESSION
    assert host.state == State.ARMED
    trace = host.module.trace(0.3)
    assert trace.commanded.max() == 0.5, "and they do not prolong anything"
    assert host.state == State.TIMEOUT


@pytest.mark.parametrize("back", [0, 1, 127, 128, 200, 255, 256, 300])
@pytest.mark.parametrize("first", [301, 511, 512, 700])
def test_stale_and_repeated_set_points_are_dropped_without_an_answer(first, back):
    """Also after more of them than there are sequence numbers."""
    host = Host()
    host.calibrate(length=1.0)
    host.sequence = 255
    host.arm()
    assert host.sequence == 0
    for number in range(100, first + 1, 100):
        host.say(SetTension(SESSION, 1.0, rounds=number // 256), number % 256)
    assert host.say(SetTension(SESSION, 1.0, rounds=first // 256), first % 256) == []
    old = first - back
    assert host.say(SetTension(SESSION, 5.0, rounds=old // 256), old % 256) == []
    assert host.module.trace(0.24).commanded.max() == pytest.approx(1.0)
    host.module.advance(0.02)
    assert host.state == State.TIMEOUT, "they do not prolong anything"


def test_two_sessions_in_a_row_differ():
    """Set-points of the first may still be on their way."""
    host = host_in(State.ARMED)
    assert host.code(Stop()) == Code.OK
    info = host.info()
    assert info.session == SESSION
    assert host.code(Arm(SESSION, info.stops)) == Code.BAD_SESSION
    assert host.code(Arm(SESSION + 1, info.stops)) == Code.OK


def test_stops_are_counted_around():
    host = host_in(State.IDLE)
    for _ in range(256):
        host.say(Stop())
    assert host.info().stops == 0


@pytest.mark.parametrize("ahead", [1, 2, 127])
@pytest.mark.parametrize("first", [0, 200, 255])
def test_newer_set_points_count_though_some_were_lost(first, ahead):
    host = host_in(State.ARMED)
    host.say(SetTension(SESSION, 1.0), host.sequence + 1)
    host.code(Stop())
    host.session, host.sequence = 78, first - 1
    host.arm()
    newer = first + ahead
    host.say(SetTension(78, 2.0, rounds=newer // 256), newer % 256)
    assert host.module.trace(0.2).commanded[-1] == 2.0


# Numbers


def refused_set_points():
    """Yield types, layouts and numbers of set-points that are none, out of range, or live too short or long."""
    for tension in (*NO_NUMBERS, -0.01, 6.01, 1e30):
        yield Type.SET_TENSION, "fBHB", (tension, 0, 0, 0)
    for field in range(7):
        for value in (*NO_NUMBERS, -7.0, 1e30):
            numbers = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
            numbers[field] = value
            yield Type.SET_IMPEDANCE, "7fBHB", (*numbers, 0, 0, 0)
    for ttl_ms in (1, 49, 2001, 65535):
        yield Type.SET_TENSION, "fBHB", (1.0, 0, ttl_ms, 0)
    yield Type.SET_TENSION, "fBHB", (1.0, 2, 0, 0)  # a flag is 0 or 1
    yield Type.SET_IMPEDANCE, "7fBHB", (*7 * [0.0], 2, 0, 0)


@pytest.mark.parametrize("state", [State.ARMED, State.RUNNING])
def test_set_points_that_are_none_or_out_of_range_are_refused_and_change_nothing(state):
    for kind, layout, numbers in refused_set_points():
        host = host_in(state)
        assert raw(host, kind, "H" + layout, SESSION, *numbers) == Code.BAD_VALUE, (kind, numbers)
        assert host.module.trace(0.1).commanded == pytest.approx(3.0 if state is State.RUNNING else 0.5, abs=0.01)
        assert host.state == state


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameters_out_of_range_or_none_are_refused(name):
    host, row = Host(), PARAMETERS[name]
    before = host.module.parameters
    for value in (*NO_NUMBERS, row.lower - 1e-3 * max(1.0, abs(row.lower)), 1.001 * row.upper + 1e-3):
        assert raw(host, Type.SET_PARAMETER, "Bf", row.index, value) == Code.BAD_VALUE
    assert host.module.parameters == before
    assert host.say(GetParameter(row.index)) == [ParameterValue(row.index, row.default, row.lower, row.upper)]


CONTRADICTING = {
    "tension_upper": 0.5 - 1e-3, "winding_resistance": 50.0, "length_lower": 5.0,
    "supply_upper": 8.0, "timeout_brake": 0.5, "motor_direction": 0.0, "calibrated": 0.5,
}  # fmt: skip


def test_parameters_that_contradict_the_others_or_do_not_exist_are_refused():
    host = Host()
    host.set(tension_lower=1.0)
    for name, value in CONTRADICTING.items():
        assert host.code(SetParameter(PARAMETERS[name].index, value)) == Code.BAD_VALUE, name
    for index in (len(PARAMETERS), 255):
        assert host.code(GetParameter(index)) == Code.UNKNOWN_PARAMETER
        assert host.code(SetParameter(index, 0.0)) == Code.UNKNOWN_PARAMETER
    host.set(tension_lower=2.0)  # which the winding must be able to hold
    assert host.code(Calibrate(Calibration.NEWTON_PER_AMPERE, 1.9)) == Code.BAD_VALUE
    assert host.code(Arm(SESSION)) == Code.NOT_CALIBRATED


@given(st.integers(0, 255).filter(lambda kind: kind not in set(Type) or kind >= 0x80), st.binary(max_size=56))
def test_what_is_no_command_is_unknown(kind, payload):
    host = host_in(State.RUNNING)
    host.module.receive(WireFrame(kind, 3, payload).pack())
    (frame,) = host.decoder.feed(host.module.transmit())
    assert (frame.type, frame.sequence) == (Type.ACKNOWLEDGE, 3)
    assert frame.payload == bytes([kind, Code.UNKNOWN_TYPE, State.RUNNING, SESSION, 0])


# What is only for a module at rest


@pytest.mark.parametrize("state", [state for state in State if state != State.IDLE])
def test_only_an_idle_module_is_changed(state):
    host = host_in(state)
    calibrations = (Calibrate(what, 1.0) for what in Calibration)
    for command in (GetParameter(0), SetParameter(PARAMETERS["slew"].index, 50.0), Save(), *calibrations):
        assert host.code(command) == Code.BAD_STATE
    assert host.module.parameters["slew"] == 60.0
    assert host.module.settings == b""


def test_a_module_is_not_changed_while_it_lets_go():
    # 3 N fade for 50 ms after a stop; twice the N/A would halve them at once.
    host = host_in(State.RUNNING)
    host.code(Stop())
    host.module.advance(0.01)
    assert host.module.sample.commanded > 2.0
    change = SetParameter(PARAMETERS["newton_per_ampere"].index, 6.0)
    for command in (change, Save(), *map(Calibrate, Calibration)):
        assert host.code(command) == Code.BAD_STATE
    host.session = 78
    host.arm()
    trace = host.module.trace(0.1)
    assert trace.driver_on.all(), "but it may be armed"
    assert trace.commanded[-1] == 0.5


def test_a_second_chore_waits_for_the_first_and_only_stop_ends_an_alignment_whose_result_is_stored():
    host = Host(plant={"zero_error": 1.0})
    assert host.say(Calibrate(Calibration.ENCODER)) == [], "it is answered when it is done"
    repeated = host.sequence
    assert host.say(Calibrate(Calibration.ENCODER), repeated) == [], "and only once"
    assert host.code(Calibrate(Calibration.ENCODER)) == Code.BAD_STATE, "another one is another chore"
    assert host.code(Save()) == Code.BAD_STATE
    assert host.code(Arm(SESSION)) == Code.BAD_STATE
    assert [answer.code for answer in host.say(Stop())] == [Code.FAILED, Code.OK]
    host.module.advance(0.01)
    assert host.hear() == []
    assert host.module.parameters["motor_zero"] == 0.0
    host.say(Calibrate(Calibration.ENCODER))
    assert host.say(Clear())[0].code == Code.OK, "which is no reason to give it up"
    host.module.advance(0.01)
    assert [(answer.command, answer.code) for answer in host.hear()] == [(Type.CALIBRATE, Code.OK)]
    assert host.module.parameters["motor_zero"] == 1.0
    assert host.say(Save()) == []
    assert [answer.command for answer in host.say(Stop())] == [Type.STOP], "storing continues"
    host.module.advance(0.01)
    assert [(answer.command, answer.code) for answer in host.hear()] == [(Type.SAVE, Code.OK)]
    assert Host(settings=host.module.settings).module.parameters["motor_zero"] == 1.0


def test_an_alignment_that_fails_leaves_the_zero_as_it_was():
    host = Host()
    host.module.damage("encoder")
    host.say(Calibrate(Calibration.ENCODER))
    host.module.advance(0.002)
    assert [(answer.command, answer.code) for answer in host.hear()] == [(Type.CALIBRATE, Code.FAILED)]
    assert host.module.parameters["motor_zero"] == 0.0


def test_an_emergency_stop_is_cleared_though_something_is_wrong_which_then_keeps_it_from_arming():
    host = host_in(State.ESTOP)
    host.module.damage("supply")
    host.module.advance(0.02)
    assert (host.code(Clear()), host.state) == (Code.OK, State.IDLE)
    assert host.code(Arm(SESSION + 1, host.info().stops)) == Code.FAULT_PRESENT


def test_settings_are_stored_and_found_again_but_not_if_they_are_damaged():
    host = Host()
    host.set(slew=50.0)
    host.calibrate(newton_per_ampere=2.5)
    assert host.say(Save()) == []
    host.module.advance(0.01)
    assert [answer.code for answer in host.hear()] == [Code.OK]
    image = host.module.settings
    again = Host(settings=image)
    assert again.module.loaded
    assert again.module.parameters == host.module.parameters
    again.arm()
    for at in range(len(image)):
        for bit in range(8):
            broken = bytearray(image)
            broken[at] ^= 1 << bit
            assert not SimulatedModule(settings=bytes(broken)).loaded
    for cut in (b"", image[:-1], image + b"\0"):
        module = SimulatedModule(settings=cut)
        assert not module.loaded
        assert module.parameters == SimulatedModule().parameters


# The length of the cable


def test_a_spring_needs_to_know_the_length():
    host = Host()
    host.calibrate()
    host.arm()
    assert host.code(SetImpedance(SESSION, **(PLAIN | {"stiffness": 10.0}))) == Code.NOT_CALIBRATED
    host.render(feed_forward=1.0)
    assert host.state == State.RUNNING


@pytest.mark.parametrize("event", ["encoder", "loop", "spool_radius", "motor_direction"])
def test_the_length_is_forgotten_when_turns_or_their_meaning_may_be_lost(event):
    host = Host()
    host.calibrate(length=1.0)
    assert host.say(Hello())[0].length_known
    if event == "encoder":
        host.module.damage("encoder")
        host.module.advance(0.01)
        assert host.code(Calibrate(Calibration.LENGTH, 1.0)) == Code.FAULT_PRESENT
        host.module.damage("encoder", broken=False)
    elif event == "loop":
        host.module.pause(0.1)
    else:
        host.set(**{event: -1.0 if event == "motor_direction" else 0.02})
    host.module.advance(0.1)
    assert not host.say(Hello())[0].length_known
    for lengths, code in (((0.0, UPPER), Code.OK), ((-1e-3, UPPER + 1e-3), Code.BAD_VALUE)):
        assert [host.code(Calibrate(Calibration.LENGTH, length)) for length in lengths] == [code] * 2


def test_the_length_is_what_it_is_calibrated_to_at_any_angle_of_the_spool():
    host = host_in(State.ARMED)
    host.hold(3.0, 1.0, distance=host.module.sample.distance + 0.2)  # pays out 0.2 m
    host.say(Stop())
    host.module.advance(1.0)
    assert host.code(Calibrate(Calibration.LENGTH, 0.5)) == Code.OK
    host.say(ConfigureTelemetry(5))
    host.module.advance(0.01)
    length = [each.length for each in host.hear() if isinstance(each, Telemetry)][-1]
    assert length == pytest.approx(0.5, abs=1e-3)


# Answers


def test_ping_comes_back_with_the_clock():
    host = Host(start_us=1000)
    host.module.advance(0.5)
    assert host.say(Ping(2**64 - 1), 200) == [Pong(2**64 - 1, 1000 + 250 + 500_000)]


def test_telemetry_tells_the_truth():
    host = host_in(State.RUNNING, distance=1.0)
    assert host.code(ConfigureTelemetry(4)) == Code.BAD_VALUE
    assert host.code(ConfigureTelemetry(20)) == Code.OK
    host.module.receive(b"rubbish" + DELIMITER)
    host.pull(3.0)
    host.module.advance(0.1)
    reports = host.hear()
    assert len(reports) == 5
    last, sample = reports[-1], host.module.sample
    assert isinstance(last, Telemetry)
    assert (last.state, last.limit, last.faults) == (State.RUNNING, Limit.NONE, Fault(0))
    assert last.tension == pytest.approx(sample.commanded)
    assert last.current == pytest.approx(sample.current, abs=0.03)
    assert last.length == pytest.approx(sample.length, abs=1e-3)
    assert last.supply == pytest.approx(12.0, abs=0.2)
    assert (last.bad_frames, last.longest_step_us, last.sequence) == (1, 250, host.sequence)
    assert host.code(ConfigureTelemetry(0)) == Code.OK
    host.module.advance(0.1)
    assert host.hear() == []


def test_telemetry_that_is_not_fetched_leaves_room_for_answers():
    host = host_in(State.RUNNING)
    host.code(ConfigureTelemetry(5))
    for _ in range(20):
        host.module.receive(SetTension(SESSION, 2.0).frame(host.sequence + 1).pack())
        host.sequence += 1
        host.module.advance(0.1)
    host.module.receive(EmergencyStop().frame(9).pack())
    reports = host.hear()
    assert reports[-1] == Acknowledge(Type.ESTOP, Code.OK, State.ESTOP, SESSION)
    host.module.advance(0.01)
    assert host.hear()[-1].lost_frames > 300


def test_an_event_tells_of_what_no_command_brought():
    host = host_in(State.RUNNING)
    host.module.advance(0.3)
    assert host.hear() == [Event(State.TIMEOUT, Fault(0), Limit.NONE)]
    host.module.damage("supply")
    host.module.advance(0.02)
    assert [(event.state, event.faults) for event in host.hear()] == [(State.FAULT, Fault.SUPPLY)]


def test_a_new_link_starts_afresh():
    host = host_in(State.RUNNING)
    host.code(ConfigureTelemetry(5))
    host.module.advance(0.1)
    half = Hello().frame(1).pack()[:3]
    host.module.receive(half)
    host.module.close_link()
    assert host.state == State.TIMEOUT
    assert host.hear() == []
    assert host.say(Hello())[0].state == State.TIMEOUT
    host.module.advance(0.1)
    assert host.hear() == [], "telemetry is off again"
