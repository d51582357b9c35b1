"""The bridge and its clients on one simulated clock: `tensionlab serve` in this process, with the real codec."""

import asyncio
import json
import math
import re
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tensionlab.errors import HardwareError
from tensionlab.haptics.bridge.client import BridgeClient
from tensionlab.haptics.bridge.command import SILENCE_S
from tensionlab.haptics.bridge.messages import MAX_MESSAGE_BYTES, StopRun
from tensionlab.haptics.bridge.schema import schema_text
from tensionlab.haptics.bridge.server import MAX_REFUSED, REFUSAL_PAUSE_S
from tensionlab.hardware.log.reader import read_run
from tensionlab.model.files import load_rig
from tensionlab.scenarios import load_scenario
from tests.helpers.simulated_bridge import SimulatedServe

RIG = Path(__file__).parents[3] / "datasets/rigs/bartels2026-validation.toml"
FLOOR = {
    "floor": {"kind": "wall", "plane": {"point": [0.0, 0.32, 0.0], "normal": [0.0, 1.0, 0.0]}, "stiffness": 100.0}
}
HAND = (0.0, 0.31, 0.0)  # a cm below the floor: 1 N
CYCLE_S = 0.02
FRAMES_HZ = 90.0


@pytest.fixture
def serve(monkeypatch):
    """Serve the rig, or what is given, with some options."""
    return lambda *words, what=(RIG,): SimulatedServe((*what, "--port", 0, *words), monkeypatch)


@pytest.fixture
def bridge(serve):
    with serve() as served:
        yield served


def push(served, client, seconds, effects=FLOOR, hand=HAND):
    """Send frames for a while; the last state."""
    for _ in range(round(seconds * FRAMES_HZ)):
        state = client.frame(served.now, hand, effects)
        served.sleep(1.0 / FRAMES_HZ)
    return state


def floor_rendered(state):
    """Is 1 N up desired, and measured?"""
    return state.fresh == 1.0 and all(
        force == pytest.approx([0.0, 1.0, 0.0], abs=off)
        for force, off in ((state.desired, 0.01), (state.measured, 0.05))
    )


def test_what_is_desired_is_pulled(bridge):
    with BridgeClient(bridge.url) as client:
        assert client.welcome.rig == "bartels2026-validation"
        state = push(bridge, client, 1.0)
        assert floor_rendered(state)
        assert state.position == pytest.approx(HAND, abs=1e-3)
        assert state.rendering == [False, False, False, True]
        assert state.brakes == ["OPEN"] * 4
        assert state.delay == pytest.approx(CYCLE_S)
        assert state.ceiling == pytest.approx(1.0 / (0.01 + state.delay), rel=1e-3)
        assert push(bridge, client, 0.1, {}).desired == [0.0, 0.0, 0.0]


def heard(watch, kind):
    """The next event of a kind."""
    while (found := json.loads(watch.recv())).get("kind") != kind:
        pass
    return found


def test_a_client_that_falls_silent_has_no_force_within_the_timeout(bridge):
    with BridgeClient(bridge.url) as client, bridge.connect(f"{bridge.url}/events") as watch:
        timeout = json.loads(watch.recv())["timeout"]
        state = push(bridge, client, 1.0)
        assert floor_rendered(state)
        assert heard(watch, "silent")["time"] <= state.time + timeout + 2 * CYCLE_S
        # Asking again brings the force back, from nothing.
        assert client.frame(bridge.now, HAND).desired == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
        assert floor_rendered(push(bridge, client, 1.0))


BAD = [
    ('{"type": }', "not JSON: Expecting value"),
    (b"\x00\xff", "not JSON"),
    ("[" * 5000, "not JSON"),
    ("[1]", "the message is [1]; give a table"),
    ('{"type": "dance"}', "the message type is 'dance'; give one of frame, stop"),
    ('{"type": "frame"}', "time is missing"),
    *(
        (f'{{"type": "frame", "time": {rest}}}', said)
        for rest, said in (
            ("NaN", "not JSON, which has no NaN: give a finite number"),
            ("1e999", "time is inf; give a finite number"),
            ("1700000000000", "time is 1700000000000; give -1e+10 to 1e+10"),
            ('0, "sequence": 1.5', "sequence is 1.5; give a whole number"),
            ('0, "bodys": {}', "bodys is an unknown key; did you mean"),
            ('0, "bodies": {"hand": {"position": [1e9, 0, 0]}}', "position[0] is 1000000000.0; give 100"),
            ('0, "bodies": {"hand": {"position": [0, 0]}}', "has 2 numbers; give 3"),
            ('0, "bodies": {"head": {"position": [0, 0, 0]}}', "no body 'head'"),
            ('0, "effects": {"a": {}}', "kind is missing; give one of wall"),
            ('0, "effects": {"a": {"kind": "spring", "centre": [0, 0]}}', "give 3 components"),
        )
    ),
]  # messages that are refused, and what the reason has


