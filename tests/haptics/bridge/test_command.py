"""One client commands at a time, by WebSocket or OSC, and within its budget."""

import pytest
from pythonosc.osc_message_builder import build_msg

from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.command import (
    BYTES_AT_ONCE,
    BYTES_PER_S,
    MAX_LINES,
    REPORT_S,
    SILENCE_S,
    Budget,
    FrameRefused,
    LimitedReport,
)
from tensionlab.haptics.bridge.messages import Frame
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.effects import Plane
from tests.helpers.runs import four

FRAME = Frame.model_validate({"time": 0.0, "bodies": {"hand": {"position": [0.0, 0.31, 0.0]}}})
PULL = build_msg("/effect/pull", ["spring", "centre", 0.0, 0.36, 0.0, "stiffness", 20.0]).dgram
STOP = build_msg("/stop", []).dgram


@pytest.fixture
def box():
    return ClientState(four())


@pytest.fixture
def door(box):
    """OSC, without its thread: the test hands it datagrams. What it reports is in `said`."""
    said = []
    opened = OscServer(box, "127.0.0.1", 0, said.append)
    opened.said = said
    yield opened
    opened._socket.close()


def test_a_second_one_waits_until_the_first_has_gone_or_been_silent(box):
    reasons = []
    first = box.command.take("first", 0.0, reasons.append)
    with pytest.raises(
        FrameRefused, match="another client commands; watch at /events, or wait until first has gone"
    ):
        box.command.take("second", SILENCE_S - 0.1, reasons.append)
    box.put(FRAME, 3.0, first)
    with pytest.raises(FrameRefused):
        box.command.take("second", SILENCE_S + 1.0, reasons.append)
    second = box.command.take("second", 3.0 + SILENCE_S, reasons.append)
    assert reasons == ["silent for 5 s: second commands now"]
    with pytest.raises(FrameRefused, match="silent for 5 s"):
        box.put(FRAME, 9.0, first)
    box.command.leave(second)
    box.command.take("third", 9.0, reasons.append)


def test_the_next_client_begins_anew(box):
    first = box.command.take("first", 0.0, print)
    box.put(Frame.model_validate({"time": 0.0, "effects": {"a": {"kind": "viscous"}}}), 0.0, first)
    assert set(box.effects) == {"a"}
    box.command.leave(first)
    box.put(FRAME, 1.0, box.command.take("second", 1.0, print))
    assert not box.effects


def test_osc_sets_no_force_while_another_client_commands(box, door):
    first = box.command.take("first", 0.0, print)
    door._take(PULL, "127.0.0.1", 1.0)
    door._take(STOP, "127.0.0.1", 1.0)
    assert not box.effects
    assert not box.stop_requested
    assert door.said == [
        "OSC from 127.0.0.1: another client commands; watch at /events, or wait until first has gone or "
        "been silent for 5 s"
    ]
    box.command.leave(first)
    door._take(PULL, "127.0.0.1", 2.0)
    assert set(box.effects) == {"pull"}
    with pytest.raises(FrameRefused):
        box.command.take("third", 3.0, print)
    door._take(PULL, "127.0.0.2", 3.0)
    assert box.count == 1


def test_an_unknown_address_or_a_bad_message_changes_nothing(box, door):
    door._take(PULL, "127.0.0.1", 0.0)
    bad = [
        build_msg("/nowhere", [1.0]),
        build_msg("/effect/pull", ["spring", "centre", 0.0, 0.0]),
        build_msg("/effect/pull", ["spring", 3.0]),
        build_msg("/effect/pull", [2.0]),
        build_msg("/body/hand", [0.0, 0.0]),
        build_msg("/body/tail", [0.0, 0.0, 0.0]),
    ]
    for message in bad:
        door._take(message.dgram, "127.0.0.1", 1.0)
    for _ in range(3000):
        door._take(b"garbage", "127.0.0.1", 1.0)
    assert set(box.effects) == {"pull"}
    assert box.count == 1
    assert len(door.said) == len(bad) + 1, "each reason once"
    assert any("no address '/nowhere'" in line for line in door.said)
    assert any("'pull': centre is (0.0, 0.0); give 3 components" in line for line in door.said)
    assert any("no body 'tail'; there are: hand" in line for line in door.said)
    door._report.finish()
    assert door.said[-1] == "2999 more such lines"
    box.put(FRAME, 2.0, door._commander)


