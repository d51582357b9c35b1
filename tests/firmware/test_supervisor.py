"""The supervisor's table: complete, safe, and what the running module does."""

import pytest

from tensionlab import _native
from tensionlab.hardware.protocol.codes import Code, Fault, Limit, State
from tensionlab.hardware.protocol.messages import Arm, Clear, EmergencyStop, Hello, SetTension, Stop
from tests.helpers.modules import Host, host_in

EVENTS = ("arm", "set_point", "stop", "estop", "clear", "expire", "fault")
TABLE = {
    (state, event): (accepted, State(after))
    for event, row in zip(EVENTS, _native.transition_table(), strict=True)
    for state, (accepted, after) in zip(State, row, strict=True)
}
COMMANDS = {
    "arm": Arm(78),  # a new session
    "set_point": SetTension(77, 2.0),
    "stop": Stop(),
    "estop": EmergencyStop(),
    "clear": Clear(),
}


def happen(host: Host, event: str) -> bool:
    """Let an event happen to a module; whether it was accepted."""
    if event == "expire":
        host.module.close_link()
        return True
    if event == "fault":
        host.module.damage("supply")
        host.module.advance(0.02)
        return True
    answers = host.say(COMMANDS[event])
    return answers == [] or answers[-1].code == Code.OK


AS_DOCUMENTED = """
            idle      armed     running   timeout   fault     estop
arm         armed     refused   refused   refused   refused   refused
set_point   refused   running   running   refused   refused   refused
stop        idle      idle      idle      idle      refused   refused
estop       estop     estop     estop     estop     estop     estop
clear       idle      armed     running   timeout   idle      idle
expire      idle      timeout   timeout   timeout   fault     estop
fault       idle      fault     fault     fault     fault     estop
"""


def test_the_table_is_the_one_that_is_documented():
    states, *rows = [line.split() for line in AS_DOCUMENTED.strip().splitlines()]
    for event, *row in rows:
        for state, after in zip(states, row, strict=True):
            before = State[state.upper()]
            refused = after == "refused"
            assert TABLE[before, event] == (not refused, before if refused else State[after.upper()])
    assert len(TABLE) == len(rows) * len(State)


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("state", State)
def test_the_module_does_what_the_table_says(state, event):
    host = host_in(state)
    accepted, after = TABLE[state, event]
    assert happen(host, event) == accepted
    assert host.state == after
    host.module.advance(0.05)
    if after == state == State.RUNNING or after != State.RUNNING:
        assert host.state == after, "and it lasts"


def test_from_everywhere_a_stop_is_one_step_and_estop_latches():
    for state in State:
        assert TABLE[state, "estop"] == (True, State.ESTOP)
        assert TABLE[state, "stop"][1] not in (State.ARMED, State.RUNNING)
        assert TABLE[state, "expire"][1] not in (State.ARMED, State.RUNNING)
        assert TABLE[state, "fault"][1] not in (State.ARMED, State.RUNNING)
        if state not in (State.ARMED, State.RUNNING):
            assert State.RUNNING not in {TABLE[state, event][1] for event in EVENTS}, "but by ARM and a set-point"
    for event in set(EVENTS) - {"clear"}:
        assert TABLE[State.ESTOP, event][1] == State.ESTOP


@pytest.mark.parametrize("state", State)
def test_estop_lets_go_within_a_step_and_stays(state):
    host = host_in(state)
    assert host.code(EmergencyStop()) == Code.OK
    trace = host.module.trace(1.0)
    assert not trace.driver_on.any()
    assert (trace.commanded == 0.0).all()
    assert (trace.state == State.ESTOP).all()
    assert host.code(Stop()) == Code.BAD_STATE
    assert host.code(Clear()) == Code.OK
    assert host.state == State.IDLE


@pytest.mark.parametrize(
    ("part", "fault"), [("encoder", Fault.ENCODER), ("supply", Fault.SUPPLY), ("motor", Fault.MOTOR)]
)
def test_a_fault_lets_go_latches_and_is_cleared_only_when_it_is_over(part, fault):
    host = host_in(State.RUNNING)
    host.module.damage(part)
    for _ in range(6):
        host.say(SetTension(77, 3.0))
        host.module.advance(0.02)
    assert host.state == State.FAULT
    assert host.module.faults == fault
    assert not host.module.sample.driver_on
    if part != "motor":  # while the driver is off, an open wire does not show
        assert host.code(Clear()) == Code.FAULT_PRESENT
    host.module.damage(part, broken=False)
    host.module.advance(0.6)
    assert host.state == State.FAULT, "it latches"
    assert host.module.faults == fault
    assert host.code(Clear()) == Code.OK
    assert host.module.faults == Fault(0)
    host.session = 78
    host.arm()


def test_a_fault_ends_a_stop_at_once():
    host = host_in(State.RUNNING)
    host.module.damage("encoder")
    assert host.code(Stop()) == Code.OK
    trace = host.module.trace(0.002)
    assert trace.commanded[0] > 2.0
    assert trace.commanded[-1] == 0.0
    assert not trace.driver_on[-1]


def test_a_loop_that_hangs_is_a_fault():
    host = host_in(State.RUNNING)
    host.module.pause(0.006)
    host.module.advance(0.00025)
    assert (host.state, host.module.faults) == (State.FAULT, Fault.LOOP)


def test_the_active_limiter_is_reported():
    host = host_in(State.RUNNING)
    limits = [Limit(trace.limit[-1]) for trace in (host.hold(3.0, 0.1)[-1], host.hold(0.2, 0.2)[-1])]
    assert limits == [Limit.NONE, Limit.LOWER]
    host.pull(5.0)
    assert set(host.module.trace(0.02).limit) == {Limit.SLEW}
    host.say(EmergencyStop())
    assert set(host.module.trace(0.01).limit) == {Limit.IDLE}


@pytest.mark.parametrize(("part", "known"), [("supply", True), ("encoder", False)])
def test_a_length_stays_known_unless_turns_may_have_gone_by_uncounted(part, known):
    host = host_in(State.RUNNING)
    host.module.damage(part)
    host.module.advance(0.02)
    assert host.state == State.FAULT
    [info] = host.say(Hello())[-1:]
    assert info.length_known == known


def test_after_a_timeout_a_module_that_is_armed_again_has_the_whole_time_anew():
    host = host_in(State.TIMEOUT)
    host.module.advance(2.0)
    assert not host.module.sample.driver_on
    assert host.code(Stop()) == Code.OK
    host.session = 78
    host.arm()
    trace = host.module.trace(2.2)
    assert trace.driver_on[trace.state == State.ARMED].all()
    assert trace.driver_on[trace.state == State.TIMEOUT].all()
