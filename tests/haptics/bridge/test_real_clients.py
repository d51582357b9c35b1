"""The bridge in a process of its own, with real clients: in Python, in a browser, over OSC; by the wall clock."""

import http.server
import json
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from pythonosc.udp_client import SimpleUDPClient
from websockets.sync.client import connect

from benchmarks.processes import process
from tensionlab.haptics.bridge.client import BridgeClient
from tensionlab.scenarios import load_scenario
from tests.haptics.bridge.test_schema import CLIENT
from tools.site.browser import browser, installed

ROOT = Path(__file__).parents[3]
RIG = ROOT / "datasets/rigs/bartels2026-validation.toml"
FLOOR = {
    "floor": {"kind": "wall", "plane": {"point": [0.0, 0.32, 0.0], "normal": [0.0, 1.0, 0.0]}, "stiffness": 100.0}
}
HAND = (0.0, 0.31, 0.0)  # a cm below the floor: 1 N
HANGS_S = 600.0  # only what hangs takes so long


@contextmanager
def served(*words, what=(RIG,)):
    """A bridge in another process, to simulated modules; gives its URL, and the process."""
    with process("serve", *what, "--port", 0, *words) as running:
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


@pytest.mark.realtime  # a server in another process, over TCP
def test_what_a_client_desires_is_pulled(bridge):
    with BridgeClient(bridge) as client:
        begin = time.monotonic()
        state = until(
            lambda state: state.measured == pytest.approx([0.0, 1.0, 0.0], abs=0.05),
            lambda: client.frame(time.monotonic() - begin, HAND, FLOOR),
        )
        assert state.desired == pytest.approx([0.0, 1.0, 0.0], abs=0.01)


@pytest.mark.realtime  # the example is a program
def test_the_python_example_runs(bridge):
    words = [sys.executable, ROOT / "examples/bridge/client.py", bridge, "0.5"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=HANGS_S, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(
        r"^largest measured force \d\.\d\d N, where \d\.\d\d N was desired$", done.stdout, re.MULTILINE
    )


@pytest.mark.realtime  # the example is a program, and OSC a thread in another process
def test_the_osc_example_places_a_floor():
    with served("--osc", 0) as (url, running):
        port = running.stdout.readline().split()[-1]
        words = [sys.executable, str(ROOT / "examples/bridge/osc_client.py"), port, str(HANGS_S)]
        with (
            connect(f"{url}/state", compression=None) as watch,
            subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as client,
        ):
            while json.loads(watch.recv(timeout=HANGS_S)).get("desired", [0.0, 0.0])[1] < 0.5:
                assert client.poll() is None, client.stderr.read()
            client.terminate()


def heard(watch, *kinds):
    """The next event of one of these kinds."""
    while (found := json.loads(watch.recv(timeout=HANGS_S))).get("kind") not in kinds:
        pass
    return found


@pytest.mark.realtime  # a client is killed with -9
def test_a_client_that_is_killed_leaves_no_force_behind(bridge):
    words = [sys.executable, ROOT / "examples/bridge/client.py", bridge, HANGS_S]
    with (
        connect(f"{bridge}/events", compression=None) as watch,
        subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL) as client,
    ):
        heard(watch, "fresh")
        client.kill()
        while heard(watch, "fresh", "silent")["kind"] != "silent":  # how soon: test_bridge.py
            pass


@pytest.mark.realtime  # OSC over UDP, and its thread, in another process
def test_osc_moves_the_hand_and_ends_the_run():
    with served("--osc", 0) as (url, running):
        port = int(running.stdout.readline().split()[-1])
        with SimpleUDPClient("127.0.0.1", port) as sender, connect(f"{url}/events", compression=None) as watch:
            begun = threading.Event()

            def send():
                while not begun.wait(1.0 / 90.0):
                    sender.send_message("/body/hand", list(HAND))

            thread = threading.Thread(target=send)
            thread.start()
            heard(watch, "fresh")
            begun.set()
            thread.join()
            until(lambda status: status is not None, lambda: sender.send_message("/stop", []) or running.poll())
        assert running.wait(HANGS_S) == 0


@pytest.mark.realtime  # a signal ends a process
def test_ctrl_c_ends_the_run():
    with served() as (url, running):
        with connect(f"{url}/events", compression=None) as watch:
            heard(watch, "rate")  # it runs
            running.send_signal(signal.SIGINT)
            assert heard(watch, "ended")["text"] == "signal SIGINT"
        assert running.wait(HANGS_S) == 130


BROWSER = installed()
QUIET = "--disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-sync"
MATERIALS = load_scenario("materials")
PLAN = {
    "felt": 2,
    "period": MATERIALS.seconds,
    "waypoints": [(each.time, list(each.position)) for each in MATERIALS.person.script.waypoints],
    "phases": [{"name": each.name, "begin": each.begin, "end": each.end} for each in MATERIALS.phases],
    "effects": {"hum": {"kind": "vibrating", "amplitude": 0.4}},
}  # how a page goes through the materials, until it has felt two of them


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
@pytest.mark.realtime  # a real browser
def test_the_state_page_shows_what_is_measured():
    with served() as (url, _), browser() as page:
        address = url.replace("ws:", "http:")
        page.open(f"{address}/")
        shown = "document.getElementById('measured').textContent"
        with BridgeClient(url) as client:
            begin = time.monotonic()
            until(
                lambda text: re.match(r"(0\.9[5-9]|1\.0\d) N, \[0\.00, ", text),
                lambda: client.frame(time.monotonic() - begin, HAND, FLOOR) and page.ask(shown),
            )
        assert page.ask("document.querySelector('h1').textContent") == "bartels2026-validation"
        assert page.ask("document.getElementById('modules').rows.length") == 4
        assert "frames come: the force fades in" in page.ask("document.getElementById('events').textContent")
        assert [each for each in page.requests if not each.startswith((address, "data:"))] == []
        assert page.complaints == []


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
@pytest.mark.realtime  # a real browser
def test_a_browser_drives_the_materials(tmp_path):
    found, reported = [], threading.Event()

    class Pages(http.server.SimpleHTTPRequestHandler):
        def do_POST(self):
            found.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()
            reported.set()

        def log_message(self, *_):
            pass

    folder = tmp_path / "pages"
    folder.mkdir()
    shutil.copy(ROOT / "examples/bridge/bridge.js", folder)
    shutil.copy(Path(__file__).with_name("page.html"), folder)
    (folder / "plan.json").write_text(json.dumps(PLAN), encoding="utf-8")
    with (
        served(what=("--scenario", "materials")) as (url, _),
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Pages, directory=folder)) as server,
    ):
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        page = f"http://127.0.0.1:{server.server_port}/page.html?bridge={url}"
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        words = [BROWSER, "--headless", "--no-sandbox", "--enable-logging=stderr", *QUIET.split(), profile, page]
        said = tmp_path / "said"
        with (
            said.open("wb") as spoken,
            subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=spoken) as browser,
        ):
            reported.wait(2 * HANGS_S)
            browser.terminate()
        server.shutdown()
        thread.join()
    assert found, said.read_text(encoding="utf-8")
    assert found[0].get("scenario") == "materials", found  # it says "error" if an answer was not to its frame
    assert len(found[0]["felt"]) >= PLAN["felt"]
    for frame in found[0]["sent"]:
        CLIENT.validate(frame)
    assert set(found[0]["felt"]) <= {phase["name"] for phase in PLAN["phases"]}
