"""What holds whatever comes over the link, whenever, and whatever breaks."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensionlab import _native
from tensionlab.hardware.protocol.codes import Calibration, Code, Limit, ResetReason, State
from tensionlab.hardware.protocol.messages import (
    Arm,
    Calibrate,
    Clear,
    ConfigureTelemetry,
    EmergencyStop,
    Hello,
    Info,
    SetImpedance,
    SetTension,
    Stop,
)
from tensionlab.hardware.simulation.simulated_module import COLUMNS, PARTS, STEP_S, Sample, SimulatedModule, Trace
from tests.helpers.examples import many
from tests.helpers.modules import SESSION, Host, armed, host_in

LOWER, UPPER, SLEW, PEAK, RELEASE = 0.5, 6.0, 60.0, 2.2, 2.0
TINY = 1e-5  # of single precision
STAGE = 2.0  # s: the second stage of a timeout
SETTLED = UPPER / SLEW + 2 * STEP_S  # s: the ramp down


def check_steps(before: Sample, trace: Trace) -> None:
    """Tension never above the limit, never faster than the slew; but to let go can't wait."""
    commanded = np.concatenate(([before.commanded], trace.commanded))
    assert commanded.min() >= 0.0
    assert commanded.max() <= UPPER + TINY
    assert np.abs(trace.current).max() <= PEAK + TINY
    change, seconds = np.diff(commanded), np.diff(trace.seconds, prepend=before.seconds)
    assert (change <= SLEW * seconds + TINY).all()
    let_go = (commanded[1:] == 0.0) & ~trace.driver_on
    assert (let_go | (change >= -SLEW * seconds - TINY)).all()
    # It is let go at once only for a fault, an emergency stop, or the last bit of a ramp.
    at_once = let_go & (change < -SLEW * seconds - TINY)
    assert np.isin(trace.state[at_once], (State.FAULT, State.ESTOP, State.IDLE)).all()
    off = np.isin(trace.state, (State.FAULT, State.ESTOP))
    assert not trace.driver_on[off].any()
    assert not trace.current[1:][off[:-1] & off[1:]].any()


@dataclass
class Watch:
    """Checks a module while things happen to it; knows when at the latest it must have let go."""

    module: SimulatedModule
    braked: bool = False
    expires: float = 0.0
    stops: int = 0  # as INFO says it

    def send(self, content: bytes) -> None:
        self.module.receive(content)

    def set_point(self, message, sequence: int) -> None:
        """Whether it is taken or not, it can't keep the module pulling for longer than it says."""
        life = 1e-3 * (message.ttl_ms if 50 <= message.ttl_ms <= 2000 else 250)
        self.expires = max(self.expires, self.module.sample.seconds + life)
        self.braked = self.braked or message.brake
        self.send(message.frame(sequence).pack())

    def arm(self, session: int, sequence: int) -> None:
        self.expires = max(self.expires, self.module.sample.seconds + 0.25)
        self.send(Arm(session, self.stops).frame(sequence).pack())

    def advance(self, seconds: float, distance: float | None = None) -> None:
        before = self.module.sample
        trace = self.module.trace(seconds, distance)
        if len(trace.seconds) == 0:
            return
        check_steps(before, trace)
        # The clock may stand still for a moment in a step that comes late.
        late = trace.seconds - self.expires
        most = RELEASE if self.braked else LOWER
        assert (trace.commanded[late > SETTLED] <= most + TINY).all()
        assert not trace.driver_on[late > STAGE + LOWER / SLEW + RELEASE / SLEW + 3 * STEP_S].any()


FLOATS = st.floats(width=32)
SEQUENCES = st.integers(0, 255)
SESSIONS = st.sampled_from([SESSION, SESSION, SESSION, SESSION + 1, 0])
TENSIONS = st.one_of(st.floats(-1.0, 8.0, width=32), st.sampled_from([0.0, 0.5, 6.0]))
TTLS = st.sampled_from([0, 0, 49, 50, 100, 1000, 2000, 2001])
SET_TENSION = st.builds(SetTension, SESSIONS, TENSIONS, st.booleans(), TTLS)
SET_IMPEDANCE = st.builds(
    SetImpedance, SESSIONS, st.floats(-0.1, 2.0), st.floats(-1.0, 600.0), st.floats(-0.1, 11.0),
    st.floats(-7.0, 7.0), st.floats(0.0, 7.0), st.floats(0.0, 510.0), st.floats(-0.1, 1.1), st.booleans(), TTLS,
)  # fmt: skip
ACTIONS = st.one_of(
    st.tuples(st.just("set_point"), st.one_of(SET_TENSION, SET_IMPEDANCE)),
    st.tuples(st.just("set_point"), SET_TENSION),
    st.tuples(st.just("arm"), SESSIONS),
    st.tuples(st.just("say"), st.sampled_from([Stop(), Clear(), EmergencyStop(), Hello(), ConfigureTelemetry(5)])),
    st.tuples(st.just("bytes"), st.binary(max_size=80)),
    st.tuples(st.just("damage"), st.sampled_from(PARTS)),
    st.tuples(st.just("repair"), st.sampled_from(PARTS)),
    st.tuples(st.just("pause"), st.floats(0.0, 0.03)),
    st.tuples(st.just("close"), st.none()),
    st.tuples(st.just("move"), st.floats(0.96, 1.04)),
)
WAITS = st.sampled_from([0.0, STEP_S, 0.003, 0.02, 0.1, 0.3, 2.5])


