"""The native end of a link: what it keeps of a module, and what it is sure about without Python."""

import math
import random
import socket
import sys
import time
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tensionlab import _native
from tensionlab.demand import Demand
from tensionlab.errors import HardwareError, LinkError, ProtocolError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.links import SocketLink
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import BrakeState, Code, Fault, Limit, State, Type
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Decoder,
    Event,
    Log,
    SetTension,
    Telemetry,
    WireFrame,
    read,
)
from tensionlab.hardware.runner.armed_modules import ArmedModules
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.model.module import TensionLimits
from tests.helpers.wire import telemetry

LONG_S = 30.0
TTL_S = 0.25


def armed(group, notes, on_loss="continue"):
    """Return the armed modules of a group, whose windings bear next to nothing; losses are added to the notes."""
    count = len(group.clients)
    group.infos = [SimpleNamespace(tension_lower=0.5)] * count
    group.slews, group.continuous = [60.0] * count, [1e-3] * count
    rig = SimpleNamespace(limits=TensionLimits(np.full(count, 0.5), np.full(count, 6.0)), m=count, bodies=())
    settings, clock = RunSettings(ttl=TTL_S, on_loss=on_loss), SimpleNamespace(now=lambda: 0.0)
    return ArmedModules(rig, group, settings, clock, Statistics(), lambda *note: notes.append(note))


class Scripted:
    """Link without a file, whose clock and bytes are those of a test."""

    url, lockstep, file = "test:", True, None

    def __init__(self):
        self.now, self.said, self.heard = 50.0, b"", Decoder()
        self.sent = []

    def send(self, content):
        self.sent += self.heard.feed(content)

    def receive(self, timeout):
        said, self.said = self.said, b""
        return said

    def clock(self):
        return self.now

    def close(self):
        pass


def scripted(count=1, seed=0):
    return ModuleGroup([ModuleClient("abc"[index], Scripted(), seed) for index in range(count)])


def frame(message):
    """Its frame, also of numbers that are not finite, which a broken sensor may report."""
    return WireFrame(message.type, 0, message._layout.pack(*vars(message).values()))


def say(client, *messages):
    client.link.said = b"".join(frame(message).pack() for message in messages)
    client.listen()


@pytest.fixture
def pair():
    """A client of a socket that a native thread reads, and the module's end of it."""
    near, far = socket.socketpair()
    with ModuleClient("one", SocketLink("pair:one", near), seed=3) as client:
        yield client, far
    far.close()


def until(holds):
    end = time.monotonic() + LONG_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(1e-3)


def test_what_a_thread_without_python_reads_is_what_the_module_said(pair):
    client, far = pair
    for number, length in enumerate((1.0, 1.25, 1.5)):
        said = telemetry(10_000 * number, length=length, state=State.ARMED, faults=Fault.SPEED)
        before = client.link.clock()
        far.send(said.frame(0).pack())
        until(lambda said=said: client.telemetry is not None and client.telemetry.message == said)
        assert before <= client.telemetry.time <= client.link.clock()
        assert (client.state, client.endpoint.faults) == (State.ARMED, Fault.SPEED)
    assert client.telemetry is client.telemetry
    far.send(telemetry(5_000).frame(0).pack())
    until(lambda: client.endpoint.stale == 1)
    far.send(b"rubbish" + bytes(3))
    until(lambda: client.bad_frames == 1)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_messages_are_taken_in_the_order_in_which_they_came(size):
    """The last that has a state wins, whoever took it: telemetry natively, the others in Python."""
    messages = [telemetry(1), Acknowledge(Type.STOP, Code.OK, State.ARMED), telemetry(2, state=State.IDLE)]
    messages += [Event(State.FAULT, Fault.SUPPLY, Limit.IDLE), telemetry(3), Log("so it is"), telemetry(4)]
    for count in range(1, len(messages) + 1):
        client = scripted().clients[0]
        stream = b"".join(message.frame(0).pack() for message in messages[:count])
        for begin in range(0, len(stream), size):
            client.link.said = stream[begin : begin + size]
            client.listen()
        stated = [message for message in messages[:count] if hasattr(message, "state")]
        assert client.state is stated[-1].state
        heard = [message for message in messages[:count] if isinstance(message, Telemetry)]
        assert client.telemetry.message == heard[-1]


def test_telemetry_is_recorded_once_and_in_order(pair):
    client, far = pair
    recorded = []
    client.record(recorded)
    said = [telemetry(1), Event(State.IDLE, Fault(0), Limit.IDLE), telemetry(2), telemetry(2), telemetry(3)]
    far.send(b"".join(message.frame(0).pack() for message in said))
    until(lambda: len(recorded) == 3)
    assert recorded == [said[0], said[2], said[4]]
    client.record(None)
    far.send(telemetry(4).frame(0).pack())
    until(lambda: client.telemetry.message.time_us == 4)
    assert len(recorded) == 3