def test_what_is_wrong_is_refused_with_a_reason_and_changes_nothing(bridge):
    with BridgeClient(bridge.url) as client:
        push(bridge, client, 1.0)  # the run begins when its cables are taut
        for content, reason in BAD:
            client._socket.send(content)
            with pytest.raises(HardwareError, match="the bridge refused") as caught:
                client._answer("state")
            assert reason in str(caught.value)
            assert floor_rendered(push(bridge, client, 0.1, None))  # its effects of before


def closed(line, answers=None):
    """Wait until the other side closes, and keep what it says; why it did."""
    answers = [] if answers is None else answers
    while True:
        try:
            answers.append(line.recv())
        except ConnectionClosed as gone:
            return gone.rcvd.code, gone.rcvd.reason


def test_what_is_too_large_ends_the_connection(bridge):
    with bridge.connect(f"{bridge.url}/command") as line:
        line.send("x" * (MAX_MESSAGE_BYTES + 1))
        assert closed(line)[0] == 1009


def test_a_flood_ends_the_connection_and_the_next_client_is_served(bridge):
    with bridge.connect(f"{bridge.url}/command") as line:
        with suppress(ConnectionClosed):
            for number in range(2000):
                line.send(json.dumps({"type": "frame", "time": number}))
        answers = []
        assert closed(line, answers) == (1008, "a flood: at most 500 messages a second")
        assert sum("a flood" in answer for answer in answers) == MAX_REFUSED
    with BridgeClient(bridge.url) as client:
        assert client.frame(0.0, HAND).type == "state"


def test_one_commands_and_others_watch(bridge):
    with BridgeClient(bridge.url):
        with pytest.raises(HardwareError, match="another client commands; watch at /events"):
            BridgeClient(bridge.url)
        with bridge.connect(f"{bridge.url}/events") as watch:
            assert json.loads(watch.recv())["type"] == "welcome"
            watch.send("{}")
            assert closed(watch) == (1008, "this stream is read only; command at /command")


@pytest.mark.parametrize(
    ("headers", "path", "status", "said"),
    [
        ({"Origin": "https://example.org"}, "/command", 403, "pages of 'https://example.org' may not connect"),
        ({"Origin": "http://localhost.example.org"}, "/state", 403, "may not connect"),
        ({"Origin": "null"}, "/command", 403, "may not connect"),  # of a file, or of a frame without rights
        ({"Origin": "http://127.0.0.1.example.org"}, "/", 403, "may not connect"),
        ({}, "/elsewhere", 404, "nothing is at '/elsewhere'"),
    ],
)
def test_foreign_pages_and_other_paths_are_refused(bridge, capsys, headers, path, status, said):
    with pytest.raises(InvalidStatus) as caught:
        bridge.connect(f"{bridge.url}{path}", additional_headers=headers)
    assert caught.value.response.status_code == status
    assert said in caught.value.response.body.decode()
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("path", ["/", "/schema.json", "/command", "/state"])
def test_a_foreign_name_that_leads_here_is_refused(bridge, path):
    """DNS rebinding: the page is of the same origin, by a foreign name for this machine."""
    port = urlsplit(bridge.url).port
    for host in (f"example.org:{port}", "127.0.0.1.example.org", "", "169.254.1.1"):
        status, _, text = get(bridge, path, host)
        assert status == 403, host
        assert "is not this machine" in text


