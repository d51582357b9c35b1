"""Where a page listens, who may connect and which messages pass, as a hostile client has to find out."""

import logging
import socket
import stat
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import parse_qs, urlsplit

import msgspec
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tensionlab.errors import InputError
from tensionlab.viewer.server import MAX_MESSAGE_BYTES, MAX_TEXT, Gate, PageServer, can_have
from tensionlab.viewer.state import HAND, set_fields
from tests.helpers.browsers import HANGS_S, VISER, served, until
from tests.helpers.page_client import joined

TOKEN, HERE = "/?token=secret", "127.0.0.1:8080"


def refused(gate, target="/", **headers):
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    return gate.refuse(target, lambda name: [given[name]] if name in given else [])


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
@pytest.mark.parametrize("local", [True, False])
def test_the_token_is_needed_on_this_machine_too(host, local):
    gate = Gate("secret", local=local)
    for target in ("/", "/?token=", "/?token=wrong", "/stop", "/?websocket=secret"):
        assert "the token is missing or wrong" in refused(gate, target, Host=host)
    assert "token" in refused(gate, Host=host, Cookie="token=secret; tensionlab-view-8080=secret")
    assert refused(gate, TOKEN, Host=host) is None
    assert refused(gate, TOKEN, Host=host, Origin=f"http://{host}") is None


def test_other_origins_names_and_sites_are_refused_with_the_token_too():
    for origin in ("http://evil.example", "http://127.0.0.1:9999", "null", "file://"):
        for local in (True, False):
            assert "may not connect" in refused(Gate("secret", local=local), TOKEN, Host=HERE, Origin=origin)
    evil = {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}
    message = "the host 'evil.example:8080' is not this machine; open 127.0.0.1"
    assert refused(Gate("secret"), TOKEN, **evil) == message
    assert refused(Gate("secret", local=False), TOKEN, **evil) is None  # served to others, by their name for it
    assert "may not load" in refused(Gate("secret"), TOKEN, Host=HERE, Sec_Fetch_Site="cross-site")
    navigates = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate"}
    assert refused(Gate("secret"), TOKEN, Host=HERE, **navigates) is None


def test_the_page_connects_with_the_token():
    there = Gate("secret").redirect(TOKEN, lambda name: [HERE])
    assert parse_qs(urlsplit(there).query) == {"token": ["secret"], "websocket": [f"ws://{HERE}/?token=secret"]}
    assert Gate("secret").redirect(there, lambda name: [HERE]) is None


CHOICE = SimpleNamespace(value="newton", options=("newton", "minimax"))
NUMBER = SimpleNamespace(value=1.0, min=0.0, max=2.0)
VECTOR, TEXT, BOX = (SimpleNamespace(value=value) for value in ((0.0, 0.0, 0.0), "", True))


@pytest.mark.parametrize(
    ("element", "values", "others"),
    [
        (CHOICE, ("minimax",), ("my_solver:Solver", "", True, 0.0, ["newton"])),
        (NUMBER, (0.0, 2.0, 1), (-0.1, 2.1, "1", True, [1.0])),
        (VECTOR, ([1.0, 2.0, 3.0],), ([1.0, 2.0], [], 1.0, "123")),
        (TEXT, ("a",), (1.0, True, [1.0])),
        (BOX, (True, False), (1.0, "yes")),
        (SimpleNamespace(value=object()), (), (True, 1.0, "")),
    ],
)
def test_an_element_has_values_of_its_kind_only(element, values, others):
    assert all(can_have(element, value) for value in values)
    assert not any(can_have(element, value) for value in others)