@pytest.mark.parametrize(
    ("at", "value"), [(4, len(State)), (7, len(Limit)), (34, len(BrakeState))], ids=["state", "limit", "brake"]
)
def test_telemetry_with_a_code_that_has_no_name_is_not_read(at, value):
    client = scripted().clients[0]
    payload = bytearray(telemetry().pack())
    payload[at] = value
    frames = [WireFrame(Type.TELEMETRY, 0, content).pack() for content in (bytes(payload), b"short")]
    client.link.said = b"".join(frames)
    client.listen()
    assert client.telemetry is None
    assert client.bad_frames == 2


@pytest.mark.parametrize(
    ("before", "now", "newer"),
    [
        (5_000, 5_001, True),
        (5_000, 5_000, False),
        (5_000_000, 4_000_001, False),
        (5_000_000, 4_000_000, True),  # it has started anew
        (2**32 - 10, 10, True),  # its clock has gone round
        (10, 2**32 - 10, False),
    ],
)
def test_telemetry_that_is_no_newer_is_left_out(before, now, newer):
    client = scripted().clients[0]
    say(client, telemetry(before), telemetry(now, length=2.0), telemetry(now, length=2.0))
    assert client.telemetry.message.length == (2.0 if newer else 1.0)
    assert client.endpoint.stale == client.endpoint.repeated == (1 if newer else 2)
    say(client, telemetry((now + 2_000_000) % 2**32))
    assert (client.endpoint.stale, client.endpoint.repeated) == ((1 if newer else 2), 0)


def test_set_points_go_out_natively_as_python_writes_them(pair):
    client, far = pair
    client.endpoint.session = 4711
    group = ModuleGroup([client])
    yes = np.ones(1, dtype=bool)
    decoder, numbers = Decoder(), []
    for tension, brake in ((0.5, False), (6.0, True), (1.1, False)):
        sequences, left, failed = group.send_tensions(np.array([tension]), yes, np.array([brake]), 250)
        numbers.append(int(sequences[0]))
        assert (left, failed) == ([], [])
        (sent,) = decoder.feed(far.recv(1000))
        assert sent == SetTension(4711, tension, brake, 250).frame(numbers[-1])
    assert np.all(np.diff(numbers) % 256 == 1)
    assert client.set_tension(2.0) == (numbers[-1] + 1) % 256, "numbers go on, whoever sends"


def test_what_cannot_be_sent_natively_is_left_to_python_which_says_why(pair):
    client, _ = pair
    other = scripted().clients[0]
    group = ModuleGroup([client, other])
    both, none = np.ones(2, dtype=bool), np.zeros(2, dtype=bool)
    for wrong in (math.nan, math.inf, 1e39):
        sequences, left, _ = group.send_tensions(np.array([wrong, 1.0]), both, none, 250)
        assert (sequences.tolist(), left) == ([-1, -1], [0, 1])
    assert group.send_tensions(np.ones(2), none, none, 250)[0].tolist() == [-1, -1]
    modules = armed(group, [])
    modules.tensions = np.array([math.nan, 1.0])
    with pytest.raises(ProtocolError, match="all numbers must be finite"):
        modules.send(Demand())


def test_a_link_that_breaks_or_takes_no_more_is_told_by_its_name(pair):
    client, far = pair
    group = ModuleGroup([client])
    yes, no = np.ones(1, dtype=bool), np.zeros(1, dtype=bool)
    failed = []
    while not failed:  # nobody reads the other end
        _, left, failed = group.send_tensions(np.ones(1), yes, no, 250)
        assert left == []
    assert str(failed[0][1]) == "pair:one takes no more bytes; does the module still read?"
    far.close()
    _, _, failed = group.send_tensions(np.ones(1), yes, no, 250)
    assert str(failed[0][1]).startswith("pair:one broke: ")
    client.close()
    sequences, left, failed = group.send_tensions(np.ones(1), yes, no, 250)
    assert (sequences.tolist(), left, failed) == ([-1], [0], []), "and what is closed is not written to"


def test_a_link_that_is_cut_is_found_by_the_next_check(pair):
    client, far = pair
    group = ModuleGroup([client])
    far.send(telemetry(1).frame(0).pack())
    until(lambda: client.telemetry is not None)
    assert group.suspects(np.ones(1, dtype=bool), np.zeros(1), LONG_S) == []
    far.close()
    until(lambda: group.suspects(np.ones(1, dtype=bool), np.zeros(1), LONG_S) == [0])
    with pytest.raises(LinkError, match=r"pair:one was closed by the module|pair:one broke"):
        client.check()