def get(bridge, path, host=None, **headers):
    """Status, headers and text of what a browser gets."""
    port = urlsplit(bridge.url).port
    headers = {"Host": f"127.0.0.1:{port}" if host is None else host, **headers}
    lines = [f"GET {path} HTTP/1.1", *(f"{name}: {each}" for name, each in headers.items()), "", ""]

    async def ask():
        reader, writer = await asyncio.open_connection(sock=await bridge.loop.reach(port))
        writer.write("\r\n".join(lines).encode())
        answer = await reader.read()
        writer.close()
        return answer

    head, _, text = bridge.loop.run_until_complete(ask()).decode().partition("\r\n\r\n")
    status, *given = head.split("\r\n")
    return int(status.split()[1]), dict(line.split(": ", 1) for line in given), text


def test_a_browser_gets_a_page_that_loads_nothing_from_elsewhere_and_cannot_be_framed(bridge):
    status, headers, text = get(bridge, "/")
    assert status == 200
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert not re.findall(r"""(?:src|href)=["'](?!data:)|@import|https?://\w""", text)
    assert get(bridge, "/state")[0] == 426  # for a WebSocket


@pytest.mark.parametrize(("mode", "status"), [("no-cors", 403), ("navigate", 200)])
def test_other_pages_may_lead_here_but_not_load_what_is_here(bridge, mode, status):
    """As an image or a script, which have no origin; refusals come late, so that a page makes no flood of them."""
    begin = bridge.now
    assert get(bridge, "/schema.json", **{"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": mode})[0] == status
    assert bridge.now - begin >= (REFUSAL_PAUSE_S if status == 403 else 0.0)
    status, _, text = get(bridge, "/schema.json", **{"Sec-Fetch-Site": "same-origin", "Sec-Fetch-Mode": "cors"})
    assert (status, json.loads(text)) == (200, json.loads(schema_text(load_rig("bartels2026-validation"))))


def test_a_stream_of_states_goes_on_by_itself(bridge):
    bridge.sleep(1.0)  # the run begins when its cables are taut
    with bridge.connect(f"{bridge.url}/state") as watch:
        bridge.sleep(1.0)
        with BridgeClient(bridge.url) as client:
            push(bridge, client, 1.0)
        said = [json.loads(watch.recv()) for _ in range(25)]
        watch.send("{}")
        assert closed(watch) == (1008, "this stream is read only; command at /command")
    states = [each for each in said if each["type"] == "state"]
    assert np.diff([each["time"] for each in states[1:]]) == pytest.approx(0.1, abs=CYCLE_S)
    assert states[0]["fresh"] == 0.0
    assert states[-1]["fresh"] == 1.0


def test_who_comes_and_goes_is_a_line_and_an_event(bridge, capsys):
    with bridge.connect(f"{bridge.url}/events") as watch:
        with BridgeClient(bridge.url), suppress(HardwareError):
            BridgeClient(bridge.url)
        lines = [heard(watch, "client")["text"] for _ in range(4)]
    said = capsys.readouterr().err
    what = ("watches /events$", "commands$", "refused: another client commands; watch", "has gone$")
    for line, pattern in zip(lines, what, strict=True):
        assert re.search(rf"^127\.0\.0\.1, port \d+: {pattern}", line), line
        assert line in said


def test_a_client_without_the_token_is_refused(serve, tmp_path):
    file = tmp_path / "token"
    file.write_text("secret\n")
    with serve("--token-file", file) as bridge:
        for path in ("/command", "/command?token=wrong"):
            with pytest.raises(InvalidStatus) as caught:
                bridge.connect(bridge.url + path)
            assert caught.value.response.status_code == 401
        with bridge.connect(f"{bridge.url}/events?token=secret") as line:
            assert json.loads(line.recv())["type"] == "welcome"
        with BridgeClient(bridge.url, "secret") as client:
            assert client.frame(0.0).type == "state"


def test_a_token_is_needed_beyond_this_machine(serve, run, monkeypatch):
    status, _, err = run("serve", RIG, "--host", "0.0.0.0", "--port", 0)
    assert status == 2
    assert "give a token" in err
    monkeypatch.setenv("TENSIONLAB_BRIDGE_TOKEN", "secret")
    with serve("--host", "0.0.0.0", "--osc", 0) as bridge:
        with pytest.raises(InvalidStatus):
            bridge.connect(f"{bridge.url}/command")
        assert bridge.osc._socket.getsockname()[0] == "127.0.0.1"  # OSC knows no token


