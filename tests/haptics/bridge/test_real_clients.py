"""The bridge in a process of its own, with real clients: in Python, in a browser, over OSC; by the wall clock."""

import json
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from pythonosc.udp_client import SimpleUDPClient
from websockets.sync.client import connect

from benchmarks.processes import process
from tensionlab.haptics.bridge.client import BridgeClient
from tests.haptics.bridge.test_bridge import FLOOR, HAND, RIG
from tools.site.browser import browser, installed

ROOT = Path(__file__).parents[3]
HANGS_S = 600.0  # only what hangs takes so long


@contextmanager
def served(*words, port=0):
    """A bridge in another process, to simulated modules; gives its URL, and the process."""
    with process("serve", RIG, "--port", port, *words) as running:
        first = running.stdout.readline()
        assert first.startswith("ws://"), running.stderr.read()
        assert running.stdout.readline().startswith("http://")
        yield first.split("/command")[0], running


@pytest.fixture(scope="module")
def bridge():
    with served() as (url, _):
        yield url


def until(wanted, act):
    """Act 90 times a second until the answer is the wanted one; that answer."""
    end = time.monotonic() + HANGS_S
    while not wanted(answer := act()):
        assert time.monotonic() < end, answer
        time.sleep(1.0 / 90.0)
    return answer


def test_the_python_example_runs(bridge):
    words = [sys.executable, ROOT / "examples/bridge/client.py", bridge, "0.5"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=HANGS_S, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(
        r"^largest measured force \d\.\d\d N, where \d\.\d\d N was desired$", done.stdout, re.MULTILINE
    )


def heard(watch, *kinds):
    """The next event of one of these kinds."""
    while (found := json.loads(watch.recv(timeout=HANGS_S))).get("kind") not in kinds:
        pass
    return found


def test_a_client_that_is_killed_leaves_no_force_behind(bridge):
    words = [sys.executable, ROOT / "examples/bridge/client.py", bridge, HANGS_S]
    with (
        connect(f"{bridge}/events", compression=None) as watch,
        subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL) as client,
    ):
        while heard(watch, "rate")["frames"] < 50.0:
            assert client.poll() is None
        client.kill()
        heard(watch, "silent")  # how soon: test_bridge.py


def test_the_osc_example_places_a_floor_and_a_stop_ends_the_run():
    with served("--osc", 0) as (url, running):
        port = int(running.stdout.readline().split()[-1])
        words = [sys.executable, str(ROOT / "examples/bridge/osc_client.py"), str(port), str(HANGS_S)]
        with connect(f"{url}/state", compression=None) as watch, subprocess.Popen(words) as client:
            while json.loads(watch.recv(timeout=HANGS_S)).get("desired", [0.0, 0.0])[1] < 0.5:
                assert client.poll() is None
            with SimpleUDPClient("127.0.0.1", port) as sender:
                until(
                    lambda status: status is not None, lambda: sender.send_message("/stop", []) or running.poll()
                )
            client.terminate()
        assert running.wait(HANGS_S) == 0


def test_ctrl_c_ends_the_run():
    with served() as (url, running):
        with connect(f"{url}/events", compression=None) as watch:
            heard(watch, "rate")  # it runs
            running.send_signal(signal.SIGINT)
            assert heard(watch, "ended")["text"] == "signal SIGINT"
        assert running.wait(HANGS_S) == 130


@pytest.mark.slow
@pytest.mark.skipif(installed() is None, reason="no Chromium here")
def test_the_state_page_shows_what_is_measured(bridge):
    with browser() as (page, seen):
        address = bridge.replace("ws:", "http:")
        page.goto(f"{address}/")
        shown = "document.getElementById('measured').textContent"
        with BridgeClient(bridge) as client:
            begin = time.monotonic()
            until(
                lambda text: re.match(r"(0\.9[5-9]|1\.0\d) N, \[0\.00, ", text),
                lambda: client.frame(time.monotonic() - begin, HAND, FLOOR) and page.evaluate(shown),
            )
        assert page.evaluate("document.querySelector('h1').textContent") == "bartels2026-validation"
        assert page.evaluate("document.getElementById('modules').rows.length") == 4
        assert "frames come: the force fades in" in page.evaluate("document.getElementById('events').textContent")
        assert [each for each in seen.requests if not each.startswith((address, "data:"))] == []
        assert seen.complaints == []