FLOATS = st.one_of(st.floats(-2.0, 2.0, width=32), st.sampled_from([math.nan, math.inf, -math.inf]))
REPORTS = st.builds(
    telemetry,
    st.integers(0, 2**32 - 1),
    state=st.sampled_from(State),
    faults=st.sampled_from([Fault(0), Fault.SPEED]),
    **dict.fromkeys(("tension", "current", "length", "speed", "supply", "bearable"), FLOATS),
)
STEPS = st.lists(
    st.tuples(
        st.one_of(
            REPORTS,
            st.builds(  # what follows from the one before, or nearly so
                lambda jump, speed: (jump, speed), st.floats(-0.2, 0.2), st.floats(-3.0, 3.0)
            ),
            st.none(),
            st.sampled_from([Acknowledge(Type.SET_TENSION, Code.BAD_VALUE, State.RUNNING)]),
        ),
        st.floats(0.0, 0.3),
        st.sampled_from([math.nan, 0.0, TTL_S, 0.26, 3.0]),
    ),
    max_size=8,
)


class Everyone(ModuleGroup):
    """Group that suspects everyone, so that all checks are Python's."""

    def suspects(self, active, delays, ttl):
        return np.flatnonzero(active).tolist()


def lost(group, steps):
    """Which module is lost in which cycle, and why."""
    found, notes, now = [], [], 0.0
    modules = armed(group, notes)
    said = telemetry(1_000_000)
    for client in group.clients:
        say(client, said)
    for step, seconds, delay in steps:
        what, now = step, now + seconds
        for client in group.clients:
            client.link.now += seconds
        if isinstance(step, tuple):
            jump, speed = step
            passed = round(1e6 * seconds) + 1
            length = said.length + 0.5e-6 * (said.speed + speed) * passed + jump
            what = replace(said, time_us=(said.time_us + passed) % 2**32, length=length, speed=speed)
            what = read(frame(what))  # in single precision, as it arrives
        if isinstance(what, Telemetry):
            said = what
        if what is not None:
            say(group.clients[0], what)
        measured, _ = group.observe()
        seen = type("Seen", (), {"ages": measured[3], "bearable": measured[5]})
        with suppress(HardwareError):
            modules.check(seen, np.array([delay, 0.0]), now)
        found += [(now, *note) for note in notes]
        notes.clear()
    return found


@given(STEPS)
@example([((0.04, 0.0), 0.02, 0.0), ((0.06, 0.0), 0.0, 0.0)])
@example([((0.0, 0.0), 0.02, 0.0), (telemetry(1_100_000, bearable=0.25), 0.02, 0.0)])
@example([((0.0, 0.0), 0.02, 0.26)] * 20)
def test_who_is_not_suspected_would_have_passed_every_check(steps):
    """Native checks lose the same modules in the same cycles, for the same reasons, as those of Python alone."""
    clients = [ModuleClient(name, Scripted(), 0) for name in "ab"]
    twins = [ModuleClient(name, Scripted(), 0) for name in "ab"]
    assert lost(ModuleGroup(clients), steps) == lost(Everyone(twins), steps)


def test_a_module_that_is_well_is_not_suspected():
    group, rng = scripted(3), random.Random(1)
    group.clear_checked()
    length, speed, now = 1.0, 0.0, 0
    for _ in range(200):
        now += 10_000
        before, speed = speed, speed + rng.uniform(-0.3, 0.3)  # 30 m/s2
        length += 0.005 * (before + speed)
        for client in group.clients:
            client.link.now += 0.01
            say(client, telemetry(now, length=length, speed=speed))
        assert group.suspects(np.ones(3, dtype=bool), np.full(3, 0.02), TTL_S) == []
    assert group.suspects(np.ones(3, dtype=bool), np.array([0.02, 0.26, 0.02]), TTL_S) == [1]
    group.clients[2].link.now += 0.3
    assert group.suspects(np.array([True, False, True]), np.full(3, 0.02), TTL_S) == [2]
    say(group.clients[0], telemetry(now + 10_000, length=length + 0.2, speed=speed))
    assert group.suspects(np.ones(3, dtype=bool), np.full(3, 0.02), TTL_S) == [0, 2]
    assert group.suspects(np.ones(3, dtype=bool), np.full(3, 0.02), TTL_S) == [0, 2], "until Python has checked it"


def test_silent_modules_are_observed_as_such():
    group = scripted(2)
    say(group.clients[1], telemetry(1, sequence=9, winding=55))
    group.clients[1].link.now += 0.5
    measured, codes = group.observe()
    np.testing.assert_array_equal(measured[:, 0], [np.nan, np.nan, np.nan, np.inf, np.nan, np.nan])
    np.testing.assert_array_equal(measured[:, 1], [1.0, 0.0, 2.0, 0.5, 55.0, 6.125])
    np.testing.assert_array_equal(codes.T, [[State.IDLE, 0, Limit.IDLE, -1, -1], [State.RUNNING, 0, 0, 0, 9]])


def test_a_group_owns_its_endpoints_whatever_becomes_of_the_list():
    endpoint = _native.Endpoint(0)
    before = sys.getrefcount(endpoint)
    endpoints = [endpoint]
    group = _native.EndpointGroup(endpoints)
    endpoints.clear()
    assert sys.getrefcount(endpoint) == before + 1
    assert group.observe([0.0], 0, 0)[0].shape == (6, 1)
    with pytest.raises(RuntimeError):
        _native.EndpointGroup([None])