def test_a_token_file_without_a_token_is_refused(run, tmp_path):
    (tmp_path / "token").write_text("")
    status, _, err = run("serve", RIG, "--token-file", tmp_path / "token")
    assert (status, "is empty" in err) == (2, True)


def test_another_version_of_the_messages_is_refused(bridge, monkeypatch):
    monkeypatch.setattr("tensionlab.haptics.bridge.client.PROTOCOL", 1)
    with pytest.raises(HardwareError, match="the bridge has version 3 of the messages, this client 1"):
        BridgeClient(bridge.url)


def test_osc_does_the_same(serve, tmp_path):
    log = tmp_path / "osc.mcap"
    with serve("--osc", 0, "--log", log) as bridge, bridge.connect(f"{bridge.url}/events") as watch:
        bridge.send_osc("/effect/pull", "spring", "centre", 0.0, 0.36, 0.0, "stiffness", 20.0)
        for _ in range(90):
            bridge.send_osc("/body/hand", *HAND)
            bridge.sleep(1.0 / FRAMES_HZ)
        with pytest.raises(HardwareError, match="another client commands"):
            BridgeClient(bridge.url)
        bridge.send_osc("/nowhere", 1.0)
        assert "OSC from 127.0.0.1: no address '/nowhere'" in heard(watch, "refused")["text"]
        bridge.send_osc("/effect/pull", "spring", "center", 0.0, 0.36, 0.0)
        assert "'pull': center is an unknown key; did you mean" in heard(watch, "refused")["text"]
        bridge.send_osc("/stop")
        assert bridge.wait() == 0
    assert read_run(log).desired[-1] == pytest.approx([0.0, 1.0, 0.0], abs=0.02)


def test_a_client_that_commands_and_says_nothing_loses_its_place(bridge):
    with bridge.connect(f"{bridge.url}/command") as idle:
        begin = bridge.now
        assert closed(idle) == (1008, "silent for 5 s: no frame that could be taken")
        assert bridge.now - begin == pytest.approx(SILENCE_S, abs=1e-3)
    with BridgeClient(bridge.url) as client:
        assert client.frame(0.0, HAND).type == "state"


def test_a_stop_ends_the_run(bridge, capsys):
    with BridgeClient(bridge.url) as client:
        push(bridge, client, 0.3)
        client.send(StopRun())
        assert bridge.wait() == 0
        with pytest.raises(HardwareError, match="the bridge has gone: stopped by the demand"):
            client.frame(bridge.now, HAND)
    assert "finished: stopped by the demand" in " ".join(capsys.readouterr().out.split())


MATERIALS, PLAYED_S = load_scenario("materials"), 13.0  # the last of its phases begins at 12 s
# A hand that does not give way presses less deep than the scenario's: windings bear 3 N for long, not 6.
LIFT = np.array([0.0, 0.0, 0.005])


def test_a_client_drives_the_materials(serve):
    forces, rates = {}, []
    with (
        serve("--rate", 50, what=("--scenario", "materials")) as bridge,
        bridge.connect(f"{bridge.url}/events") as watch,
        BridgeClient(bridge.url) as client,
    ):
        assert client.welcome.scenario == "materials"
        for number in range(round(PLAYED_S * FRAMES_HZ)):
            hand = MATERIALS.person.script.position((number + 1) / FRAMES_HZ) + LIFT
            effects = None if number else {"hum": {"kind": "vibrating", "amplitude": 0.8}}
            state = client.frame(bridge.now, tuple(hand), effects, number)
            assert state.sequence == number
            for phase in MATERIALS.active_phases(state.time):
                force = max(math.hypot(*state.desired), any(state.rendering) * math.hypot(*state.measured))
                forces[phase.name] = max(forces.get(phase.name, 0.0), force)
            bridge.sleep(1.0 / FRAMES_HZ)
        for _ in range(int(PLAYED_S)):
            rates.append(heard(watch, "rate"))
    assert set(forces) == {phase.name for phase in MATERIALS.phases}
    assert min(forces.values()) > 0.3
    assert [rate["cycles"] for rate in rates[1:-1]] == pytest.approx([50.0] * (len(rates) - 2))
    assert [rate["frames"] for rate in rates[1:-1]] == pytest.approx([FRAMES_HZ] * (len(rates) - 2), abs=1.0)