def test_a_wall_is_placed_over_osc_by_names_with_dots(box, door):
    floor = ["wall", "plane.point", 0.0, 0.25, 0.0, "plane.normal", 0.0, 1.0, 0.0, "stiffness", 100.0]
    door._take(build_msg("/effect/floor", floor).dgram, "127.0.0.1", 0.0)
    assert box.effects["floor"].plane == Plane((0.0, 0.25, 0.0), (0.0, 1.0, 0.0))
    assert box.effects["floor"].stiffness == 100.0
    solid = ["shaped", "field.kind", "box", "field.size", 0.1, 0.2, 0.3, "coupling.stiffness", 200.0]
    door._take(build_msg("/effect/crate", solid).dgram, "127.0.0.1", 0.1)
    assert box.effects["crate"].field.size == pytest.approx((0.1, 0.2, 0.3))
    assert box.effects["crate"].coupling.stiffness == 200.0
    for wrong in (["wall", "plane", 1.0, "plane.point", 0.0, 0.0, 0.0], ["wall", "plane.pint", 0.0]):
        door._take(build_msg("/effect/floor", wrong).dgram, "127.0.0.1", 0.2)
    assert "'floor': plane.point: plane has a value; give that or its parts" in door.said[0]
    assert "plane.pint is an unknown key; did you mean" in door.said[1]


def test_who_was_sent_away_stays_away_until_a_silence(box, door):
    door._take(PULL, "127.0.0.1", 0.0)
    box.dismiss("it failed")
    assert not box.effects
    for now in (1.0, 5.0, 9.0):
        door._take(PULL, "127.0.0.1", now)
    assert not box.effects
    assert door.said == ["OSC from 127.0.0.1: it failed"]
    door._take(PULL, "127.0.0.1", 9.0 + SILENCE_S)
    assert set(box.effects) == {"pull"}


@pytest.mark.parametrize(("off", "said"), [(0.0, "lies on the anchor"), (1e-4, "has a cable of no length")])
def test_a_hand_at_an_anchor_is_refused(box, off, said):
    frame = Frame.model_validate({"time": 0.0, "bodies": {"hand": {"position": four().modules[0].anchor + off}}})
    with pytest.raises(FrameRefused, match=said):
        box.put(frame, 0.0)
    assert box.count == 0


def refused(size, rate, work=0.0, seconds=10.0):
    """Return the share of messages of a size, rate and reading time that is refused, and the last reason."""
    budget, reasons = Budget(), []
    for number in range(int(rate * seconds)):
        why = budget.refuse(size, number / rate)
        reasons.append(why)
        if not why:
            budget.add_reading(work, number / rate)
    return sum(map(bool, reasons)) / len(reasons), reasons[-1]


@pytest.mark.parametrize(
    ("size", "rate", "work", "said"),
    [
        (100, 1000.0, 0.0, "a flood: at most 500 messages a second"),
        (60_000, 450.0, 0.0, "too many bytes: at most 1000 kB a second"),
        (100, 100.0, 0.01, "too much to read: at most 20 % of a processor's time"),
    ],
)
def test_too_much_is_refused_with_the_reason(size, rate, work, said):
    share, why = refused(size, rate, work)
    assert share > 0.3
    assert why in (said, "")
    assert said in {refused(size, rate, work, seconds)[1] for seconds in (9.7, 9.8, 9.9, 10.0)}


def test_a_pause_restores_the_budget():
    budget = Budget()
    while not budget.refuse(60_000, 0.0):
        pass
    for _ in range(1000):
        budget.refuse(60_000, 0.0)
    assert budget.refuse(100, 0.1)
    assert not budget.refuse(100, 2.0 * BYTES_AT_ONCE / BYTES_PER_S)


def test_a_repeated_line_is_reported_once_in_5_s_and_counted():
    lines, now = [], [0.0]
    report = LimitedReport(lines.append, lambda: now[0])
    for _ in range(450):
        report("a")
        now[0] += REPORT_S / 450.5
    report("b")
    now[0] += 1.0
    report("a")
    assert lines == ["a", "b", "449 more such lines", "a"]
    report.finish()
    assert lines[4:] == []
    for number in range(100):
        report(f"a: {number}")
    assert len(lines) == 4 + MAX_LINES
