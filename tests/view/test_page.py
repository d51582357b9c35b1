"""The design page in real browsers, with real drags and clicks."""

import subprocess
import sys

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import tensionlab as tl
from tensionlab.view.drawing import Grab
from tensionlab.view.page import dragged, on_plane
from tensionlab.view.state import HAND, begin
from tests.support.browsers import HANGS_S, Tab, chromium, needs_browser, served, until

VISER = "viser-v1.1.1"


def test_a_drag_in_the_plane_stays_in_it():
    state = begin(tl.load_rig("kntu-planar"))
    place, eye = np.array([0.3, 0.2, 0.5]), np.array([0.0, 0.0, 5.0])
    moved = dragged(state, Grab(HAND, "update", place, eye))
    assert moved.position == pytest.approx([1 / 3, 2 / 9], abs=1e-4)
    level = np.array([1.0, 0.0, 5.0])
    assert on_plane(eye, level).tolist() == level.tolist()  # a ray that never meets it


@pytest.mark.slow
@needs_browser
@pytest.mark.realtime  # a real browser
def test_what_is_dragged_is_designed_saved_and_undone(tmp_path):
    with chromium() as browser, served() as page:
        tab = Tab(browser, page)
        anchor = page.state.anchors[0]
        goal = np.add(anchor, [0.15, 0.0, 0.25])
        tab.drag(anchor, goal)
        until(lambda: page.state.anchors[0].tolist() != anchor.tolist(), "the drag")
        tab.settle()
        moved = page.state.anchors[0]
        assert tab.pixel(moved) == pytest.approx(tab.pixel(goal), abs=4.0)  # under the mouse
        tab.click_tab("File")
        file = tmp_path / "dragged.toml"
        tab.enter("file", str(file))
        tab.press("Save")
        until(file.exists, "the file")
        assert tl.load_rig(file).anchors[0] == pytest.approx(moved)
        tab.press("Undo")
        until(lambda: page.state.anchors[0].tolist() == anchor.tolist(), "the undo")
        assert not page.history.can_undo


@pytest.mark.slow
@needs_browser
@pytest.mark.realtime  # two real browsers
def test_all_browsers_show_one_state_and_one_that_is_closed_harms_nothing():
    with chromium() as browser, served() as page:
        one, other = Tab(browser, page), Tab(browser, page)
        one.drag(page.state.position, np.add(page.state.position, [0.0, 2.6, 0.0]))
        for tab in (one, other):
            tab.wait_for("NEAREST")  # the hand is out of reach
        one.tab.close()
        until(lambda: len(page.server.viser.get_clients()) == 1, "the end of a browser")
        other.press("Undo")
        other.wait_for("EXACT")
        assert page.state.position.tolist() == page.state.rig.home.tolist()


@pytest.mark.slow
@needs_browser
@pytest.mark.realtime  # a real browser
def test_nothing_comes_from_elsewhere():
    with chromium() as browser, served() as page:
        tab = Tab(browser, page)
        tab.wait_for("EXACT")
        assert tab.requests
        assert [each for each in tab.requests if not each.startswith((page.server.url, "blob:", "data:"))] == []
        assert tab.errors == []


@pytest.mark.realtime  # a real server
def test_a_websocket_of_another_page_is_refused():
    with served() as page:
        url = page.server.url.replace("http", "ws")
        with connect(url, origin=page.server.url.rstrip("/"), subprotocols=[VISER]) as own:
            assert own.recv(timeout=HANGS_S)
        for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
            with pytest.raises(InvalidStatus, match="403"):
                connect(url, additional_headers=headers, subprotocols=[VISER])


@pytest.mark.realtime  # a real server
def test_beyond_this_machine_nobody_connects_without_the_token():
    with served(host="0.0.0.0") as page:
        port = page.server.viser.get_port()
        url, token = f"ws://127.0.0.1:{port}/", page.server.url.partition("=")[2]
        assert len(token) > 16
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, subprotocols=[VISER])
        cookie = {"Cookie": f"tensionlab-view-{port}={token}"}
        with connect(url, additional_headers=cookie, subprotocols=[VISER]) as own:
            assert own.recv(timeout=HANGS_S)


@needs_browser
@pytest.mark.slow
@pytest.mark.realtime  # a real browser
def test_a_browser_gets_in_by_the_address_with_the_token():
    with chromium() as browser, served(host="0.0.0.0") as page:
        port, token = page.server.viser.get_port(), page.server.url.partition("=")[2]
        page.server.url = f"http://localhost:{port}/?token={token}"
        tab = Tab(browser, page)
        tab.wait_for("EXACT")
        assert tab.tab.url == f"http://localhost:{port}/"


@pytest.mark.realtime  # a process and a signal
def test_ctrl_c_ends_the_command_with_one_line():
    import signal

    words = [sys.executable, "-m", "tensionlab", "view", "bartels2026-validation", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        try:
            line = running.stdout.readline()
            assert line.startswith("http://127.0.0.1:"), running.stderr.read()
            running.send_signal(signal.SIGINT)
            out, err = running.communicate(timeout=HANGS_S)
        finally:
            running.kill()
    kept = "what was saved from the page is kept; the same command shows the file's rig again"
    assert (running.returncode, out, err) == (130, "", f"tensionlab: interrupted: {kept}\n")
