"""Who may open the page, and connect to it."""

import logging
import socket

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tensionlab.errors import InputError
from tensionlab.view.server import Gate, PageServer
from tests.support.browsers import HANGS_S, VISER

HOST = {"Host": "127.0.0.1:8080"}


def refused(gate, target="/", **headers):
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    return gate.refuse(target, lambda name: [given[name]] if name in given else [])


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
def test_a_page_of_this_machine_may_connect(host):
    assert refused(Gate(), Host=host) is None
    assert refused(Gate(), Host=host, Origin=f"http://{host}") is None


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "null", "file://"])
def test_a_page_of_another_origin_may_not(origin):
    assert "may not connect" in refused(Gate(), Host="127.0.0.1:8080", Origin=origin)
    assert "may not connect" in refused(Gate("secret"), "/?token=secret", Host="127.0.0.1:8080", Origin=origin)


def test_a_name_that_leads_here_is_not_this_machine():
    reason = refused(Gate(), Host="evil.example:8080", Origin="http://evil.example:8080")
    assert reason == "the host 'evil.example:8080' is not this machine; open 127.0.0.1"


def test_no_other_site_loads_the_page_as_an_image():
    assert "may not load" in refused(Gate(), Host="127.0.0.1:8080", Sec_Fetch_Site="cross-site")
    assert refused(Gate(), Host="127.0.0.1:8080", Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate") is None


def test_beyond_this_machine_the_token_is_needed():
    gate = Gate("secret")
    assert "token" in refused(gate, Host="lab:8080")
    assert "token" in refused(gate, "/?token=wrong", Host="lab:8080")
    assert "token" in refused(gate, Host="127.0.0.1:8080")
    assert refused(gate, "/?token=secret", Host="lab:8080") is None
    assert refused(gate, Host="lab:8080", Cookie="other=1; tensionlab-view-8080=secret") is None
    assert "token" in refused(gate, Host="lab:8080", Cookie="tensionlab-view-9090=secret")  # of another page


def test_only_who_knows_the_address_for_frames_shows_the_page_in_one():
    gate = Gate()
    for target in ("/", "/?frame=", "/?frame=wrong", f"/?other={gate.frame}"):
        assert "frame-ancestors 'self'" in gate.headers(target)["Content-Security-Policy"]
    assert "frame-ancestors *" in gate.headers(f"/?frame={gate.frame}")["Content-Security-Policy"]
    assert Gate().frame != gate.frame


def test_the_token_leaves_the_address():
    headers = {"Host": "lab:8080"}
    answer = Gate("secret").forward("/?token=secret", lambda name: [headers[name]])
    assert answer == {
        "Location": "/",
        "Set-Cookie": "tensionlab-view-8080=secret; HttpOnly; SameSite=Strict; Path=/",
    }
    assert Gate("secret").forward("/", lambda name: [headers[name]]) is None
    assert Gate().forward("/?token=secret", lambda name: [headers[name]]) is None


@pytest.mark.parametrize("host", ["no.such.host.invalid", "192.0.2.1", "a..b"])
def test_an_address_at_which_nothing_can_listen_is_refused(host):
    with pytest.raises(InputError, match="cannot be served at"):
        PageServer(host)


def test_a_port_that_is_taken_is_refused():
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} "):
            PageServer(port=port)


@pytest.mark.realtime  # a real server
def test_pages_of_others_are_refused_and_garbage_leaves_no_traceback(caplog):
    server = PageServer()
    url = server.url.replace("http", "ws")
    with caplog.at_level(logging.DEBUG):
        with connect(url, origin=server.url.rstrip("/"), subprotocols=[VISER]) as own:
            assert own.recv(timeout=HANGS_S)
        for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
            with pytest.raises(InvalidStatus, match="403"):
                connect(url, additional_headers=headers, subprotocols=[VISER])
        for content in (b"", b"GARBAGE\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", server.viser.get_port()), timeout=HANGS_S) as caller:
                caller.sendall(content)
                caller.shutdown(socket.SHUT_WR)
                while caller.recv(1000):
                    pass
        server.close()
    assert [each for each in caplog.records if each.levelno >= logging.WARNING] == []