def hostile_messages(panel):
    """Messages that must not pass, of one who has the token."""

    def update(element, **attributes):
        return {"type": "GuiUpdateMessage", "uuid": element._impl.uuid, "updates": attributes}

    transfer = {"source_component_uuid": panel._solver._impl.uuid, "transfer_uuid": "mine"}
    about = {"filename": "x", "mime_type": "text/plain", "part_count": 2, "size_bytes": 10}
    upload = {"type": "FileTransferStartUpload", **transfer, **about}
    part = {"type": "FileTransferPart", **transfer, "part_index": 0, "content": b"12345"}
    pose = {"type": "TransformControlsUpdateMessage", "name": "/nowhere", "owner": "", "position": [0, 0, 0]}
    yield update(panel._solver, value="evil_solver:Solver")
    for name in ("update_cb", "sync_cb", "gui_api", "props", "uuid", "is_button", "removed"):
        yield update(panel._solver, **{name: []})
        yield update(panel._solver, **{name: [], "value": "minimax"})
    for value in ([1.0], [1.0] * 4, [], ["a", "b", "c"], [float("nan")] * 3, [1e300] * 3, "1", {"a": 1}, None):
        yield update(panel._position, value=value)
    for value in (float("nan"), float("inf"), -1.0, "1", [1.0], True):
        yield update(panel._grid, value=value)
    yield update(panel._file, value="x" * (MAX_TEXT + 1))
    yield {"type": "GuiUpdateMessage", "uuid": panel._solver._impl.uuid}
    others = ({"type": name} for name in ("ShareUrlRequest", "ResetGuiMessage", "NoSuch"))
    yield from (upload, part, *others, {}, [], 7)
    yield pose | {"wxyz": [1, 0, 0, 0]}
    yield pose | {"wxyz": [1, 0, 0, 0], "name": "/handle", "owner": "other"}
    yield pose | {"wxyz": [1, 0, 0], "name": "/handle"}
    yield from (b"", b"\xc1", b"\x91" * 8000, b"\x81\xa4type\xd9\xff")
    passed = msgspec.msgpack.encode(update(panel._solver, value="minimax"))
    yield b"\x84" + passed[1:] + msgspec.msgpack.encode("type") + msgspec.msgpack.encode("ShareUrlRequest")


def test_messages_of_a_hostile_client_with_the_token_change_nothing(tmp_path, monkeypatch):
    (tmp_path / "evil_solver.py").write_text("raise SystemExit('this must not run')\n")
    monkeypatch.chdir(tmp_path)
    with served() as page, joined(page.server.url) as client:
        panel, before = page._panel, page.state
        callbacks = list(panel._solver._impl.update_cb)
        for message in hostile_messages(panel):
            client.send(message)
        client.update(panel._position, value=[0, 0.5, 0])  # what a browser may send still has its effect
        until(lambda: page.state.position.tolist() == [0.0, 0.5, 0.0], "the edit")
        assert (page.state.rig, page.state.solver, page.state.grid_m) == (before.rig, before.solver, before.grid_m)
        assert "evil_solver" not in sys.modules
        assert panel._solver._impl.update_cb == callbacks
        assert page.server.viser.gui._current_file_upload_states == {}
        client.update(panel._solver, value="minimax")
        until(lambda: page.state.solver == "minimax", "the choice")


def test_a_message_that_is_too_long_ends_its_connection_alone():
    with served() as page, joined(page.server.url) as client:
        with joined(page.server.url) as other:
            other.send(b"\0" * (MAX_MESSAGE_BYTES + 1))
            with pytest.raises(ConnectionClosed, match="too big"):
                all(other.socket)
        client.update(page._panel._position, value=[0, 0.5, 0])
        until(lambda: page.state.position[1] == 0.5, "the edit")


