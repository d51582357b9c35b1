"""The server of a page: where it listens, and whom it refuses."""

import logging
import socket
import stat
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tensionlab.errors import InputError
from tensionlab.viewer.server import PageServer
from tests.helpers.browsers import HANGS_S, VISER, chromium, needs_browser, served, until
from tests.helpers.page_client import joined


@pytest.mark.parametrize("host", ["no.such.host.invalid", "192.0.2.1", "a..b"])
def test_an_address_at_which_nothing_can_listen_is_refused(host):
    with pytest.raises(InputError, match="cannot be served at"):
        PageServer(host)


def test_a_port_that_is_taken_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} "):
            PageServer(port=port)


@pytest.mark.realtime  # a real server
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


@pytest.mark.slow
@needs_browser
@pytest.mark.realtime  # a real browser
def test_that_file_leads_a_browser_to_the_page(tmp_path, monkeypatch):
    called = []
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr("webbrowser.open", called.append)
    with served() as page, chromium() as browser:
        page.server.open_browser()
        tab = browser.new_page()
        tab.set_default_timeout(1000.0 * HANGS_S)
        tab.goto(called[0])
        tab.get_by_text("capacity margin", exact=True).wait_for()


@pytest.mark.realtime  # a real server
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
