"""Another user of this machine against a page: nothing is read, changed or kept from working."""

import encodings.idna  # noqa: F401 - the other user may not read it
import http.client
import os
import socket
from pathlib import Path

import pytest

from tensionlab.viewer.server import MAX_WAITING
from tests.helpers.browsers import HANGS_S, VISER, served, until
from tests.helpers.other_user import as_nobody, needs_root
from tests.helpers.page_client import joined

IDLE = 150  # connections that the other user opens and leaves
SOCKET = {
    "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Protocol": VISER,
}  # fmt: skip
TARGETS = ("/", "/index.html", "/stop", "/?token=", f"/?token={22 * 'A'}", "/stop?token=x", "/?websocket=x")


def requested(port, target, headers):
    """The status and the content that a request gets."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=HANGS_S)
    connection.request("GET", target, headers=headers)
    with connection.getresponse() as response:
        return response.status, response.read().decode()


def seen_of_processes():
    """All that another user's processes show of themselves: their calls and environments."""
    seen = []
    for folder in Path("/proc").glob("[0-9]*"):
        for name in ("cmdline", "environ"):
            try:
                seen.append((folder / name).read_bytes())
            except OSError:
                continue
    return b"\n".join(seen).decode(errors="replace")


@needs_root
@pytest.mark.realtime  # a real server, and a process of another user
def test_another_user_reads_nothing_changes_nothing_and_keeps_nothing_from_working(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stops = []
    with served() as page:
        page.server.gate.stop = lambda: (True, stops.append("stop") or "STOPPED")
        port, token, before, owner = page.server.viser.get_port(), page.server.gate.token, page.state, os.getpid()

        def attack():
            answers = [
                requested(port, target, headers)
                for target in TARGETS
                for headers in ({}, SOCKET, {"Cookie": "token=x"}, {"Authorization": "Bearer x"})
            ]
            held = []
            for content in (b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1", b"\0" * 1000):
                for _ in range(IDLE):
                    held.append(socket.create_connection(("127.0.0.1", port), timeout=HANGS_S))
                    held[-1].sendall(content)
            try:
                os.kill(owner, 0)
                signalled = True
            except PermissionError:
                signalled = False
            return {"answers": answers, "signalled": signalled, "seen": token in seen_of_processes()}, held

        with as_nobody(attack) as found:
            assert {status for status, _ in found["answers"]} == {403}
            assert all(text.startswith("the token is missing or wrong") for _, text in found["answers"])
            assert (found["signalled"], found["seen"]) == (False, False)
            assert page.state is before
            assert stops == []
            with joined(page.server.url) as client:  # while the other user's connections are open
                client.update(page._panel._position, value=[0, 0.5, 0])
                until(lambda: page.state.position[1] == 0.5, "the owner's edit")
            assert len(page.server.gate.waiting) <= MAX_WAITING < 3 * IDLE
            assert requested(port, f"/stop?token={token}", {}) == (200, "STOPPED\n")
    assert stops == ["stop"]
    assert list(tmp_path.iterdir()) == []