@settings(max_examples=many(400))
@given(st.lists(st.tuples(ACTIONS, WAITS), min_size=1, max_size=25), st.integers(0, 2**32 - 1))
def test_any_messages_at_any_time_with_any_damage(happenings, start_us):
    host = Host(start_us=start_us)
    host.calibrate(length=1.0)
    watch = Watch(host.module)
    watch.arm(SESSION, 1)
    sequence = 1
    for (kind, what), wait in happenings:
        sequence = (sequence + 1) % 256
        if kind == "set_point":
            watch.set_point(what, sequence)
        elif kind == "arm":
            watch.arm(what, sequence)
        elif kind == "say":
            watch.send(what.frame(sequence).pack())
        elif kind == "bytes":
            watch.send(what)
        elif kind == "close":
            host.module.close_link()
        elif kind == "move":
            watch.advance(0.1, what)  # slowly: faster, the motor becomes a generator
        elif kind == "pause":
            host.module.pause(what)
        else:
            host.module.damage(what, broken=kind == "damage")
        watch.advance(wait)
        watch.stops = next((told.stops for told in host.say(Hello(), 0) if isinstance(told, Info)), watch.stops)
    watch.advance(4.5)
    assert not host.module.sample.driver_on


@given(st.lists(st.tuples(st.binary(max_size=300), st.floats(0.0, 0.01)), max_size=20))
def test_bytes_alone_never_arm_a_module(pieces):
    host = Host()
    host.calibrate()
    for content, wait in pieces:
        host.module.receive(content)
        trace = host.module.trace(wait)
        assert not trace.driver_on.any()
    assert host.state in (State.IDLE, State.ESTOP)


@pytest.mark.parametrize("ttl_ms", [0, 50, 300, 2000])
@pytest.mark.parametrize("tension", [0.0, 2.0, 6.0])
def test_without_set_points_a_module_is_taut_and_then_off(tension, ttl_ms):
    life = 1e-3 * (ttl_ms or 250)
    host = host_in(State.ARMED)
    host.hold(tension, 0.2)
    host.pull(tension, ttl_ms=ttl_ms)
    since = host.module.sample.seconds
    trace = host.module.trace(5.0)
    after = trace.seconds - since
    assert (trace.state[after <= life] == State.RUNNING).all()
    assert (trace.state[after > life + 1.5 * STEP_S] == State.TIMEOUT).all(), "and it latches"
    ramp = life + (max(tension, LOWER) - LOWER) / SLEW
    np.testing.assert_allclose(trace.commanded[(after > ramp + 2 * STEP_S) & (after < life + STAGE)], LOWER)
    off = after > life + STAGE + LOWER / SLEW + 3 * STEP_S
    assert not trace.driver_on[off].any()
    assert off.sum() > 3900
    taut = (after > life + 1.5 * STEP_S) & (after < life + STAGE)
    assert set(trace.limit[taut]) == {Limit.TIMEOUT}
    assert set(trace.limit[off]) == {Limit.IDLE}
    assert host.code(SetTension(SESSION, 1.0)) == Code.BAD_STATE


def test_a_link_that_closes_is_a_timeout_at_once():
    host = host_in(State.RUNNING)
    host.module.close_link()
    trace = host.module.trace(0.1)
    assert (trace.state == State.TIMEOUT).all()
    assert trace.commanded[round(2.5 / SLEW / STEP_S) + 1] == pytest.approx(LOWER)


@pytest.mark.parametrize("slew", [10.0, 300.0])
def test_at_any_slew_the_ramp_ends_before_the_driver_goes_off(slew):
    host = armed(6.0, {"slew": slew, "tension_upper": 12.0, "newton_per_ampere": 6.0, "tension_lower": 0.1})
    host.hold(12.0, 1.3)
    trace = host.module.trace(3.0)
    steps = np.abs(np.diff(trace.commanded))
    assert trace.commanded[0] == pytest.approx(12.0)
    assert steps.max() <= slew * STEP_S + TINY
    assert trace.commanded[round(2.2 / STEP_S)] == pytest.approx(0.1)
    assert not trace.driver_on[-1]


def test_the_clock_may_wrap_around():
    def story(start_us: int) -> tuple[np.ndarray, list]:
        host = armed(start_us=start_us)
        traces = host.hold(3.0, 0.3) + host.hold(0.5, 0.3, brake=True) + host.hold(2.0, 0.5, distance=0.95)
        host.render(rest=0.9, stiffness=40.0, damping=1.0, ttl_ms=400)  # a vibration has its phase by the clock
        traces.append(host.module.trace(3.5))
        answers = [host.code(Stop()), host.code(Arm(78, host.info().stops))]
        traces.append(host.module.trace(0.4))
        return np.concatenate(traces), answers

    plain = story(0)
    for before in (1, 250, 100_000, 400_000, 700_000, 1_100_000, 1_350_000, 1_600_000, 3_000_000, 4_800_000):
        wrapped = story(2**32 - before)
        np.testing.assert_array_equal(wrapped[0], plain[0])
        assert wrapped[1] == plain[1]


def test_a_set_point_that_seems_to_come_from_the_future_does_not_expire_at_once():
    # Two readings of the clock once made the age of a set-point negative: as an unsigned number, far too old.
    module = _native.SimulatedModule(1, {}, 1.0, 0, 2**32 - 1000, ResetReason.POWER)
    module.advance(1, 1.0)
    messages = (Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0), Arm(SESSION), SetTension(SESSION, 3.0))
    for sequence, message in enumerate(messages):
        module.receive(message.frame(sequence).pack(), 900)
    states = module.trace(4000, 1.0)[:, COLUMNS["state"]]
    np.testing.assert_array_equal(states[:1000], State.RUNNING)
    assert states[1010] == State.TIMEOUT