def test_nothing_is_saved_or_read_outside_the_folder_in_which_the_page_was_started(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "secret.toml").write_text("password = 'abc'\n")
    monkeypatch.chdir(tmp_path / "here")
    with served() as page, joined(page.server.url) as client:
        panel = page._panel
        for path in (f"{tmp_path}/mine.toml", "../mine.toml", "../secret.toml"):
            said = f"{path}: the page was started in"
            page._panel.save(path)
            until(lambda said=said: said in panel._problem.content, "the refusal to write")
            page.edit(lambda state: state)
            until(lambda: not panel._problem.content, "the end of the notice")
            client.update(panel._space, value=path)  # none of its options
        client.update(panel._position, value=[0, 0.5, 0])
        until(lambda: page.state.position[1] == 0.5, "the edit after it")
        assert page.state.task is None
        assert "abc" not in panel._problem.content
        assert (tmp_path / "secret.toml").read_text() == "password = 'abc'\n"
        assert sorted(each.name for each in tmp_path.iterdir()) == ["here", "secret.toml"]


def test_the_page_outlives_edits_that_fail_and_states_that_cannot_be_shown():
    with served("cogiro") as page:
        before = page.state

        def breaks(state):
            raise ValueError("operands could not be broadcast together")

        page.edit(breaks)
        until(lambda: "operands could not be broadcast" in page._panel._problem.content, "the reason")
        page.edit(lambda state: None)
        until(lambda: "AttributeError" in page._panel._problem.content, "the reason")
        page.edit(lambda state: replace(state, position=np.zeros(2)))
        until(lambda: "ValueError" in page._panel._problem.content, "the reason")
        assert page.state is before
        with joined(page.server.url) as client:
            page.edit(set_fields(selected=HAND))
            until(lambda: page._drawing._gizmo_at == HAND, "the handle")
            pose = {"name": "/handle", "owner": "", "position": [0, 0, 0], "wxyz": [0, 0, 0, 0]}
            client.send({"type": "TransformControlsUpdateMessage", **pose})  # no rotation
            until(lambda: "zero norm" in page._panel._problem.content, "what is wrong with it")
            assert np.isfinite(page.state.rotation).all()
            pose |= {"position": [0, 0, 0.5], "wxyz": [1, 0, 0, 0]}
            client.send({"type": "TransformControlsUpdateMessage", **pose})
            until(lambda: page.state.position.tolist() == [0.0, 0.0, 0.5], "a pose after it")


def test_an_address_at_which_nothing_can_listen_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for host in ("127.0.0.1", "no.such.host.invalid", "192.0.2.1", "a..b"):
            with pytest.raises(InputError, match=f"cannot be served at {host}, port {port} "):
                PageServer(host, port)


def test_a_browser_is_opened_without_its_call_telling_the_token(tmp_path, monkeypatch):
    called = []
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr("webbrowser.open", called.append)
    server = PageServer()
    server.open_browser()
    [file] = tmp_path.iterdir()
    assert called == [file.as_uri()]
    assert server.gate.token not in called[0]
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert f"url={server.url}" in file.read_text()
    with joined(server.url):
        until(lambda: not list(tmp_path.iterdir()), "the end of the file")
    server.open_browser()
    server.close()
    assert not list(tmp_path.iterdir())


def test_pages_of_others_are_refused_and_garbage_leaves_no_traceback(caplog):
    server = PageServer()
    url, origin = server.url.replace("http", "ws"), server.url.partition("/?")[0]
    with caplog.at_level(logging.DEBUG):
        with connect(url, origin=origin, subprotocols=[VISER]) as own:
            assert own.recv(timeout=HANGS_S)
        for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
            with pytest.raises(InvalidStatus, match="403"):
                connect(url, additional_headers=headers, subprotocols=[VISER])
        for target in ("/", "/?token=wrong", "/?websocket=1"):
            with pytest.raises(InvalidStatus, match="403"):
                connect(url.partition("/?")[0] + target, subprotocols=[VISER])
        for content in (b"", b"GARBAGE\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", server.viser.get_port()), timeout=HANGS_S) as caller:
                caller.sendall(content)
                caller.shutdown(socket.SHUT_WR)
                while caller.recv(1000):
                    pass
        server.close()
    assert [each for each in caplog.records if each.levelno >= logging.WARNING] == []
